"""The paper's robot and cell, embedded: what ``posecal demo`` starts from."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from calib import Cell, Measurements, load_cell, load_plan, readings
from calib.arm.statics import wrench_with_load
from calib.arrays import Array
from calib.model import Model
from calib.model.build import build, context_of, place_effect
from calib.poses import Poses, poses_at
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings

INPUTS = ("cell.toml", "kr270.urdf", "plan.csv")
_CHECKS = 8  # poses that take no part in the fit
_READING_S, _WARMING_K = 90.0, 3.0


def embedded_text(name: str) -> str:
    """The text of an embedded file."""
    return (files("studies.demo") / name).read_text(encoding="utf-8")


def embedded_cell() -> Cell:
    """The embedded cell."""
    return load_cell(Path(str(files("studies.demo") / "cell.toml")))


def embedded_plan(cell: Cell) -> Poses:
    """Table II of the paper: fifteen poses at five angles of A2."""
    return load_plan(cell, Path(str(files("studies.demo") / "plan.csv")))


def true_values(model: Model, rng: np.random.Generator) -> Array:
    """The truth of the demonstration: Table IV's compliances, drawn geometry, a base far off."""
    truth = _truth()
    values = np.zeros(len(model.parameters))
    levels = iter(truth["compliance_A2"])
    for i, p in enumerate(model.parameters):
        if p.effect == "base":
            values[i] = truth["base"][p.name] * p.scale
        elif p.effect == "tool":
            values[i] = rng.normal() * truth["tool_mm"] * p.scale
        elif p.effect == "geometry":
            values[i] = rng.normal() * truth["geometry_um_urad"] * p.scale
        elif p.effect == "stiffness_vs_angle":
            values[i] = next(levels) * p.scale
        else:
            values[i] = truth["compliance"][p.where] * p.scale
    return values


@dataclass(frozen=True, eq=False)
class DemoDay:
    """A simulated day of measurement, and the truth behind it.

    plan, check : Measurements, of the plan, and of poses that take no part in the fit
    model, values : with the withheld effect, which is named ``withheld``
    """

    plan: Measurements
    check: Measurements
    model: Model
    values: Array
    withheld: str


def session(cell: Cell, plan: Poses, seed: int) -> DemoDay:
    """A day with a robot that has an effect which the cell's model lacks; which one, the seed says.

    Plan and eight poses more, each free, then loaded; a reading takes a minute and a half, while the
    hall warms up.
    """
    rng = np.random.default_rng(seed)
    check = poses_at(cell.robot.sobol(_CHECKS, seed + 1))
    check = replace(check, names=tuple(f"c{i:02d}" for i in range(1, _CHECKS + 1)))
    poses = _one_day(cell, plan, check)
    hidden = _truth()["withheld"]
    effect, given = hidden[rng.integers(len(hidden))].values()
    kind, _, where = effect.partition(":")
    model = build(cell, poses).model
    values = true_values(model, rng)
    own = place_effect(kind, where, context_of(cell, poses))
    model, values = model.extended(values, [own])
    sizes = [given.get(p.name, 0.0) * p.scale for p in own.parameters]
    values[len(values) - len(sizes) :] = sizes
    data = drawn_readings(model, values, poses, cell.noise, rng)
    of_plan = np.arange(len(data)) < len(readings(cell, plan))
    return DemoDay(data.take(of_plan), data.take(~of_plan), model, values, effect)


def _one_day(cell: Cell, *plans: Poses) -> Poses:
    """The readings in their order: each plan free, then loaded."""
    parts = [readings(cell, plan) for plan in plans]
    names = [name for part in parts for name in part.names]
    hung = {
        "load_mass": np.concatenate([part.load_mass for part in parts]),
        "load_com": parts[0].load_com,
    }
    poses = poses_at(np.concatenate([part.q for part in parts]), names, **hung)
    order: Array = np.arange(len(poses), dtype=np.float64)
    return with_moves(
        replace(
            poses,
            wrench=wrench_with_load(cell.robot, cell.gravity, poses),
            load_mass=np.zeros(len(poses)),
            time=_READING_S * order,
            temperature=20.0 + _WARMING_K * (1.0 - np.exp(-order / (0.4 * len(order)))),
        )
    )


def _truth() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(embedded_text("truth.json"))
    return found
