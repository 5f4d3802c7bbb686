"""Target poses: where accuracy is wanted."""

from __future__ import annotations

import numpy as np

from calib.cell import Cell
from calib.files.tables import load_targets
from calib.poses import Poses, hung, poses_at
from calib.se3 import Array

_COUNT = 200


def targets_of(cell: Cell) -> tuple[Poses, Array]:
    """The cell's own targets and weights, shape (m,), else 200 Sobol poses within the limits, seed 0.

    Raises InputError where the cell's table of targets cannot be read.
    """
    if cell.design.get("targets") is not None:
        return load_targets(cell, cell.design["targets"])
    poses = sobol_poses(cell, _COUNT, 0)
    if cell.load is not None:
        poses = hung(poses, cell.load.mass, cell.load.com)
    return poses, np.ones(_COUNT)


def sobol_poses(cell: Cell, count: int, seed: int) -> Poses:
    """Scrambled Sobol poses over the joint box, free of load."""
    from scipy.stats import qmc

    sampler = qmc.Sobol(cell.robot.dof, scramble=True, rng=np.random.default_rng(seed))
    unit = sampler.random(2 ** int(np.ceil(np.log2(count))))[:count]
    low, high = cell.robot.sample_limits().T
    return poses_at(low + unit * (high - low))
