"""Where the parts of a gap sit, and what each depends on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.diagnosis.contest import Entry, Outcome
from calib.diagnosis.diagnosis import Cause, Place
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import ARM

_ALONE = 0.9  # of what scatters, that one joint must hold to be named in place of the arm


def located(
    stage: Stage,
    outcome: Outcome,
    after: Fit,
    causes: Sequence[Cause],
    scale: float,
    left: bool,
) -> tuple[Place, ...]:
    """Places of all that was found, largest share first.

    left : whether more remains than such an arm scatters by
    """
    found = [
        Place(c.named.candidate.where, c.named.candidate.depends_on, c.share)
        for c in causes
        if not c.displaced
    ]
    for c in causes:
        if c.misshapen:
            part = min(1.0, c.doubt.fall / max(c.named.entry.score.fall, 1e-9))
            share = c.share if c.displaced else part * c.share
            place = Place(c.named.candidate.where, c.doubt.depends_on, share)
            if (place.where, place.depends_on) not in {(p.where, p.depends_on) for p in found}:
                found.append(place)
    for entry in outcome.entries:
        if not entry.candidate.named:
            share = share_of(outcome, after, entry, scale)
            found.append(Place(entry.candidate.where, entry.candidate.depends_on, share))
    if left and (after.variances.configuration.any() or not found):
        # Beside a cause its share is undefined: it is no effect that could be taken out again.
        share = np.nan if found else _unfollowed(outcome, after)
        found.append(Place(_scattering(stage, after), "pose", share))
    return tuple(sorted(found, key=lambda place: -np.nan_to_num(place.share)))


def share_of(outcome: Outcome, after: Fit, entry: Entry, scale: float) -> float:
    """By how much the sum of squares would rise without it, over its excess before; NaN without one.

    scale : float, actual over stated standard deviation; the noise left beside the estimated parameters
        is what it says, or less where less is left
    """
    before, left = (float((fit.r**2).sum()) for fit in (outcome.before, after))
    rows = int(np.count_nonzero(np.abs(after.J).sum(axis=-1)))
    excess = before - min(left, (rows - after.spent) * scale**2)
    return entry.fall / excess if excess > 0.0 else np.nan


def _scattering(stage: Stage, after: Fit) -> str:
    """The joint that nearly all comes from which differs from pose to pose; else the arm."""
    variances, robot = after.variances.configuration, after.model.robot
    each = [
        float(stage.scatter.point_variance(variances * (np.arange(len(variances)) == k)).mean())
        for k in range(len(variances))
    ]
    first = int(np.argmax(each))
    alone = first < robot.dof and each[first] > _ALONE * sum(each)
    return robot.joints[first] if alone else ARM


def _unfollowed(outcome: Outcome, after: Fit) -> float:
    """Share of the gap that differs from pose to pose and that nothing found follows."""
    before, left = (float((fit.r**2).sum()) for fit in (outcome.before, after))
    dof = int(np.count_nonzero(np.abs(after.J).sum(axis=-1))) - after.spent
    noise = dof * after.variances.scale**2
    return max(left - noise, 0.0) / (before - noise) if before > noise else np.nan
