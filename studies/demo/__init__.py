"""The paper's robot and cell, embedded: what ``posecal demo`` starts from."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from calib import Cell, Measurements, load_cell, load_plan, readings
from calib.build import build
from calib.model import Model
from calib.poses import Poses
from calib.se3 import Array
from calib.simulate import simulate

INPUTS = ("cell.toml", "kr270.urdf", "plan.csv")


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
    truth: dict[str, Any] = json.loads(embedded_text("truth.json"))
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


def simulated(cell: Cell, plan: Poses, seed: int) -> tuple[Measurements, Model, Array]:
    """Measurements of the plan, free and loaded, with the model and the values behind them.

    The load is written as a wrench, as a user would record it.
    """
    from calib.files.write_tables import wrench_with_load

    rng = np.random.default_rng(seed)
    poses = readings(cell, plan)
    wrench = wrench_with_load(cell, poses)
    poses = replace(poses, wrench=wrench, load_mass=np.zeros(len(poses)))
    model = build(cell, poses).model
    values = true_values(model, rng)
    return simulate(model, values, poses, cell.noise, rng), model, values
