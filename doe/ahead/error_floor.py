"""What no further reading lowers: the arm's scatter, what the model lacks, and a trend of the day."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.compensation.estimate import Estimate, estimate_of, fitted_of
from calib.compensation.trend import trend_of
from calib.compensation.unexplained import Unexplained, Unseen, at_ends, at_held_out, scatter_at
from calib.identification import Identification
from calib.model import Model
from calib.model.covariance import task_error
from calib.poses import Poses
from calib.scatter import Variances
from calib.uncertainty.pose_to_pose import Owner, parted

_PART = 0.5  # of what the model seems to lack, that must be more than chance


@dataclass(frozen=True, eq=False)
class ErrorFloor:
    """The error at the targets that does not average away, RMS, m.

    scatter : the arm errs anew at every target; what the data do not tell from the model's lacks counts
        here
    unfollowed : what the model does not follow from pose to pose; unexplained : what it lacks beside it
    trend : how far the trend of the day will have gone when the arm comes to the targets; an_hour_on :
        and an hour later; None where no clock tells
    seen : what poses showed that the fit was without, zero where there are none
    rest_of : whose what differs from configuration to configuration is
    surely : whether what the model lacks, or half of it, is more than chance
    after : s after the last reading at which the arm comes to the targets; None where nobody says it
    at_targets : ndarray, shape (targets,), m, all of it
    hidden : what the data neither show nor rule out, for which a bound allows beside all that: scatter
        that was not found, and a trend that may be chance
    """

    scatter: float
    unfollowed: float
    unexplained: Unexplained
    trend: float
    an_hour_on: float | None
    seen: Unseen
    rest_of: Owner
    surely: bool
    after: float | None
    at_targets: Array
    hidden: float = 0.0

    @property
    def of_model(self) -> float:
        """What the model lacks, but for the trend."""
        return float(np.hypot(self.unfollowed, self.unexplained.rms))

    @property
    def rms(self) -> float:
        """All of it."""
        return float(np.linalg.norm([self.scatter, self.of_model, self.trend]))


def error_floor(
    cell: Cell, model: Model, values: Array, arm: Variances, found: Identification | None
) -> ErrorFloor:
    """What does not average away at the cell's targets.

    model, values, arm : of the whole day; found : of the data so far, None where there is none yet
    Where something is lacking, it is as much as poses miss by that the fit was without.
    """
    targets, weights = targets_of(cell)
    known = None if found is None else estimate_of(found)
    rest_of: Owner = "instrument" if known is None else known.rest_of
    own, lacks = (
        np.sqrt(scatter_at(model, values, targets, part).mean(axis=-1))
        for part in parted(arm, rest_of)
    )
    rest = Unexplained(0.0, "") if known is None else known.unexplained
    trend, an_hour_on, after = np.zeros(len(targets)), None, cell.design.targets_after
    if known is not None:
        later = replace(targets, start=known.start)
        trend, an_hour_on = (
            known.moved_on(later, after or 0.0),
            known.an_hour_on(later, after or 0.0),
        )

    def rms(errors: Array) -> float:
        return task_error(errors, weights)[0]

    seen = None
    if found is not None:
        fit, held = fitted_of(found), found.heldout
        if held is not None and held.data.seen.any():
            seen = at_held_out(fit, held.data)
        else:
            seen = at_ends(fit)
        seen = None if seen is None else seen.times(found.footprint)
    scatter = rms(np.hypot(own, lacks))
    sure = float(np.hypot(rms(lacks), rest.rms))
    if seen is not None and (scatter or rest.rms):
        beyond = float(np.sqrt(max(0.0, seen.lacking**2 - scatter**2)))
        rest = max(rest, Unexplained(beyond, seen.source), key=lambda one: one.rms)
    seen = seen or Unseen(0.0, 0.0, 0.0, "")
    part = _PART * float(np.hypot(rms(lacks), rest.rms))
    surely = seen.unexplained > 0.0 or (sure > 0.0 and sure >= part)
    lacking = ErrorFloor(
        rms(own), rms(lacks), rest, rms(trend), None if an_hour_on is None else rms(an_hour_on),
        seen, rest_of, surely, after,
        np.sqrt(own**2 + lacks**2 + rest.rms**2 + trend**2),
    )  # fmt: skip
    if found is None or known is None:
        return lacking
    hidden = None if found.unnoticed is None else found.unnoticed[1].variances
    scattered = rms(np.sqrt(scatter_at(model, values, targets, hidden).mean(axis=-1)))
    scattered = scattered if lacking.rms else max(scattered, seen.certain)
    moving = _hidden_trend(found, known, targets, weights, after)
    return replace(lacking, hidden=float(np.hypot(scattered, moving)))


def _hidden_trend(
    found: Identification, known: Estimate, targets: Poses, weights: Array, after: float | None
) -> float:
    """RMS error at targets hours after the last reading by a trend that may be chance, m.

    Zero where one is shown, which is expected then, or nobody says that the targets come later.
    """
    if not after or known.trend is not None or known.clock_unit != "s":
        return 0.0
    known = replace(known, trend=trend_of(fitted_of(found), sure=1.0))
    return task_error(known.moved_on(replace(targets, start=known.start), after), weights)[0]
