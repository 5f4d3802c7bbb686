"""What poses are asked for beside telling rivals apart: the form of a cause, and the accuracy.

A cause that stands alone is not explained while nobody could have seen that its size runs with an angle
(:mod:`calib.diagnosis.shape`). The poses that show it are those where the cause is large and the angles
are many: the power of that test, foreseen.

Of rivals and of the error at the targets, what a plan reaches counts as a share of what as many poses
for it alone would reach, from what the data know already. Shares have no unit and can be added: a
compound criterion, as that of McGree, Eccleston and Duffull (J. Biopharm. Stat. 18(2), 2008) for D and
T.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array
from calib.cell.targets import targets_of
from calib.diagnosis import Diagnosis
from calib.diagnosis.causes import Cause
from calib.diagnosis.shape import SHAPE_ALPHA, TESTED, chance_of, wave_power, waves
from calib.diagnosis.stage import positions
from doe.ahead.evidence import FREE, ReducedEquations, RivalEvidence
from doe.ahead.likeness import SURE
from doe.ahead.search import PoseSearch, worst
from doe.ahead.situation import CandidateRows, Situation
from doe.problem.target_errors import TargetErrors

_WAVES = 4  # of each angle
_SURELY = 1e-12  # least probability, and greatest


@dataclass(frozen=True, eq=False)
class CauseForm:
    """The power of poses to show that a cause has another form than its name's.

    beside : callable, rows (m, r, p) at configurations (m, dof) -> those of the fitted, and what the
        cause does times each wave over the angles of the joints
    evidence : RivalEvidence, of the waves beside all that is modelled
    chances : ndarray, shape (joints,), what each counts; alpha : float, chance of a false doubt
    """

    key: str
    beside: Callable[[Array, Array], Array]
    evidence: RivalEvidence
    chances: Array
    alpha: float

    @property
    def data(self) -> ReducedEquations:
        return self.evidence.data

    def blocks(self, rows: Array, q: Array) -> Array:
        return self.evidence.blocks(self.beside(rows, q))

    def values(self, known: ReducedEquations, S: Array) -> Array:
        """In standard deviations like those of rivals: enough of either is enough."""
        from scipy.special import ndtri

        del known
        power = np.clip(self.power(S), _SURELY, 1.0 - _SURELY)
        return np.asarray(ndtri(power) - ndtri(TESTED) + ndtri(SURE))[..., None]

    def power(self, S: Array) -> Array:
        """Probability of seeing another form, from products of the waves (..., K, K), shape (...)."""
        lengths, found = np.sqrt(self.data.lengths), np.zeros(S.shape[:-2])
        for i, chance in enumerate(self.chances):
            at = slice(_WAVES * i, _WAVES * (i + 1))
            found += chance * wave_power(S[..., at, at], lengths[at], chance * self.alpha)
        return np.asarray(found / self.chances.sum())

    def hopeful(self, offer: CandidateRows, start: Array) -> bool:
        """Whether all candidates together would show it."""
        blocks = self.blocks(offer.rows(slice(None), start), offer.q)
        return bool(self.power(self.data.added(blocks).S) >= TESTED)


def forms_of(diagnosis: Diagnosis, data: tuple[Array, Array]) -> Iterator[CauseForm]:
    """Causes of which no reading would have shown another form, with what the data tell of it.

    data : residual (N,) and independent rows (N, p)
    """
    for cause in diagnosis.causes:
        if not (cause.doubt.tested or cause.misshapen):
            found = _form(diagnosis, cause, data)
            if found is not None:
                yield found


def _form(diagnosis: Diagnosis, cause: Cause, data: tuple[Array, Array]) -> CauseForm | None:
    model, q = diagnosis.after.model, diagnosis.data.poses.q
    own = np.setdiff1d(positions(model, cause.named.candidate.effect), model.tunings)
    joints = np.flatnonzero(np.ptp(q, axis=0) > 0.0)
    if not len(joints) or not len(own):
        return None
    r, rows = data
    p, K = len(diagnosis.after.values), _WAVES * len(joints)
    moving = diagnosis.after.values[own]

    def beside(rows: Array, at: Array) -> Array:
        run = np.concatenate([waves(model.robot, at, q, int(k)) for k in joints], axis=1)
        moved = rows[..., own] @ moving
        # What only rivals have is none of this question.
        return np.concatenate([rows[..., :p], moved[..., None] * run[:, None, :]], axis=-1)

    columns = beside(rows.reshape(len(q), -1, rows.shape[1]), q).reshape(len(r), -1)
    known, by_known = model.prior_residuals(diagnosis.after.values)
    columns = np.concatenate([columns, np.pad(by_known, ((0, 0), (0, K)))])
    sizes = np.concatenate([model.sizes, np.ones(K)])
    evidence = RivalEvidence.of(columns, np.append(r, known), sizes, [np.arange(p, p + K)], ())
    robot, where = model.robot, cause.named.candidate.where
    chances = np.array([chance_of(robot, robot.joints[k], where) for k in joints])
    alpha = SHAPE_ALPHA / max(1, len(diagnosis.causes))
    return CauseForm(cause.named.candidate.key, beside, evidence, chances, alpha)


@dataclass(frozen=True, eq=False)
class Accuracy:
    """The expected error at the targets; its value is less the logarithm of its RMS.

    Z : ndarray, shape (p, n), from whitened rows to coordinates of the equations; p of the user's model
    aims : ndarray, shape (n, k), m: ``tr(aims^T P aims)`` is the mean square

    The aims stand as columns that no reading shows: what is modelled imitates them by ``P aims``, and
    their Gram matrix is what the mean square has fallen by.
    """

    Z: Array
    aims: Array

    @property
    def data(self) -> ReducedEquations:
        n, k = self.aims.shape
        return ReducedEquations(np.eye(n), self.aims, np.zeros((k, k)), np.zeros(k), 0)

    def blocks(self, rows: Array, q: Array) -> Array:
        del q
        own = rows[..., : len(self.Z)] @ self.Z
        return np.concatenate([own, np.zeros((*own.shape[:-1], self.aims.shape[1]))], axis=-1)

    def values(self, known: ReducedEquations, S: Array) -> Array:
        del known
        square = (self.aims**2).sum() - np.trace(S, axis1=-2, axis2=-1)
        return np.asarray(-0.5 * np.log(square))[..., None]


def accuracy_of(situation: Situation, diagnosis: Diagnosis, rows: Array) -> Accuracy:
    """At the targets of the cell, after the data with independent rows (N, p), for the user's model."""
    model = diagnosis.stage.model
    p, values = len(model.parameters), diagnosis.after.values[: len(model.parameters)]
    targets, weights = targets_of(situation.cell)
    at = TargetErrors.of(model, values, targets, weights).per(model.sizes)
    aims = (at.rows * np.sqrt(at.weights)[:, None, None]).reshape(-1, p)
    held = model.prior_residuals(values)[1] * model.sizes
    known = np.concatenate([rows[:, :p] * model.sizes, held, np.eye(p) / FREE])
    inverse = np.linalg.inv(np.linalg.qr(known, mode="r"))
    # As many rows as parameters say the same of so many targets.
    root = np.asarray(np.linalg.qr(aims @ inverse, mode="r"))
    return Accuracy(model.sizes[:, None] * inverse, root.T)


@dataclass(frozen=True, eq=False)
class CompoundCriterion:
    """A compound criterion: the mean efficiency for telling causes apart, and for accuracy.

    Each is the share of what poses for it alone would reach. The accuracy is the last objective.
    now, best : values of the two, with the data and at best
    """

    now: tuple[float, float]
    best: tuple[float, float]

    def of(self, values: Sequence[Array]) -> tuple[Array, Array]:
        """Both shares of the values of all objectives (..., k), shape (...)."""
        reached = worst(values[:-1]), values[-1][..., 0]
        first, second = (
            (own - now) / max(best - now, 1e-9)
            for own, now, best in zip(reached, self.now, self.best, strict=True)
        )
        return np.asarray(first), np.asarray(second)

    def __call__(self, values: Sequence[Array]) -> Array:
        """The mean of both."""
        first, second = self.of(values)
        return np.asarray(0.5 * (first + second))


def with_accuracy(search: PoseSearch, accuracy: Accuracy, count: int) -> PoseSearch:
    """The search for causes and accuracy together."""
    alone = replace(search, objectives=(accuracy,), weigh=lambda values: values[-1][..., 0])
    both = replace(search, objectives=(*search.objectives, accuracy))
    ends = search.value(search.best_plan(count)), alone.value(alone.best_plan(count))
    return replace(both, weigh=CompoundCriterion((search.value(()), alone.value(())), ends))
