"""Whether readings would show that a cause has another form than its name says, as poses are added.

A cause that stands alone is not explained while nobody could have seen that its size runs with an angle
(:mod:`calib.diagnosis.shape`). The poses that show it are those where the cause is large and the angles
are many: the power of that test, foreseen.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, IntArray
from calib.diagnosis import Diagnosis
from calib.diagnosis.causes import Cause
from calib.diagnosis.shape import SHAPE_ALPHA, TESTED, chance_of, wave_power, waves
from calib.diagnosis.stage import positions
from doe.prospect.likeness import SURE
from doe.prospect.rivals.evidence import Evidence, Known
from doe.prospect.situation import Offer

_WAVES = 4  # of each angle
_SURELY = 1e-12  # least probability, and greatest


@dataclass(frozen=True, eq=False)
class Runs:
    """How the size of an effect might run with the angles of some joints.

    over : ndarray, shape (m, dof), the data's configurations; joints : ndarray of int, those that move
    own, moving : ndarray, shape (k,), positions of the effect's parameters and their values, SI
    fitted : int, parameters that come first: what only rivals have is none of this question
    """

    robot: Robot
    over: Array
    joints: IntArray
    own: IntArray
    moving: Array
    fitted: int

    def beside(self, rows: Array, q: Array) -> Array:
        """Rows (m, r, p) at configurations (m, dof), and what the effect does times each wave."""
        run = np.concatenate([waves(self.robot, q, self.over, k) for k in self.joints], axis=1)
        moved = rows[..., self.own] @ self.moving
        return np.concatenate(
            [rows[..., : self.fitted], moved[..., None] * run[:, None, :]], axis=-1
        )


@dataclass(frozen=True, eq=False)
class Form:
    """A cause that stands alone; its value is how surely another form would be seen.

    evidence : Evidence, of the waves beside all that is modelled
    chances : ndarray, shape (joints,), what each counts; alpha : float, chance of a false doubt
    """

    key: str
    runs: Runs
    evidence: Evidence
    chances: Array
    alpha: float

    @property
    def data(self) -> Known:
        return self.evidence.data

    def added(self, known: Known, rows: Array, q: Array) -> Known:
        return known.added(self._blocks(rows[None], q[None])[0])

    def values(self, known: Known) -> Array:
        return self._margins(known.S)

    def tried(self, known: Known, rows: Array, q: Array) -> Array:
        return self._margins(known.tried(self._blocks(rows, q)))

    def power(self, S: Array) -> Array:
        """Probability of seeing another form, from products of the waves (..., K, K), shape (...)."""
        lengths, found = np.sqrt(self.data.lengths), np.zeros(S.shape[:-2])
        for i, chance in enumerate(self.chances):
            at = slice(_WAVES * i, _WAVES * (i + 1))
            found += chance * wave_power(S[..., at, at], lengths[at], chance * self.alpha)
        return np.asarray(found / self.chances.sum())

    def hopeful(self, offer: Offer, start: Array) -> bool:
        """Whether all candidates together would show it."""
        blocks = self._blocks(offer.rows(slice(None), start), offer.q)
        return bool(self.power(self.data.merged(blocks).S) >= TESTED)

    def _margins(self, S: Array) -> Array:
        """In standard deviations like those of rivals: enough of either is enough."""
        from scipy.special import ndtri

        power = np.clip(self.power(S), _SURELY, 1.0 - _SURELY)
        return np.asarray(ndtri(power) - ndtri(TESTED) + ndtri(SURE))[..., None]

    def _blocks(self, rows: Array, q: Array) -> Array:
        return self.evidence.blocks(self.runs.beside(rows, q))


def forms_of(diagnosis: Diagnosis, data: tuple[Array, Array]) -> Iterator[Form]:
    """Causes of which no reading would have shown another form, with what the data tell of it.

    data : residual (N,) and independent rows (N, p)
    """
    for cause in diagnosis.causes:
        if not (cause.doubt.tested or cause.misshapen):
            found = _form(diagnosis, cause, data)
            if found is not None:
                yield found


def _form(diagnosis: Diagnosis, cause: Cause, data: tuple[Array, Array]) -> Form | None:
    model, q = diagnosis.after.model, diagnosis.data.poses.q
    own = np.setdiff1d(positions(model, cause.named.candidate.effect), model.tunings)
    joints = np.flatnonzero(np.ptp(q, axis=0) > 0.0)
    if not len(joints) or not len(own):
        return None
    r, rows = data
    p, K = len(diagnosis.after.values), _WAVES * len(joints)
    runs = Runs(model.robot, q, joints, own, diagnosis.after.values[own], p)
    columns = runs.beside(rows.reshape(len(q), -1, rows.shape[1]), q).reshape(len(r), -1)
    known, by_known = model.beside(diagnosis.after.values)
    columns = np.concatenate([columns, np.pad(by_known, ((0, 0), (0, K)))])
    sizes = np.concatenate([model.sizes, np.ones(K)])
    evidence = Evidence.of(columns, np.append(r, known), sizes, [np.arange(p, p + K)], ())
    robot, where = model.robot, cause.named.candidate.where
    chances = np.array([chance_of(robot, robot.joints[k], where) for k in joints])
    alpha = SHAPE_ALPHA / max(1, len(diagnosis.causes))
    return Form(cause.named.candidate.key, runs, evidence, chances, alpha)
