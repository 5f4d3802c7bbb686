"""The poses that stand out, and what they have in common: their entries, and how they are told."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated

import numpy as np

from studies.document import Detail, Part, Sentence, Table, heads
from studies.record import OWN_UNIT, Count, Entry, From, Maybe, Number, Outlier

if TYPE_CHECKING:
    from calib.identification import Residuals
    from calib.identification.pattern import Shared

_MM = 1e3
_MOST = 8  # outliers that the terminal shows


class OutliersTogether(Entry):
    """What the outliers have in common, in the unit that it names."""

    variable: str
    low: Annotated[Number, OWN_UNIT]
    high: Annotated[Number, OWN_UNIT]
    unit: str
    poses: Annotated[Count, From("inside")]
    of_poses: Annotated[Count, From("poses")]
    outliers: Count
    of_outliers: Annotated[Count, From("of")]
    p: Number
    beyond_all_others: Maybe


def outlier_entries(part: Residuals, footprint: float) -> Iterator[Outlier]:
    """The entries of the outliers among the poses fitted or held out."""
    for i in np.flatnonzero(part.outlier):
        errors = np.where(part.channels.lengths, part.vectors[i], 0.0)
        largest = float(np.linalg.norm(errors, axis=-1).max()) * footprint * _MM
        allowed = ", and the other poses leave nothing"
        if part.limit > 0.0:
            ratio = float(np.sqrt(part.statistic[i] / part.limit))
            allowed = f", {ratio:.1f} times what the other poses allow"
        name = part.data.poses.names[i]
        yield Outlier(pose=name, reason=f"residual up to {largest:.3f} mm{allowed}")


def together_entry(common: Shared) -> OutliersTogether:
    """The entry of what outliers share."""
    beyond = common.alone / common.scale if common.alone else None
    return OutliersTogether.from_result(common, beyond_all_others=beyond)


_OUTLIERS = heads("pose", "what became of it", "reason")


def told_outliers(
    fitted: Sequence[Outlier], heldout: Sequence[Outlier], share: OutliersTogether | None
) -> Iterator[Part]:
    """The outliers with what became of them, and where they stand together."""
    rows = [(own.pose, "left out of the fit", own.reason) for own in fitted]
    rows += [(own.pose, "held out", own.reason) for own in heldout]
    if not rows:
        yield Detail((Sentence("No pose was rejected.", "good"),))
        return
    yield Table(_OUTLIERS, rows, "Poses that stand out", "Poses that stand out", True, _MOST)
    if share is not None:
        yield Detail((Sentence(_shared(share), "warn"),))


def _shared(share: OutliersTogether) -> str:
    """What outliers have in common, and what that means."""
    name = share.variable.removeprefix("q:")
    low, high = f"{share.low:.4g}", f"{share.high:.4g}"
    if share.beyond_all_others is not None:
        return (
            f"An outlier is the only pose at {name} = {high} {share.unit}, "
            f"{share.beyond_all_others:.3g} {share.unit} beyond every other: the model is extrapolated "
            "there, and may be at fault."
        )
    span = f"{low} to {high}" if low != high else low
    return (
        f"Outliers with something in common are a signal, not a fault: {share.outliers} of "
        f"{share.of_outliers} have {name} in {span} {share.unit}, where {share.poses} of "
        f"{share.of_poses} poses are (by chance {share.p:.1g}). Believe the figures over all poses, "
        "and look for what the model lacks there."
    )
