"""The errors before and after in words, tables and figures, and the poses that stand out."""

from __future__ import annotations

from collections.abc import Iterator
from operator import attrgetter, itemgetter
from typing import Any

import numpy as np

from studies.document import COUNT, MM, MRAD, Column, Detail, Figure, Part, Sentence, Table, mm
from studies.identify.errors import Model, OfInstrument
from studies.identify.outliers import Outlier, Share
from studies.identify.pictures import (
    distances,
    errors_by_pose,
    errors_over_image,
    residuals_by_pose,
)
from studies.identify.point_errors import point_errors
from studies.identify.record import IdentifyRecord

_MOST = 8  # outliers that the terminal shows
_MODELS: dict[Model, str] = {
    "nominal": "fitted poses, nominal model",
    "fitted_all": "fitted poses, identified",
    "fitted": "fitted poses without outliers, identified",
    "heldout": "held-out poses, identified",
    "heldout_trimmed": "held-out poses without outliers, identified",
}
_FIGURES: tuple[Column[Any], ...] = tuple(
    Column(title, itemgetter(k), MM, "mm") for k, title in enumerate(("RMS", "p95", "max"), 1)
)
_ERRORS = (Column("distance measured - predicted", itemgetter(0)), *_FIGURES)
_PAIRS = (
    Column("distance between two poses", itemgetter(0)),
    *_FIGURES,
    Column("pairs", itemgetter(4), COUNT),
)
_OF_INSTRUMENTS: tuple[Column[OfInstrument], ...] = (
    Column("instrument", attrgetter("instrument")),
    Column("unit", attrgetter("unit")),
    Column("nominal", attrgetter("nominal"), MRAD),
    Column("identified", attrgetter("fitted_all"), MRAD),
    Column("held out", attrgetter("heldout"), MRAD),
)
_OUTLIERS: tuple[Column[tuple[Outlier, str]], ...] = (
    Column("pose", lambda row: row[0].pose),
    Column("what became of it", lambda row: row[1]),
    Column("reason", lambda row: row[0].reason),
)


def told_errors(record: IdentifyRecord) -> Iterator[Part]:
    """How far the readings were off and are now, by model, by instrument and pose by pose."""
    floor = mm(3.0**0.5 * record.noise.instrument_mm)
    caption = f"Distances in space; the instrument alone would leave {floor} RMS"
    if rows := list(_models(record)):
        yield Table(_ERRORS, rows, "Errors by model", caption)
        yield Figure(lambda: distances(record))
    if len(record.instruments) > 1 or not rows:
        caption = "Root mean squares; of whole poses, the length of the translation and of the turn"
        yield Table(_OF_INSTRUMENTS, record.instruments, "Errors by instrument", caption)
    every = {**_MODELS, "fitted": _MODELS["fitted_all"]}
    pairs = [
        (every[key], own.rms, own.p95, own.max, own.pairs)
        for key, own in record.pair_distances_mm.items()
    ]
    caption = (
        "Distances between points of two poses, measured minus predicted: a check that depends on no "
        "frame, since distances are the same wherever the instrument stands"
    )
    yield Detail((Table(_PAIRS, pairs, "Distances between two poses", caption),) if pairs else ())
    yield from _outliers(record)
    if any(row.at_px is not None for row in record.residuals):
        yield Figure(lambda: errors_over_image(record))
    if not rows:
        return
    yield Figure(lambda: errors_by_pose(record))
    yield Figure(lambda: residuals_by_pose(record, heldout=False))
    if record.rms_mm.heldout is not None:
        yield Figure(lambda: residuals_by_pose(record, heldout=True))
    yield Detail(
        (Table(_POSES, _by_pose(record), "Errors pose by pose", of_poses=True, fold=True),)
    )


def _models(record: IdentifyRecord) -> Iterator[tuple[Any, ...]]:
    trimmed = {"fitted": record.outliers, "heldout_trimmed": record.heldout_outliers}
    for key, label in _MODELS.items():
        if key == "heldout" and record.nominal_at_heldout_mm is not None:
            yield "held-out poses, nominal model", *_nominal_at_heldout(record)
        row = [getattr(figures, key) for figures in (record.rms_mm, record.p95_mm, record.max_mm)]
        if row[0] is not None and trimmed.get(key, True):
            yield label, *row


def _nominal_at_heldout(record: IdentifyRecord) -> tuple[float, float, float]:
    """RMS, 95th percentile and largest distance, mm."""
    rows = [row for row in record.residuals if row.heldout and row.metric]
    lengths = np.array([np.linalg.norm(row.before) for row in rows])
    rms = float(np.sqrt(np.mean(lengths**2)))
    return rms, float(np.quantile(lengths, 0.95)), float(lengths.max())


def _outliers(record: IdentifyRecord) -> Iterator[Part]:
    rows = [(entry, "left out of the fit") for entry in record.outliers]
    rows += [(entry, "held out") for entry in record.heldout_outliers]
    if not rows:
        yield Detail((Sentence("No pose was rejected.", "good"),))
        return
    yield Table(_OUTLIERS, rows, "Poses that stand out", "Poses that stand out", True, _MOST)
    if record.outliers_share is not None:
        yield Detail((Sentence(_shared(record.outliers_share), "warn"),))


def _shared(share: Share) -> str:
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


_POSES: tuple[Column[Any], ...] = (
    Column("pose", itemgetter(0)),
    Column("RMS before", itemgetter(1), MM, "mm"),
    Column("RMS after", itemgetter(2), MM, "mm"),
    Column("markers seen", itemgetter(3), COUNT),
    Column("use", itemgetter(4)),
)


def _by_pose(record: IdentifyRecord) -> list[tuple[Any, ...]]:
    found = point_errors(record)
    before, after = (1e3 * found.by_pose(errors) for errors in (found.before, found.after))
    use = ["held out" if held else "fitted" for held in found.heldout]
    seen = found.seen.sum(axis=1).tolist()
    return list(zip(found.poses, before, after, seen, use, strict=True))
