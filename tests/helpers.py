"""Random robots and loads, numerical derivatives, and small cells on disk."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from calib import Cell, readings
from calib.arm.robot import Robot
from calib.arm.se3 import so3_exp, transform
from calib.arm.statics import Payload, wrench_with_load
from calib.arrays import Array
from calib.cell.planned import Planned
from calib.diagnosis.stage import Stage
from calib.effects import EFFECTS, Context
from calib.files.cell import planned, with_targets
from calib.files.write_tables import measurements_csv
from calib.identification.start import initial_values, whitening
from calib.instruments import Instrument, Tracker
from calib.model import Model
from calib.model.build import build
from calib.noise import Noise
from calib.poses import Measurements, Poses, poses_at
from calib.simulation import drawn_readings
from studies.demo.embedded import (
    INPUTS,
    embedded_cell,
    embedded_plan,
    embedded_text,
    true_values,
)
from studies.results.base import Envelope

GRAVITY = np.array([0.0, 0.0, -9.80665])


def designed(cell: Cell, targets: Path | None = None, **table: object) -> Cell:
    """The cell with another [design] table, as a file would give it, and targets of another file."""
    design = planned(cell.path, cell.robot, TypeAdapter(Planned).validate_python(table))
    return with_targets(
        replace(cell, design=design), None if targets is None else str(targets.resolve())
    )


def cell_text(
    robot: str,
    markers: str = "m1 = [0, 0, 300]",
    effects: Sequence[str] = ("base", "tool", "geometry"),
) -> str:
    """The text of a small cell whose points are read to 0.01 mm; robot, markers : keys of theirs."""
    return (
        f"schema = 1\n[robot]\n{robot}\n[markers_mm]\n{markers}\n"
        f"[instrument]\nsigma_mm = 0.01\n[model]\neffects = {json.dumps([*effects])}\n"
    )


def random_robot(rng: np.random.Generator, dof: int, prismatic: Sequence[int] = ()) -> Robot:
    """A serial chain with nothing special about it."""
    axes = rng.normal(size=(dof, 3))
    origins = transform(
        so3_exp(rng.normal(size=(dof + 1, 3))), rng.uniform(-0.5, 0.5, (dof + 1, 3))
    )
    slides = np.isin(np.arange(dof), prismatic)
    limits = np.where(slides[:, None], [-0.5, 0.5], [-np.pi, np.pi])
    return replace(
        light_chain(origins, limits, prismatic),
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        masses=rng.uniform(2.0, 40.0, dof),
        coms=rng.uniform(-0.2, 0.2, (dof, 3)),
    )


def light_chain(origins: Array, limits: Array, prismatic: Sequence[int] = ()) -> Robot:
    """Joints about z, or along it, behind origins (n + 1, 4, 4); limits (n, 2); no link weighs."""
    joints = tuple(f"j{k + 1}" for k in range(len(origins) - 1))
    slides = np.isin(np.arange(len(joints)), prismatic)
    chain = Robot.of_geometry("chain", ("base", "tip"), joints, slides, origins)
    return replace(chain, limits=limits)


def random_poses(rng: np.random.Generator, robot: Robot, count: int, loaded: bool = True) -> Poses:
    """Poses anywhere in the joint box, under a wrench and a hung load, in a session that warms."""
    low, high = robot.sample_limits().T
    q = rng.uniform(low, high, (count, robot.dof))
    session = {
        "temperature": rng.uniform(15.0, 30.0, count),
        "time": rng.uniform(0.0, 2e4, count),
        "approach": rng.choice([-1.0, 1.0], q.shape),
        "motion": rng.uniform(0.0, 1.0, q.shape),
        "torque": rng.uniform(-50.0, 50.0, q.shape),
    }
    if not loaded:
        return poses_at(q, **session)
    return poses_at(
        q,
        **session,
        wrench=rng.normal(size=(count, 6)) * 100.0,
        load_mass=rng.uniform(0.0, 20.0, count),
        load_com=rng.uniform(-0.1, 0.2, 3),
    )


def random_context(rng: np.random.Generator, robot: Robot, markers: int = 3) -> Context:
    """Markers, knots and spring anchors for every effect of the catalogue."""
    return Context(
        robot=robot,
        markers=rng.uniform(-0.2, 0.2, (markers, 3)),
        marker_names=tuple(f"m{j + 1}" for j in range(markers)),
        knots={
            joint: np.array([-1.0, 0.0, 1.0]) * (0.4 if slides else 2.0)
            for joint, slides in zip(robot.joints, robot.prismatic, strict=True)
        },
        anchors={
            joint: rng.uniform(0.1, 0.5, (2, 3))
            for joint, slides in zip(robot.joints, robot.prismatic, strict=True)
            if not slides
        },
        gravity=GRAVITY,
        payload=Payload(1.5, (0.0, 0.02, 0.05)),
        measured_load=True,
    )


def model_of(context: Context, kinds: Sequence[str]) -> Model:
    """Every effect of some kinds at every place."""
    effects = [
        EFFECTS[kind].at(context, w) for kind in kinds for w in EFFECTS[kind].places(context)
    ]
    return Model(
        context.robot,
        context.marker_names,
        context.markers,
        tuple(effects),
        context.payload,
        context.gravity,
        context.instruments,
    )


def central_difference(function: Callable[[Array], Array], at: Array, steps: Array) -> Array:
    """Fourth-order derivative, parameters in the last axis, of a function of arrays (..., p)."""
    offsets = np.array([1.0, -1.0, 2.0, -2.0])[:, None, None] * np.diag(steps)
    ahead, back, far_ahead, far_back = np.moveaxis(function(at + offsets), 1, -1)
    return (8.0 * (ahead - back) - (far_ahead - far_back)) / (12.0 * steps)


def cell_of(robot: Robot, markers: Array, effects: Sequence[str], sigma: float = 1e-5) -> Cell:
    """A cell without files."""
    return Cell(robot, markers, Tracker(sigma=sigma), effects, name="test")


def read_by(noise: Noise | None = None, stands: Array | None = None) -> tuple[Instrument, ...]:
    """The instruments of a cell that has one tracker; without noise as in ``cell_of``."""
    return (Tracker(noise=noise or Noise.isotropic(1e-5), stands=stands),)


def with_effects(cell: Cell, *effects: str) -> Cell:
    """The cell under another model."""
    return replace(cell, effects=effects)


def first_markers(cell: Cell, count: int) -> Cell:
    """The cell with so many of its markers."""
    return replace(
        cell,
        markers=cell.markers[:count],
        marker_names=cell.marker_names[:count],
        marker_normals=cell.marker_normals[:count],
        marker_acceptance=cell.marker_acceptance[:count],
    )


def stage_of(cell: Cell, data: Measurements) -> Stage:
    """Where a diagnosis begins: the cell's model at its start values, no pose left out."""
    model = build(cell, data.poses).model
    start = initial_values(model, data)
    nothing = np.zeros(len(data), dtype=bool)
    return Stage(data, model, start, whitening(cell, model, start, data), nothing)


def all_seen(poses: Poses, readings: Array) -> Measurements:
    """Readings (m, M, r) of which none is hidden, each as uncertain as its instrument says."""
    shape = readings.shape[:2]
    return Measurements(poses, readings, np.ones(shape, dtype=bool), np.full(shape, np.nan))


def simulated(cell: Cell, plan: Poses, seed: int) -> tuple[Measurements, Model, Array]:
    """Measurements of the plan, free and loaded, with the model and the values behind them.

    The load is written as a wrench, as a user would record it.
    """
    rng = np.random.default_rng(seed)
    poses = readings(cell, plan)
    wrench = wrench_with_load(cell.robot, cell.gravity, poses)
    poses = replace(poses, wrench=wrench, load_mass=np.zeros(len(poses)))
    model = build(cell, poses).model
    values = true_values(model, rng)
    return drawn_readings(model, values, poses, cell.noise, rng), model, values


def measured_cell(folder: Path) -> Path:
    """The embedded cell, Table II as ``plan.csv``, and what a robot that the model knows measures."""
    cell = embedded_cell()
    for name in INPUTS:
        (folder / name).write_text(embedded_text(name))
    data, model, values = simulated(cell, embedded_plan(cell), 0)
    (folder / "measurements.csv").write_text(measurements_csv(cell, data))
    truth = {
        p.id: {"value": value / p.scale, "unit": p.unit}
        for p, value in zip(model.parameters, values, strict=True)
    }
    (folder / "truth.json").write_text(json.dumps({"parameters": truth}))
    return folder


MADE_FROM = Envelope(version="0", seed=0, inputs=(), cell="", about={})
"""Of a record that no command made."""
