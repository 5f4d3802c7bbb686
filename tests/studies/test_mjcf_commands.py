"""From a MuJoCo arm that is not as its model says to a model that predicts it, by the command line."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import calib
from calib.arm.se3 import fit_rigid, rotate, so3_exp
from calib.arrays import Array
from calib.files.cell_out import extended_cell
from tests.studies.command_line import run
from tests.trees import in_mujoco

SIGMA = 1e-5  # m
NOMINAL = """<mujoco model="arm">
  <compiler angle="degree" eulerseq="XYZ" autolimits="true"/>
  <default><joint axis="0 1 0" range="-150 150"/></default>
  <worldbody>
    <body name="base">
      <body name="link1" pos="0 0 0.4"><joint name="A1" axis="0 0 1" range="-180 180"/>
        <inertial pos="0 0 0.1" mass="30" diaginertia="1 1 1"/>
        <frame pos="0.15 0 0.2" euler="0 20 0">
          <body name="link2"><joint name="A2" ref="20"/>
            <inertial pos="0 0 0.3" mass="20" diaginertia="1 1 1"/>
            <body name="wrist" pos="0.02 0 0.7" euler="0 90 0">
              <joint name="A3"/><joint name="A4" axis="0 0 1" pos="0 0.03 0"/>
              <inertial pos="0 0 0.2" mass="10" diaginertia="1 1 1"/>
              <body name="link5" pos="0 0 0.6"><joint name="A5"/>
                <inertial pos="0 0 0.02" mass="3" diaginertia="1 1 1"/>
                <body name="hand" pos="0 0 0.08"><joint name="A6" axis="0 0 1"/>
                  <inertial pos="0 0 0.02" mass="1" diaginertia="1 1 1"/>
                  <site name="flange" pos="0 0 0.05" euler="0 0 45"/>
                </body>
              </body>
            </body>
          </body>
        </frame>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
CELL = """schema = 1
name = "arm"
[robot]
mjcf = "model/scene.xml"
base = "base"
tip = "flange"
[markers_mm]
m1 = [100, 0, 30]
m2 = [-50, 90, 60]
m3 = [-40, -80, 100]
[instrument]
sigma_mm = 0.010
[model]
effects = ["base", "tool", "geometry"]
"""
MARKERS = np.array([[0.1, 0.0, 0.03], [-0.05, 0.09, 0.06], [-0.04, -0.08, 0.1]])


def perturbed(rng: np.random.Generator) -> str:
    """The true arm: every number that places something is off, and its markers are sites."""

    def off(match: re.Match[str]) -> str:
        size = {"pos": 1e-3, "axis": 1e-3, "euler": 0.05, "ref": 0.1}[match[1]]
        values = np.array(match[2].split(), dtype=float)
        return f'{match[1]}="{words(values + size * rng.normal(size=len(values)))}"'

    text = NOMINAL.replace('name="A3"', 'name="A3" axis="0 1 0" pos="0 0 0"')
    text = text.replace('<body name="link2">', '<body name="link2" pos="0 0 0" euler="0 0 0">')
    text = re.sub(r'(?<= )(pos|axis|euler|ref)="([^"]*)"', off, text)
    return with_markers(text, MARKERS + 1e-3 * rng.normal(size=(3, 3)))


def with_markers(text: str, tool: Array) -> str:
    """Sites m1 .. in the axes of the flange."""
    flange = re.search(r'<site name="flange" (.*)/>', text)
    assert flange is not None
    marks = "".join(f'<site name="m{j + 1}" pos="{words(p)}"/>' for j, p in enumerate(tool))
    return text.replace(flange[0], f"<frame {flange[1]}>{marks}</frame>")


def words(values: Array) -> str:
    return " ".join(repr(float(v)) for v in values)


def sites(model: mujoco.MjModel, names: list[str], q: Array) -> Array:
    """Shape (poses, markers, 3), m."""
    return places(model, "site", names, q)


def places(model: Any, kind: str, names: list[str], q: Array) -> Array:
    """Of sites or bodies, shape (poses, markers, 3), m."""
    data = mujoco.MjData(model)
    found = []
    for row in q:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        found.append([getattr(data, kind)(name).xpos.copy() for name in names])
    return np.array(found)


def table(q: Array, points: Array) -> str:
    joints = ",".join(f"A{k + 1}_deg" for k in range(q.shape[1]))
    lines = [f"pose,marker,{joints},x_mm,y_mm,z_mm"]
    for i, (row, seen) in enumerate(zip(np.degrees(q), points * 1e3, strict=True)):
        for j, point in enumerate(seen):
            lines.append(f"p{i},m{j + 1},{','.join(repr(float(v)) for v in (*row, *point))}")
    return "\n".join([*lines, ""])


def rms(error: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(error**2, axis=-1))))


class Calibrated:
    """A truth in MuJoCo, measured, identified from the nominal file, and written back."""

    def __init__(self, folder: Path) -> None:
        rng = np.random.default_rng(11)
        self.folder = folder
        (folder / "model").mkdir()
        (folder / "model" / "arm.xml").write_text(NOMINAL)
        (folder / "model" / "scene.xml").write_text('<mujoco><include file="arm.xml"/></mujoco>')
        (folder / "cell.toml").write_text(CELL)
        truth = mujoco.MjModel.from_xml_string(perturbed(rng))
        R, p = so3_exp(np.array([0.3, -0.2, 1.1])), np.array([3.0, 1.0, -0.5])
        q = rng.uniform(-1.6, 1.6, (70, 6))
        readings = rotate(R, sites(truth, ["m1", "m2", "m3"], q)) + p
        self.new, self.true = q[40:], readings[40:]
        noisy = readings[:40] + SIGMA * rng.normal(size=(40, 3, 3))
        (folder / "measurements.csv").write_text(table(q[:40], noisy))
        self.said = run(
            *("identify", folder / "cell.toml", folder / "measurements.csv"),
            *("--urdf", folder / "better.urdf", "--json", folder / "result.json"),
        )
        assert self.said.exit_code == 0, self.said.output
        self.result: dict[str, Any] = json.loads((folder / "result.json").read_text())

    def gap(self, text: str) -> float:
        """What MuJoCo's markers miss the truth by at the new poses, placed as identified."""
        names = ["marker_m1", "marker_m2", "marker_m3"]
        found = places(in_mujoco(text), "body", names, self.new)
        base = self.result["base"]
        R = so3_exp(np.array(base["rotation_vector_rad"]))
        return rms(rotate(R, found) + np.array(base["translation_mm"]) / 1e3 - self.true)


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Calibrated:
    return Calibrated(tmp_path_factory.mktemp("mjcf"))


def test_the_users_simulator_shows_the_smaller_gap(calibrated: Calibrated) -> None:
    nominal = mujoco.MjModel.from_xml_string(with_markers(NOMINAL, MARKERS))
    found = sites(nominal, ["m1", "m2", "m3"], calibrated.new)
    T = fit_rigid(calibrated.true.reshape(-1, 3), found.reshape(-1, 3))
    before = rms(rotate(T[:3, :3], found) + T[:3, 3] - calibrated.true)
    after = calibrated.gap((calibrated.folder / "better.urdf").read_text())
    print(
        f"MuJoCo's markers off the truth at new poses: {before * 1e3:.4f} -> {after * 1e3:.4f} mm"
    )
    assert calibrated.result["status"] == "converged"
    assert before > 2e-3
    assert after < np.sqrt(3.0) * SIGMA, "below the noise of the readings"


def test_results_name_every_file_of_the_robot(calibrated: Calibrated) -> None:
    names = [Path(entry["file"]).name for entry in calibrated.result["inputs"]]
    assert names == ["cell.toml", "scene.xml", "arm.xml", "measurements.csv"]
    folder = calibrated.folder
    arm = folder / "model" / "arm.xml"
    done = run("identify", folder / "cell.toml", folder / "measurements.csv", "--urdf", arm)
    assert done.exit_code == 2
    assert "arm.xml: is already an input" in done.stderr
    assert arm.read_text() == NOMINAL


def test_what_a_rigid_robot_cannot_hold_is_said(calibrated: Calibrated) -> None:
    folder = calibrated.folder
    effects = 'effects = ["base", "tool", "geometry", "joint_compliance:A2,A3"]'
    (folder / "soft.toml").write_text(re.sub(r"effects = .*", effects, CELL))
    done = run(
        *("identify", folder / "soft.toml", folder / "measurements.csv"),
        *("--urdf", folder / "soft.urdf"),
    )
    assert done.exit_code == 0, done.output
    assert "rigid, without joint_compliance:A2, joint_compliance:A3" in done.stdout
    assert "rigid" not in calibrated.said.output
    said = "better.urdf is made anew from the MJCF: the bare chain, without"
    assert said in calibrated.said.stdout


def test_a_cell_elsewhere_finds_its_mjcf(calibrated: Calibrated, tmp_path: Path) -> None:
    cell = calib.load_cell(calibrated.folder / "cell.toml")
    data = calib.load_measurements(cell, calibrated.folder / "measurements.csv")
    target = tmp_path / "cell.toml"
    target.write_text(extended_cell(cell, [], data.poses, target).text)
    again = calib.load_cell(target)
    assert [f.resolve() for f in again.robot_files] == [f.resolve() for f in cell.robot_files]
