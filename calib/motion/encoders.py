"""What a second encoder, behind the gear, says of its clock, its compliance and its lost motion.

    link - motor = constant of the run + delay v + compliance torque + half_width z(q)

fitted together: a clock that is three milliseconds off makes nearly all of the difference, and what it
leaves in a regression on the torque looks like a compliance of the wrong sign.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.motion.effects import presliding
from calib.motion.filtering import Samples, filtered
from calib.motion.motions import Motions

_DISTANCES = (300.0, 1e3, 3e3, 1e4)  # 1/rad, over which lost motion turns
NAMES = ("clock_offset", "joint_compliance", "backlash")
UNITS = ("ms", "urad/(N m)", "urad")
_SCALES = (1e-3, 1e-6, 1e-6)


@dataclass(frozen=True)
class GearFit:
    """Of one gear: values and deviations of its clock offset, compliance and lost motion, in ``UNITS``.

    before, after : RMS of the difference of both encoders, rad, with constants of the runs taken out
    """

    joint: str
    values: tuple[float, ...]
    std: tuple[float, ...]
    before: float
    after: float


def gear_fits(cell: Cell, motions: Motions) -> tuple[GearFit, ...]:
    """The fit of every joint that has a second encoder."""
    runs = [run for run in motions.runs if run.link is not None]
    if not runs or motions.unit == "A":
        return ()
    samples = [own for run in runs if len(own := filtered(run, cell.motion.cutoff))]
    found = []
    for j, joint in enumerate(cell.robot.joints):
        with_link = [
            own for own in samples if own.beyond is not None and np.isfinite(own.beyond[:, j]).all()
        ]
        if with_link:
            found.append(_gear_fit(joint, j, with_link))
    return tuple(found)


def _gear_fit(joint: str, j: int, samples: list[Samples]) -> GearFit:
    """By the distance of lost motion that fits best; deviations by the jackknife over runs."""
    trials = [_solved(j, samples, sigma) for sigma in _DISTANCES]
    sigma = _DISTANCES[int(np.argmin([after for _, _, after in trials]))]
    values, before, after = _solved(j, samples, sigma)
    count = len(samples)
    if count > 1:
        without = [_solved(j, samples[:r] + samples[r + 1 :], sigma)[0] for r in range(count)]
        std = np.sqrt(
            (count - 1.0) / count * ((without - np.mean(without, axis=0)) ** 2).sum(axis=0)
        )
    else:
        std = np.full(len(values), np.nan)
    return GearFit(
        joint, tuple((values / _SCALES).tolist()), tuple((std / _SCALES).tolist()), before, after
    )


def _solved(j: int, samples: list[Samples], sigma: float) -> tuple[Array, float, float]:
    """Clock offset, compliance and half width, and the RMS before and after."""
    rows, rest = [], []
    for own in samples:
        z = presliding(own.q[:, j], sigma)
        X = np.column_stack([own.v[:, j], own.effort[:, j], z])
        rows.append(X - X.mean(axis=0))
        beyond = np.zeros(len(own)) if own.beyond is None else own.beyond[:, j]
        rest.append(beyond - beyond.mean())
    X, y = np.concatenate(rows), np.concatenate(rest)
    b = np.linalg.lstsq(X, y, rcond=None)[0]
    return b, float(np.sqrt((y**2).mean())), float(np.sqrt(((y - X @ b) ** 2).mean()))
