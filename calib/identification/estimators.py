"""What is estimated from readings, and how: the directions that they determine, the two steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.arrays import Array, Mask
from calib.effects.protocol import ElasticEffect
from calib.model.covariance import Identifiable, Unidentifiable, identifiable
from calib.observations import Observation
from calib.solver import Linearise, Minimum, condensed, normal_equations

_SETTLED = 1e-6  # of a plausible size, or of the standard deviations of the estimate
_DIVERGED = "these poses tell so little of it that its estimate ran away"
_STIFF = 0.03  # of the plausible size of a compliance: as the drives of a heavy arm yield

Method = Literal["joint", "two-step"]
"""All parameters at once, or the paper's two steps in turn."""


def choose_directions(
    observation: Observation, values: Array, span: Array | None = None
) -> Identifiable:
    """The subset of directions that the data determine, linearised at some values.

    span : ndarray, shape (p, k), directions to choose from; the observation's by default
    Elastic elements are taken as a little soft at least: a load effect shows through them only.
    """
    model = observation.model
    probe = values.copy()
    elastic = model.where(ElasticEffect)
    probe[elastic] = np.maximum(probe[elastic], _STIFF * model.sizes[elastic])
    _, J = observation.flat(probe)
    span = observation.span() if span is None else span
    ids = [p.id for p in model.parameters]
    sizes, names = [], []
    for direction in span.T:
        members = np.flatnonzero(direction)
        alone = len(members) == 1
        sizes.append(model.sizes[members].max())
        names.append(ids[members[0]] if alone else "tool (as one body)")
    return identifiable(condensed(J) @ span, np.array(sizes), tuple(names))


@dataclass(frozen=True, eq=False)
class Directions:
    """The directions in which values are estimated.

    among : ndarray, shape (p, n), directions to choose from; chosen : Identifiable, of them
    diverged : tuple of Unidentifiable, that are not among them, for a fit lost them
    """

    among: Array
    chosen: Identifiable
    diverged: tuple[Unidentifiable, ...] = ()

    @classmethod
    def at(cls, observation: Observation, values: Array) -> Directions:
        """What the data determine at some values."""
        among = observation.span()
        return cls(among, choose_directions(observation, values, among))

    def anew(self, observation: Observation, values: Array) -> Directions:
        """The choice made anew, linearised at other values."""
        return replace(self, chosen=choose_directions(observation, values, self.among))

    def without(self, observation: Observation, values: Array, out: Mask) -> Directions:
        """The choice without values (p,) whose estimates diverged."""
        names = tuple(observation.model.parameters[i].id for i in np.flatnonzero(out))
        among = self.among[:, np.abs(self.among[out]).sum(axis=0) == 0.0]
        diverged = (*self.diverged, Unidentifiable(names, _DIVERGED))
        return replace(self, among=among, diverged=diverged).anew(observation, values)

    @property
    def span(self) -> Array:
        """The directions that are estimated, shape (p, k)."""
        return self.among[:, self.chosen.kept]

    @property
    def identifiable(self) -> Identifiable:
        """What the data determine, with what a fit lost."""
        lost = (*self.chosen.unidentifiable, *self.diverged)
        return replace(self.chosen, unidentifiable=lost)


# -- the paper's two steps -------------------------------------------------------------------------

# Equations (11) to (15) hold to first order only when taken once, because they exchange R_base and
# R_robot; here step 1 uses the exact derivative at the present base, and the base is renewed through
# the exponential. Alternation is block coordinate descent. It needs many turns where base and tool
# correlate with joint offsets, so the turns are made on the normal equations and the model is
# linearised anew only when they have settled; the minimum is that of the joint solver.

_SINGULAR = 1e-13  # of the largest eigenvalue
_MOST_TURNS = 200_000
_MOST_LINEARISATIONS = 60


def alternate(linearise: Linearise, start: Array, placement: Array, rest: Array) -> Minimum:
    """Minimise by turns over two sets of directions.

    start : ndarray, shape (p,); placement : ndarray, shape (p, a), base and tool (step 1)
    rest : ndarray, shape (p, b), geometric and elastostatic parameters (step 2)
    """
    span = np.column_stack([placement, rest])
    a = placement.shape[1]
    blocks = [part for part in (slice(0, a), slice(a, span.shape[1])) if part.stop > part.start]
    values, turns, converged = np.array(start, dtype=float), 0, False
    for _ in range(_MOST_LINEARISATIONS):
        r, J = linearise(values)
        cost, g, A = normal_equations(r, J @ span)
        step, used, settled = _turns(A, g, blocks, _MOST_TURNS - turns)
        turns += used
        values = values + span @ step
        if settled and step @ A @ step <= _SETTLED**2 * max(1.0, float(cost) / max(len(step), 1)):
            converged = True
            break
    r, _ = linearise(values)
    return Minimum(values, np.sum(r**2, axis=-1), np.array(converged), turns)


def _turns(A: Array, g: Array, blocks: list[slice], most: int) -> tuple[Array, int, bool]:
    """Solve ``A step = g`` block by block in turn (Gauss-Seidel): step, turns, whether it settled."""
    inverse = [_inverse(A[part, part]) for part in blocks]
    step, gradient = np.zeros_like(g), g.copy()
    for turn in range(1, most + 1):
        before = step.copy()
        for part, solve in zip(blocks, inverse, strict=True):
            move = solve @ gradient[part]
            step[part] += move
            gradient = gradient - A[:, part] @ move
        change = step - before
        length, moved = float(step @ A @ step), float(change @ A @ change)
        if len(blocks) == 1 or moved <= (1e-3 * _SETTLED) ** 2 * max(1.0, length):
            return step, turn, True
    return step, most, False


def _inverse(A: Array) -> Array:
    """Inverse of a symmetric matrix, columns scaled to one; what rounding alone tells stays put."""
    scale = np.sqrt(np.diag(A))
    scale = np.where(scale > 0.0, scale, 1.0)
    inner = np.linalg.pinv(A / np.outer(scale, scale), rcond=_SINGULAR, hermitian=True)
    return np.asarray(inner / np.outer(scale, scale))
