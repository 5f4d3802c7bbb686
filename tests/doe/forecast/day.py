"""A measuring day in simulation: the paper's arm, its plan, and what is read in which order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib import Cell, Measurements, readings
from calib.arm.statics import wrench_with_load
from calib.cell.planned import Planned
from calib.effects.protocol import ElasticEffect
from calib.model.build import build
from calib.noise import Noise
from calib.poses import Poses
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings
from tests.helpers import with_effects

RIGID = ("base", "tool", "joint_offset:A2,A3")
MODEL = (*RIGID, "joint_compliance:A2,A3,A4,A5,A6")


def cell_of_day(kr270: Cell) -> Cell:
    return replace(with_effects(kr270, *MODEL), design=Planned())


def whole_day(cell: Cell, plan: Poses, seed: int = 1, louder: float = 1.0) -> Measurements:
    """Every reading of the plan, free then loaded, ten minutes apart, loads as wrenches."""
    poses = readings(cell, plan)
    poses = replace(
        poses,
        wrench=wrench_with_load(cell.robot, cell.gravity, poses),
        load_mass=np.zeros(len(poses)),
        time=600.0 * np.arange(len(poses)),
        approach=None,
    )
    poses = with_moves(poses)
    model = build(cell, poses).model
    values = np.zeros(len(model.parameters))
    values[model.where(ElasticEffect)] = 1e-6
    values[:6] = [2.0, -1.0, 0.5, 0.1, -0.2, 0.7]
    n = cell.noise
    noise = Noise(*(louder * s for s in (n.along, n.across, n.along_per_m, n.across_per_m)))
    return drawn_readings(model, values, poses, noise, np.random.default_rng(seed))


def of_poses(data: Measurements, poses: list[int], count: int) -> Measurements:
    """Free and loaded readings of some poses of the plan, all free ones first."""
    return data.take(np.array([*poses, *(count + i for i in poses)]))
