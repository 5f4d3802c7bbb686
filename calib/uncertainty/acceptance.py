"""Whether held-out points are within a tolerance, by a stated rule (ISO 14253-1, JCGM 106).

A point is off by the distance d between where it is measured and where it is predicted. The reading
itself is uncertain, in space by U with 95 %, so that the true distance is within U of d. By the guarded
rule a point passes where d + U is within the tolerance, fails where d - U is beyond it, and is
undecided in between; by simple acceptance it passes where d is within.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.cell.cell import Acceptance, Verdict
from calib.identification import Identification, Residuals
from calib.identification.start import whitening
from calib.uncertainty.considered import common_displacements
from calib.uncertainty.expanded import coverage_factor, directions, effective_freedom


@dataclass(frozen=True, eq=False)
class ConformityTest:
    """The points held out against the tolerance.

    distances, expanded : ndarray, shape (n,), m, of each point and its 95 % uncertainty as measured
    verdicts : of each; verdict : of all: one that fails is enough, and one that is undecided. None
        where there are no points
    """

    acceptance: Acceptance
    distances: Array
    expanded: Array
    verdicts: tuple[Verdict, ...]

    @property
    def verdict(self) -> Verdict | None:
        if not self.verdicts:
            return None
        worst: tuple[Verdict, ...] = ("fail", "undecided")
        return next((own for own in worst if own in self.verdicts), "pass")


def judged(cell: Cell, found: Identification) -> ConformityTest | None:
    """Every held-out point whose reading has a length; None without a tolerance."""
    held, acceptance = found.heldout, cell.acceptance
    if acceptance is None:
        return None
    if held is None:
        return ConformityTest(acceptance, np.zeros(0), np.zeros(0), ())
    counts = held.data.seen & held.channels.lengths.any(axis=-1)
    distances, expanded = held.lengths(), _expanded(cell, found, held)[counts]
    return ConformityTest(
        acceptance, distances, expanded, tuple(acceptance.judge(distances, expanded))
    )


def _expanded(cell: Cell, found: Identification, held: Residuals) -> Array:
    """How far held-out readings may be off, with 95 %, by the instrument and its common errors, (m, C).

    The instrument counts as the cell or repeated readings tell it: what is left of the fit is the
    robot's.
    """
    data, noise = held.data, found.noise
    repeated = noise.source == "replicates" and noise.replicate_factor is not None
    factor, freedom = (noise.factor, noise.dof) if repeated else (1.0, np.inf)
    lengths = held.channels.lengths[..., None]
    spread = factor * np.linalg.pinv(whitening(cell, found.model, found.values, data)) * lengths
    parts = [(spread, freedom)]
    for _, error, moved in common_displacements(found.model, found.values, data):
        if error.kind.columns is not None:  # gravity moves what is predicted, no reading
            parts.append((moved * error.std * lengths, error.freedom))
    variances = [((own**2).sum(axis=(-1, -2)), nu) for own, nu in parts]
    n = directions(np.concatenate([own for own, _ in parts], axis=-1))
    total = np.sum([own for own, _ in variances], axis=0)
    return np.asarray(coverage_factor(effective_freedom(variances), n) * np.sqrt(total))
