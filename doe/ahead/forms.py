"""Whether a cause has another form than its name's, and how surely poses would show it.

A cause that stands alone is not explained while nobody could have seen that its size runs with an angle
(:mod:`calib.diagnosis.shape`). The poses that show it are those where the cause is large and the angles
are many: the power of that test, foreseen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, stacked
from calib.diagnosis import Diagnosis
from calib.diagnosis.causes import Cause
from calib.diagnosis.shape import SHAPE_ALPHA, TESTED, chance_of, wave_power, waves
from calib.diagnosis.stage import positions
from doe.ahead.forecast import Forecast, Offer
from doe.ahead.information import Information
from doe.ahead.likeness import SURE

_WAVES = 4  # of each angle
_SURELY = 1e-12  # least probability, and greatest


@dataclass(frozen=True, eq=False)
class CauseForm:
    """The question whether a cause has the form of its name.

    columns_of : callable, rows (m, r, p) at configurations (m, dof) -> those of the fitted, and what
        the cause does times each wave over the angles of the joints, in plausible sizes
    now : Information, of the waves beside all that is modelled, after the data
    chances : ndarray, shape (joints,), what each counts; alpha : float, chance of a false doubt
    """

    key: str
    columns_of: Callable[[Array, Array], Array]
    now: Information
    chances: Array
    alpha: float

    def values(self, known: Information, S: Array) -> Array:
        """In standard deviations like those of rivals: enough of either is enough."""
        from scipy.special import ndtri

        del known
        power = np.clip(self.power(S), _SURELY, 1.0 - _SURELY)
        return np.asarray(ndtri(power) - ndtri(TESTED) + ndtri(SURE))[..., None]

    def power(self, S: Array) -> Array:
        """Probability of seeing another form, from products of the waves (..., K, K), shape (...)."""
        lengths, found = self.now.lengths, np.zeros(S.shape[:-2])
        for i, chance in enumerate(self.chances):
            at = slice(_WAVES * i, _WAVES * (i + 1))
            found += chance * wave_power(S[..., at, at], lengths[at], chance * self.alpha)
        return np.asarray(found / self.chances.sum())

    def hopeful(self, offer: Offer, start: Array) -> bool:
        """Whether all candidates together would show it."""
        blocks = self.columns_of(offer.rows(slice(None), start), offer.q)
        return bool(self.power(self.now.added(blocks).S) >= TESTED)


def forms_of(forecast: Forecast, diagnosis: Diagnosis) -> Iterator[CauseForm]:
    """Causes of which no reading would have shown another form, with what the data tell of it."""
    for cause in diagnosis.causes:
        if not (cause.doubt.tested or cause.misshapen):
            found = _form(forecast, diagnosis, cause)
            if found is not None:
                yield found


def _form(forecast: Forecast, diagnosis: Diagnosis, cause: Cause) -> CauseForm | None:
    model, q = diagnosis.after.model, diagnosis.data.poses.q
    own = np.setdiff1d(positions(model, cause.named.candidate.effect), model.tunings)
    joints = np.flatnonzero(np.ptp(q, axis=0) > 0.0)
    if not len(joints) or not len(own):
        return None
    sizes, moving = model.sizes, diagnosis.after.values[own]

    def beside(rows: Array, at: Array) -> Array:
        run = np.concatenate([waves(model.robot, at, q, int(k)) for k in joints], axis=1)
        moved = rows[..., own] @ moving
        # What only rivals have is none of this question.
        modelled = rows[..., : len(sizes)] * sizes
        return np.concatenate([modelled, moved[..., None] * run[:, None, :]], axis=-1)

    rows = stacked(beside(forecast.known.by_reading, q))
    held = forecast.known.held[:, : len(sizes)] * sizes
    held = np.pad(held, ((0, 0), (0, rows.shape[1] - len(sizes))))
    now = Information.of(np.concatenate([rows, held]), len(sizes))
    robot, where = model.robot, cause.named.candidate.where
    chances = np.array([chance_of(robot, robot.joints[k], where) for k in joints])
    alpha = SHAPE_ALPHA / max(1, len(diagnosis.causes))
    return CauseForm(cause.named.candidate.key, beside, now, chances, alpha)
