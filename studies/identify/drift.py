"""What readings that were repeated say: in micrometres, microradians and hours."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import Field

from studies.record import Count, Entry, Maybe, NotNegative, Number, Three, three

if TYPE_CHECKING:
    from calib.drift import Drift as Moved
    from calib.drift import Motion as Step
    from calib.drift import Rate as Trend
    from calib.drift import Series

_UM = 1e6
_HOUR = 3600.0


class Motion(Entry):
    """How the markers stood at a later reading against the first; turns None where they show none."""

    pose: str
    hours: Maybe
    translation_um: Three
    translation_std_um: Three
    rotation_urad: Three | None
    rotation_std_urad: Three | None
    length_um: NotNegative
    markers: Count
    rank: Count
    p_value: Number


class Reference(Entry):
    """A configuration that was read again, by its first reading."""

    pose: str
    readings: Count
    moved: tuple[Motion, ...]
    last: str | None
    largest: str | None


class Rate(Entry):
    """Steady motion of the readings in a station's frame."""

    station: str
    translation_um_per_h: Three
    translation_std_um_per_h: Three
    rotation_urad_per_h: Three
    rotation_std_urad_per_h: Three


class Drift(Entry):
    """Whether repeated readings moved, and whether steadily."""

    verdict: Literal["steady", "drift", "moved"]
    p_value: Number
    degrees_of_freedom: Count
    trend_p: Maybe
    noise_factor: Number
    one_side: bool
    rates: tuple[Rate, ...]
    references: tuple[Reference, ...] = Field(min_length=1)


def drift_entry(found: Moved) -> Drift:
    """The entry of what was found."""
    return Drift(
        verdict=found.verdict,
        p_value=found.p,
        degrees_of_freedom=found.dof,
        trend_p=found.trend_p,
        noise_factor=found.noise_factor,
        one_side=found.one_side,
        rates=tuple(_rate(station, rate) for station, rate in found.rates.items()),
        references=tuple(map(_reference, found.series)),
    )


def _reference(series: Series) -> Reference:
    moved = tuple(map(_motion, series.motions()))
    return Reference(
        pose=series.names[0],
        readings=len(series.names),
        moved=moved,
        last=moved[-1].pose if moved else None,
        largest=max(moved, key=lambda motion: motion.length_um).pose if moved else None,
    )


def _motion(motion: Step) -> Motion:
    turns = motion.rank > 3
    return Motion(
        pose=motion.pose,
        hours=motion.time / _HOUR,
        translation_um=three(motion.shift * _UM),
        translation_std_um=three(motion.shift_std * _UM),
        rotation_urad=three(motion.turn * _UM) if turns else None,
        rotation_std_urad=three(motion.turn_std * _UM) if turns else None,
        length_um=motion.length * _UM,
        markers=motion.markers,
        rank=motion.rank,
        p_value=motion.p,
    )


def _rate(station: str, rate: Trend) -> Rate:
    scale = _UM * _HOUR
    return Rate(
        station=station,
        translation_um_per_h=three(rate.shift * scale),
        translation_std_um_per_h=three(rate.shift_std * scale),
        rotation_urad_per_h=three(rate.turn * scale),
        rotation_std_urad_per_h=three(rate.turn_std * scale),
    )
