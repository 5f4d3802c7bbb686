"""The errors that the nominal and the identified model leave, and the poses that stand out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import numpy as np

from studies.document import FOUR, MRAD, Detail, Part, Sentence, Shown, Table, heads, listed
from studies.fitted import Lengths, Pixels, ResidualEntry
from studies.record import Count, Entry, Maybe, NotNegative, Outlier, Three

if TYPE_CHECKING:
    from calib import Identification
    from calib.arrays import Array
    from calib.identification import Residuals
    from calib.model import Model as FittedModel

_MM = 1e3


class ErrorFigures(Entry):
    """A figure over the distances between measured and predicted points.

    nominal : base and markers fitted; fitted : without the outliers; None where there is no point, and
        everywhere where no reading is a length
    """

    nominal: NotNegative | None
    fitted_all: NotNegative | None
    fitted: NotNegative | None
    heldout: NotNegative | None
    heldout_trimmed: NotNegative | None


class OfInstrument(Entry):
    """RMS of an instrument's errors in one unit: lengths in space, and of whole poses their turns."""

    instrument: str
    unit: Literal["mm", "mrad", "px"]
    nominal: Annotated[NotNegative | None, Shown(rule=MRAD)] = None
    fitted_all: Annotated[NotNegative | None, Shown("identified", MRAD)] = None
    fitted: NotNegative | None = None
    heldout: Annotated[NotNegative | None, Shown("held out", MRAD)] = None
    heldout_trimmed: NotNegative | None = None


Model: TypeAlias = Literal["nominal", "fitted_all", "fitted", "heldout", "heldout_trimmed"]


class PairErrors(Entry):
    """Errors of the distances between points of two poses, mm."""

    rms: NotNegative
    p95: NotNegative
    max: NotNegative
    pairs: Count


class IdentifyResidual(ResidualEntry):
    """Measured minus predicted reading, by the identified and by the nominal model.

    Of a point in the instrument's frame, of one that touches a socket in the base's; of a body's pose
    in its own, turns beside it; of what reads one length that alone, d; of a camera's reading in the
    image.
    """

    beside = "nominal"
    rx_mrad: Maybe = None
    ry_mrad: Maybe = None
    rz_mrad: Maybe = None
    nominal_mm: Lengths | None = None
    nominal_px: Pixels | None = None
    nominal_mrad: Three | None = None


def distances_entry(found: Identification, figure: Callable[[Array], float]) -> ErrorFigures:
    """The entry of a figure; nothing where no reading is a length."""
    metric = found.fit.channels.metric
    known = {key: figure(d) * _MM for key, d in found.distances.items() if metric and len(d)}
    return ErrorFigures.model_validate({key: known.get(key) for key in ErrorFigures.model_fields})


def rms_of(distances: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(distances**2)))


def pair_entries(found: Identification) -> Iterator[tuple[Model, PairErrors]]:
    """The entries of the errors between points of two poses, by model."""
    from calib.identification.residuals import pair_errors
    from calib.instruments import Tracker

    fit, held = found.fit, found.heldout
    if not all(isinstance(i, Tracker) for i in found.model.instruments):
        return  # nothing else reads where a point is
    nominal = found.model.predict(found.nominal, fit.data.poses)[..., :3]
    parts: list[tuple[Model, Array]] = [
        ("nominal", pair_errors(fit.data, nominal)),
        ("fitted", pair_errors(fit.data, fit.data.points - fit.vectors[..., :3])),
    ]
    if held is not None:
        parts.append(("heldout", pair_errors(held.data, held.data.points - held.vectors[..., :3])))
    for key, errors in parts:
        if len(errors):
            mm = np.abs(errors) * _MM
            p95, most = np.quantile(mm, (0.95, 1.0)).tolist()
            yield key, PairErrors(rms=rms_of(mm), p95=p95, max=most, pairs=len(mm))


# -- poses that stand out -----------------------------------------------------------------------

_MOST_FALSE = 3  # readings that a line names
_MOST = 8  # outliers that the terminal shows


def outlier_entries(part: Residuals, model: FittedModel, footprint: float) -> Iterator[Outlier]:
    """The entries of the outliers among the poses fitted or held out."""
    for i in np.flatnonzero(part.outlier):
        name = part.data.poses.names[i]
        if (false := read_falsely(part, model, int(i))) is not None:
            yield Outlier(pose=name, reason=false)
            continue
        errors = np.where(part.channels.lengths, part.vectors[i], 0.0)
        largest = float(np.linalg.norm(errors, axis=-1).max()) * footprint * _MM
        allowed = ", and the other poses leave nothing"
        if part.limit > 0.0:
            ratio = float(np.sqrt(part.statistic[i] / part.limit))
            allowed = f", {ratio:.1f} times what the other poses allow"
        yield Outlier(pose=name, reason=f"residual up to {largest:.3f} mm{allowed}")


def read_falsely(part: Residuals, model: FittedModel, pose: int) -> str | None:
    """Which readings spoil a pose where all others of it are right; None where none does."""
    names = part.channels.names(model.marker_names)
    found = [
        f"{listed([names[j] for j in own.readings], _MOST_FALSE)} of {own.instrument} off by "
        f"{FOUR(own.off)} {own.unit}, the rest is right: a bad reading"
        for own in part.false_readings(pose)
    ]
    return "; ".join(found) or None


_OUTLIERS = heads("pose", "what became of it", "reason")


def told_outliers(fitted: Sequence[Outlier], heldout: Sequence[Outlier]) -> Iterator[Part]:
    """The outliers with what became of them."""
    rows = [(own.pose, "left out of the fit", own.reason) for own in fitted]
    rows += [(own.pose, "held out", own.reason) for own in heldout]
    if not rows:
        yield Detail((Sentence("No pose was rejected.", "good"),))
        return
    yield Table(_OUTLIERS, rows, "Poses that stand out", "Poses that stand out", most=_MOST)
