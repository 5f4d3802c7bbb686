"""The readings that were repeated in words and as a table."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from studies.document import HOURS, TENTH, THREE, Column, P, Section, Sentence, Table
from studies.identify.drift import Drift, Motion, Rate, Reference
from studies.identify.record import IdentifyRecord
from studies.record import Three

_MOST = 8  # readings that the terminal shows
_MODELLED = ("base_drift", "tracker_drift")
_AGAIN: tuple[Column[tuple[Motion, Reference]], ...] = (
    Column("read again", lambda row: row[0].pose),
    Column("first", lambda row: row[1].pose),
    Column("since", lambda row: row[0].hours, HOURS, "h"),
    Column("moved x, y, z", lambda row: row[0].translation_um, THREE, "um"),
    Column("std", lambda row: _rms(row[0].translation_std_um), TENTH, "um"),
    Column("turned", lambda row: row[0].rotation_urad, THREE, "urad"),
    Column("std", lambda row: _rms(row[0].rotation_std_urad), TENTH, "urad"),
    Column("distance", lambda row: row[0].length_um, TENTH, "um"),
    Column("p", lambda row: row[0].p_value, P),
)


def drift_section(record: IdentifyRecord) -> Iterator[Section]:
    """How far poses that were read again had moved; nothing without them."""
    drift = record.drift
    if drift is None:
        return
    rows = [(motion, one) for one in drift.references for motion in one.moved]
    table = Table(_AGAIN, rows, "Poses read again", of_poses=True, most=_MOST)
    yield Section(
        "drift", "Did the setup move between repeated poses?", (table, *_moved(record, drift))
    )


def _moved(record: IdentifyRecord, drift: Drift) -> Iterator[Sentence]:
    count, p = len(drift.references), P(drift.p_value)
    of = f", {count} repeated poses together" if count > 1 else ""
    if drift.verdict == "steady":
        said = f"none: the readings differ by the noise of instrument and arm (p {p}{of})"
    elif drift.verdict == "drift":
        said = f"yes: a steady motion (p {P(drift.trend_p)}{of})"
    else:
        said = f"not steady, but the readings moved by more than instrument and arm do (p {p}{of})"
    yield Sentence(said, "good" if drift.verdict == "steady" else "warn", "drift")
    if drift.verdict == "drift":
        yield from map(_rate, drift.rates)
    if drift.noise_factor != 1.0:
        yield Sentence(
            f"single points scatter by {TENTH(drift.noise_factor)} times the noise of the cell"
        )
    if drift.verdict != "steady":
        yield from _to_do(record, drift)


def _rate(rate: Rate) -> Sentence:
    shift, turn = (
        " ".join(map(TENTH, values))
        for values in (rate.translation_um_per_h, rate.rotation_urad_per_h)
    )
    shift_std = TENTH(_rms(rate.translation_std_um_per_h))
    turn_std = TENTH(_rms(rate.rotation_std_urad_per_h))
    return Sentence(
        f"{shift} um/h and {turn} urad/h in station {rate.station} (std {shift_std} and {turn_std})"
    )


def _rms(values: Three | None) -> float | None:
    return None if values is None else float(np.sqrt(np.mean(np.square(values))))


def _to_do(record: IdentifyRecord, drift: Drift) -> Iterator[Sentence]:
    if not drift.one_side:
        yield Sentence(
            "the approach directions differ, so it may be backlash. Come from one side each time"
        )
    modelled = [p.effect for p in record.parameters if p.effect in _MODELLED]
    if drift.verdict == "moved":
        yield Sentence(
            "something was knocked or is loose, or the readings are too few for a trend. If one row "
            "above stands out, measure again from there"
        )
    elif modelled:
        yield Sentence(f"{modelled[0]} of the model takes it up where it is steady")
    elif not drift.rates:
        yield Sentence(
            "add column time_s, and base_drift to [model] effects. Or measure again when all is warm"
        )
    else:
        yield Sentence(
            "add base_drift to [model] effects (a drift of the instrument looks the same), or measure "
            "again when all is warm. Run `posecal diagnose` to find the cause"
        )
