"""What readings that were repeated say: entries in um, urad and hours, and how they are told."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from studies import document as doc
from studies.document import Shown
from studies.record import Count, Entry, From, Maybe, NotNegative, Number, Three

if TYPE_CHECKING:
    from calib.drift import DriftTest, Motion, Series


class MotionEntry(Entry):
    """How the markers stood at a later reading against the first; turns None where they show none."""

    pose: str
    hours: Annotated[Maybe, From("time")]
    translation_um: Three
    translation_std_um: Three
    rotation_urad: Three | None
    rotation_std_urad: Three | None
    length_um: NotNegative
    markers: Count
    rank: Count
    p_value: Annotated[Number, From("p")]


class RepeatedPose(Entry):
    """A configuration that was read again, by its first reading."""

    pose: str
    readings: Count
    moved: tuple[MotionEntry, ...]
    last: str | None
    largest: str | None


class DriftRate(Entry):
    """Steady motion of the readings in a station's frame."""

    station: str
    translation_um_per_h: Three
    translation_std_um_per_h: Three
    rotation_urad_per_h: Three
    rotation_std_urad_per_h: Three


class DriftEntry(Entry):
    """Whether repeated readings moved, and whether steadily."""

    verdict: Literal["steady", "drift", "moved"]
    p_value: Annotated[Number, From("p")]
    degrees_of_freedom: Annotated[Count, From("dof")]
    trend_p: Maybe
    noise_factor: Number
    one_side: bool
    rates: tuple[DriftRate, ...]
    references: tuple[RepeatedPose, ...] = Field(min_length=1)


def drift_entry(found: DriftTest) -> DriftEntry:
    """The entry of what was found."""
    return DriftEntry.from_result(
        found,
        rates=DriftRate.from_each(found.rates.values(), station=found.rates),
        references=map(_reference, found.series),
    )


def _reference(series: Series) -> RepeatedPose:
    moved = tuple(map(_motion, series.motions()))
    return RepeatedPose(
        pose=series.names[0],
        readings=len(series.names),
        moved=moved,
        last=moved[-1].pose if moved else None,
        largest=max(moved, key=lambda motion: motion.length_um).pose if moved else None,
    )


def _motion(motion: Motion) -> MotionEntry:
    turns = {} if motion.rank > 3 else {"rotation_urad": None, "rotation_std_urad": None}
    return MotionEntry.from_result(motion, **turns)


_MOST = 8  # readings that the terminal shows
_MODELLED = ("base_drift", "tracker_drift")
_AGAIN = doc.heads(
    "read again",
    "first",
    Shown("since", doc.HOURS, "h"),
    Shown("moved x, y, z", doc.THREE, "um"),
    Shown("std", doc.TENTH, "um"),
    Shown("turned", doc.THREE, "urad"),
    Shown("std", doc.TENTH, "urad"),
    Shown("distance", doc.TENTH, "um"),
    Shown("p", doc.P),
)


def drift_section(drift: DriftEntry | None, effects: Collection[str]) -> Iterator[doc.Section]:
    """How far poses that were read again had moved; nothing without them.

    effects : of the model
    """
    if drift is None:
        return
    rows = [
        (own.pose, one.pose, own.hours, own.translation_um, _rms(own.translation_std_um),
         own.rotation_urad, _rms(own.rotation_std_urad), own.length_um, own.p_value)
        for one in drift.references for own in one.moved
    ]  # fmt: skip
    table = doc.Table(_AGAIN, rows, "Poses read again", most=_MOST)
    yield doc.Section(
        "drift", "Did the setup move between repeated poses?", (table, *_moved(drift, effects))
    )


def _moved(drift: DriftEntry, effects: Collection[str]) -> Iterator[doc.Sentence]:
    count, p = len(drift.references), doc.P(drift.p_value)
    of = f", {count} repeated poses together" if count > 1 else ""
    if drift.verdict == "steady":
        said = f"none: the readings differ by the noise of instrument and arm (p {p}{of})"
    elif drift.verdict == "drift":
        said = f"yes: a steady motion (p {doc.P(drift.trend_p)}{of})"
    else:
        said = f"not steady, but the readings moved by more than instrument and arm do (p {p}{of})"
    yield doc.Sentence(said, "good" if drift.verdict == "steady" else "warn", "drift")
    if drift.verdict == "drift":
        yield from map(_rate, drift.rates)
    if drift.noise_factor != 1.0:
        yield doc.Sentence(
            f"single points scatter by {doc.TENTH(drift.noise_factor)} times the noise of the cell"
        )
    if drift.verdict != "steady":
        yield from _to_do(drift, effects)


def _rate(rate: DriftRate) -> doc.Sentence:
    shift, turn = (
        " ".join(map(doc.TENTH, values))
        for values in (rate.translation_um_per_h, rate.rotation_urad_per_h)
    )
    shift_std = doc.TENTH(_rms(rate.translation_std_um_per_h))
    turn_std = doc.TENTH(_rms(rate.rotation_std_urad_per_h))
    return doc.Sentence(
        f"{shift} um/h and {turn} urad/h in station {rate.station} (std {shift_std} and {turn_std})"
    )


def _rms(values: Three | None) -> float | None:
    return None if values is None else float(np.sqrt(np.mean(np.square(values))))


def _to_do(drift: DriftEntry, effects: Collection[str]) -> Iterator[doc.Sentence]:
    if not drift.one_side:
        yield doc.Sentence(
            "the approach directions differ, so it may be backlash. Come from one side each time"
        )
    modelled = [effect for effect in _MODELLED if effect in effects]
    if drift.verdict == "moved":
        yield doc.Sentence(
            "something was knocked or is loose, or the readings are too few for a trend. If one row "
            "above stands out, measure again from there"
        )
    elif modelled:
        yield doc.Sentence(f"{modelled[0]} of the model takes it up where it is steady")
    elif not drift.rates:
        yield doc.Sentence(
            "add column time_s, and base_drift to [model] effects. Or measure again when all is warm"
        )
    else:
        yield doc.Sentence(
            "add base_drift to [model] effects (a drift of the instrument looks the same), or measure "
            "again when all is warm. Run `posecal diagnose` to find the cause"
        )
