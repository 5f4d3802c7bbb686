"""Every reader with small inputs that it accepts. A new reader is a function and one entry.

A reader takes a folder with the files of the demonstration and the bytes under test.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

import calib
from calib.files.estimate import load_estimate
from calib.files.mjcf import load_mjcf
from calib.files.read import sha256
from calib.files.robot_out import corrected_urdf
from calib.files.tables import holds_points, load_plan, load_targets
from calib.files.urdf import load_urdf
from calib.files.write import json_text
from calib.files.write_tables import measurements_csv
from calib.model.build import build, parse_effect
from calib.prediction.discrepancy import ModelDiscrepancy
from calib.prediction.estimate import Estimate
from doe.levels import levels_of, parse_levels
from doe.parameters import interest_of, with_rivals
from doe.request import Request
from studies.command.design import candidates_of, two_effects
from studies.command.session import read_session
from studies.demo.embedded import embedded_cell, embedded_plan, embedded_text
from studies.results.base import envelope
from studies.results.compensate import CompensateResult
from studies.results.estimate import Estimated
from tests.fuzz.small_cell import URDF
from tests.helpers import simulated
from tests.trees import random_mjcf

Read = Callable[[Path, bytes], object]

PART = "\n#----\n"
"""Between the files of an input that holds several."""
CELL = embedded_cell()
DATA = simulated(CELL, embedded_plan(CELL), 0)[0]
MODEL = build(CELL, DATA.poses).model
POSES = embedded_plan(CELL).take([0, 7])


def put(folder: Path, name: str, content: bytes) -> Path:
    """The file with the content."""
    path = folder / name
    path.write_bytes(content)
    return path


def parts(content: bytes) -> tuple[bytes, bytes]:
    """Both files of an input, empty where the second is missing."""
    first, _, second = content.partition(PART.encode())
    return first, second


# -- Readers


def cell(folder: Path, content: bytes) -> object:
    return calib.load_cell(put(folder, "cell.toml", content))


def urdf(folder: Path, content: bytes) -> object:
    path = put(folder, "arm.urdf", content)
    ends = ("base_link", "tool0") if b"base_link" in content else ("base", "tip")
    robot = load_urdf(path, *ends)
    return corrected_urdf(path, robot, np.zeros((robot.dof + 2, 6)), {"m1": np.zeros(3)})


def measurements(folder: Path, content: bytes) -> object:
    return calib.load_measurements(CELL, put(folder, "data.csv", content))


def holdout(folder: Path, content: bytes) -> object:
    path = put(folder, "held.csv", content)
    return read_session(CELL, put(folder, "data.csv", _MANY.encode()), str(path), 0)


def plan(folder: Path, content: bytes) -> object:
    path = put(folder, "plan.csv", content)
    return holds_points(path), load_plan(CELL, path)


def targets(folder: Path, content: bytes) -> object:
    return load_targets(CELL, put(folder, "targets.csv", content))


def options(folder: Path, content: bytes) -> object:
    """``option=text`` as it stands on the command line; the operating system knows no NUL there."""
    option, _, text = content.decode("utf-8", "surrogateescape").replace("\0", "").partition("=")
    if option == "levels":
        return levels_of(CELL, parse_levels(CELL, text), None)
    if option == "discriminate":
        pair = two_effects(text)
        return pair and with_rivals(CELL, pair)
    if option == "candidates":
        return candidates_of(text)
    if option == "holdout":
        return read_session(CELL, put(folder, "data.csv", _MANY.encode()), text, 0)
    if option == "effect":
        return build(replace(CELL, effects=(text,)), DATA.poses), parse_effect(text)
    of = tuple(name.strip() for name in text.split(","))
    return interest_of(MODEL, Request(15, "c" if option == "sum" else "Ds", of=of))


def whole(folder: Path, content: bytes) -> object:
    """Cell and data in one input: what loads must also identify, or say why not."""
    head, table = parts(content)
    own = calib.load_cell(put(folder, "cell.toml", head))
    return calib.identify(own, calib.load_measurements(own, put(folder, "data.csv", table)))


def mjcf(folder: Path, content: bytes) -> object:
    """Read the chain."""
    main, other = parts(content)
    path = put(folder, "arm.xml", main)
    put(folder, "part.xml", other)
    return load_mjcf(path, "base", "tip")


def estimate(folder: Path, content: bytes) -> object:
    """What ``posecal compensate`` does with a result."""
    known = load_estimate(CELL, put(folder, "result.json", content))
    found = calib.compensate(CELL, known, POSES)
    return CompensateResult.of(found, CELL, envelope(CELL.name, [])).to_json()


# -- Inputs

EVERY_KEY = """\
schema = 1
name = "every key"

[robot]
urdf = "kr270.urdf"
base = "base_link"
tip = "tool0"
repeatability_mm = 0.03
repeatability_urad = 100
limits_deg = { A2 = [-140.0, -0.01], A1 = [-90, 90] }
capsules_mm = { A2 = [{ from = [0, 0, 0], to = [1250, 0, 0], radius = 220 }], tool = [] }
compensators_mm = { A2 = { before = [-686, 0, 123], after = [185, 0, 0] } }

[markers_mm]
m1 = [279.2, -16.4, -91.9]
m2 = { position = [279.2, -25.2, 96.1], normal = [1, 0, 0], acceptance_deg = 30 }
m3 = [281.8, 130.5, 5.6]

[instrument]
sigma_mm = { range_mm = 0.003, transverse_mm = 0.004, transverse_mm_per_m = 0.0015 }
position_mm = [4000, 0, 1500]

[gravity]
m_s2 = [0, 0, -9.81]

[payload]
mass_kg = 12.5
com_mm = [80, 0, 0]

[load]
mass_kg = 250.0
com_mm = [300, 0, 150]
max_tilt_deg = 60

[design]
poses = 15
levels = { A2 = { count = 5, poses_per_level = 3, min_separation_deg = 15 } }
targets = "targets.csv"
repeats = false

[[design.obstacle]]
type = "box"
center_mm = [0, 0, 0]
size_mm = [1, 2, 3]
rpy_deg = [0, 45, 0]

[[design.obstacle]]
type = "sphere"
center_mm = [0, 0, 0]
radius_mm = 100

[[design.obstacle]]
type = "halfspace"
point_mm = [0, 0, 0]
normal = [0, 0, -1]

[diagnosis]
exclude = ["gravity_compensator", "backlash:A3"]

[model]
effects = ["base", "tool", "geometry", "stiffness_vs_angle:A2", "joint_compliance:A3,A4"]
knots_deg = { A2 = [-140.0, -56.9, -0.01] }
"""
_RIGID = (
    embedded_text("cell.toml")
    .replace('"geometry", ', "")
    .replace(', "stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6"', ', "joint_offset"')
)
_JOINTS = "A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg"
_AT = ("10,-90,80,5,-30,0", "-20,-45,100,15,30,90")


def _table(columns: str, *rows: str) -> str:
    return "\n".join([columns, *rows, ""])


_MANY = measurements_csv(CELL, DATA)
_FEW = measurements_csv(CELL, DATA.take([0, 1, 15]))
_SESSION = _table(
    f"pose,marker,{_JOINTS},x_m,y_m,z_m,time_s,temperature_degC,station,sigma_mm,"
    + ",".join(f"approach_A{k}" for k in range(1, 7)),
    *(
        f"p{i},m{m},{_AT[i]},1.5,0.{m},1e0,{60 * i},21.5,s{i},0.02,1,-1,0,1,1,1"
        for i in (0, 1)
        for m in (1, 2, 3)
    ),
)
_PLANS = (
    embedded_text("plan.csv"),
    _table(f"pose,{_JOINTS},fx_N,fz_N,level", *(f"p{i},{_AT[i]},0,-2450,-90" for i in (0, 1))),
)
_OPTIONS = (
    "levels=A2=5x3",
    "levels=A2=-140,-57,-10x3",
    "discriminate=joint_compliance:A1,bearing_compliance:A3",
    "candidates=2e3",
    "holdout=0.3",
    "effect=joint_compliance:A3,A4",
    "of=joint_compliance:A6,geometry",
    f"sum={MODEL.parameters[0].id}=0.5,{MODEL.parameters[-1].id}=-2",
)
_MJCF = """\
<mujoco><include file="part.xml"/>
  <worldbody><body name="base"><joint name="j0"/><geom size="0.1"/>
    <body name="tip"><joint name="j1"/><geom type="box" size="0.1 0.1 0.1"/></body></body></worldbody>
</mujoco>
"""
_INCLUDED = (
    '<mujocoinclude><option timestep="0.01"/><default><geom density="9"/></default></mujocoinclude>'
)
_ARMS = [
    random_mjcf(np.random.default_rng(1), 3, "site"),
    random_mjcf(np.random.default_rng(2), 3, "link"),
]


def _result(command: str, *effects: str) -> str:
    """A result as far as ``compensate`` reads it."""
    model = build(replace(CELL, effects=effects), POSES).model
    spread, left = np.diag(0.01 * model.sizes**2), ModelDiscrepancy(1e-5, "fitted poses")
    lost = (model.parameters[0].id,)
    own = Estimate(model, 0.1 * model.sizes, spread, 0.0, left, lost, ("a note",))
    files = (CELL.path, *CELL.robot_files)
    inputs = [{"file": str(path), "sha256": sha256(path)} for path in files]
    head = {"schema": 1, "command": command, "inputs": inputs}
    return json_text({**head, "estimate": Estimated.of(own).model_dump(by_alias=True)})


_ESTIMATES = (
    _result("identify", "base", "tool", "joint_offset"),
    _result("identify", *CELL.effects),
    _result("diagnose", "base", "joint_offset:A2", "backlash:A1", "transmission_harmonic:A3"),
)

READERS: dict[str, tuple[Read, tuple[str, ...]]] = {
    "cell": (cell, (EVERY_KEY, embedded_text("cell.toml"))),
    "urdf": (urdf, (embedded_text("kr270.urdf"), URDF)),
    "measurements": (measurements, (_FEW, _SESSION)),
    "holdout": (holdout, (_FEW, _SESSION)),
    "plan": (plan, _PLANS),
    "targets": (targets, (*_PLANS, _PLANS[1].replace("level", "weight").replace(",-90\n", ",2\n"))),
    "options": (options, _OPTIONS),
    "whole": (whole, (f"{_RIGID}{PART}{_MANY}", f"{EVERY_KEY}{PART}{_MANY}")),
    "mjcf": (mjcf, (_MJCF + PART + _INCLUDED, *(arm + PART for arm in _ARMS))),
    "estimate": (estimate, _ESTIMATES),
}
