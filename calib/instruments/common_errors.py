"""Errors of a tracker that are the same at every reading of a session, and how readings follow them.

More readings do not average them out. They are considered, not estimated: lengths in error and an arm
of another size read alike (Tapley, Schutz and Born, Statistical Orbit Determination, 2004, section 6).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from calib.arrays import Array
from calib.keys import NotNegative, Number, Positive, TomlTable, form_of

_REFRACTION = 2.71e-4
"""n - 1 of air at 20 degC and 1013.25 hPa, red light; as pressure over temperature."""
_PER_KELVIN = _REFRACTION / 293.15
_PER_PASCAL = _REFRACTION / 101325.0

Columns = Callable[[Array], Array]
"""How points (..., 3) read follow it, (..., 3, b), by beams (..., 3), m, from instrument to point."""


class CommonKind(NamedTuple):
    """A kind of common error.

    source : what it is, in words; unit, scale : as the cell states it, and SI per unit
    columns : its b components, independent and alike; None where it turns gravity, not readings
    """

    source: str
    unit: str
    scale: float
    columns: Columns | None


@dataclass(frozen=True)
class CommonError:
    """One of them as a cell states it.

    key : of ``COMMON_KINDS``; stated : SI, as given; divisor : that makes it one standard uncertainty
    distribution : "normal", "rectangular", "triangular" or "arcsine"
    freedom : degrees of freedom of that uncertainty
    """

    key: str
    stated: float
    distribution: str = "normal"
    divisor: float = 1.0
    freedom: float = np.inf

    @property
    def kind(self) -> CommonKind:
        return COMMON_KINDS[self.key]

    @property
    def std(self) -> float:
        """Its standard uncertainty, SI."""
        return self.stated / self.divisor


def _range(beams: Array) -> Array:
    return np.asarray(np.linalg.norm(beams, axis=-1, keepdims=True))


def _along(beams: Array) -> Array:
    length = _range(beams)
    return np.asarray(beams / np.where(length > 0.0, length, 1.0))


def _across(beams: Array) -> Array:
    """Unit vectors of growing azimuth and elevation about the frame's z axis, shape (..., 3, 2)."""
    along = _along(beams)
    level = np.hypot(along[..., 0], along[..., 1])
    safe = np.where(level > 0.0, level, 1.0)
    azimuth = np.stack([-along[..., 1] / safe, along[..., 0] / safe, 0.0 * safe], axis=-1)
    return np.stack([azimuth, np.cross(along, azimuth)], axis=-1)


def _eccentric(beams: Array) -> Array:
    """Each circle's reading errs by the sine and the cosine of its angle, shape (..., 3, 4)."""
    level = np.hypot(beams[..., 0], beams[..., 1])  # an azimuth moves by what is level
    azimuth, elevation = (
        np.arctan2(beams[..., 1], beams[..., 0]),
        np.arctan2(beams[..., 2], level),
    )
    across, reach = _across(beams), (level[..., None], _range(beams))
    turns = [(k, f(a)) for k, a in enumerate((azimuth, elevation)) for f in (np.cos, np.sin)]
    return np.stack([across[..., k] * reach[k] * wave[..., None] for k, wave in turns], axis=-1)


COMMON_KINDS: dict[str, CommonKind] = {
    "scale_um_m": CommonKind("scale of the range", "um/m", 1e-6, lambda b: b[..., None]),
    "r0_um": CommonKind("zero of the range", "um", 1e-6, lambda b: _along(b)[..., None]),
    "transverse_um": CommonKind("offset across the beam", "um", 1e-6, _across),
    "transverse_um_m": CommonKind(
        "angle across the beam", "um/m", 1e-6, lambda b: _across(b) * _range(b)[..., None]
    ),
    "eccentricity_urad": CommonKind("eccentricity of the circles", "urad", 1e-6, _eccentric),
    "temperature_degC": CommonKind(
        "refraction, temperature of the air", "degC", 1.0, lambda b: b[..., None] * _PER_KELVIN
    ),
    "pressure_hPa": CommonKind(
        "refraction, pressure of the air", "hPa", 100.0, lambda b: b[..., None] * _PER_PASCAL
    ),
    "level_urad": CommonKind("levelling, direction of gravity", "urad", 1e-6, None),
}
"""By the key of the cell."""
DIVISORS = {"normal": 2.0, "rectangular": 3.0**0.5, "triangular": 6.0**0.5, "arcsine": 2.0**0.5}
"""By which a limit becomes one standard uncertainty (JCGM 100, 4.3); a normal one may have its own."""


class LimitTable(TomlTable):
    """A limit with its distribution, which makes a standard uncertainty."""

    limit: Positive
    """instead of a number: the largest error"""
    distribution: Literal["normal", "rectangular", "triangular", "arcsine"] = "rectangular"
    """distribution within the limits; it sets the divisor"""
    divisor: Positive | None = None
    """for a normal distribution: limit / divisor = one standard uncertainty"""
    degrees_of_freedom: Annotated[Number, Field(ge=1)] | None = None
    """degrees of freedom of the statement; infinite if absent"""

    @model_validator(mode="after")
    def _own_divisor(self) -> Self:
        if self.divisor is not None and self.distribution != "normal":
            raise ValueError(
                f"divisor of a {self.distribution} distribution is {DIVISORS[self.distribution]:.4g}; "
                "take it out, or write distribution = 'normal'"
            )
        return self


Uncertainty = Annotated[
    Annotated[NotNegative, Tag("plain")] | Annotated[LimitTable, Tag("table")],
    Discriminator(form_of),
]
"""One standard uncertainty, or a limit with its distribution."""


class CommonTable(TomlTable):
    """Errors that all readings share: their keys in a cell."""

    scale_um_m: Uncertainty = 0.0
    """error that all readings share, as one standard uncertainty or a table: length scale"""
    r0_um: Uncertainty = 0.0
    """shared error of the zero of the range"""
    transverse_um: Uncertainty = 0.0
    """shared error across the beam, at any range"""
    transverse_um_m: Uncertainty = 0.0
    """shared error across the beam, in proportion to the range"""
    eccentricity_urad: Uncertainty = 0.0
    """shared error of the angle encoders, once a turn"""
    temperature_degC: Uncertainty = 0.0  # noqa: N815
    """error of the air temperature: 0.92 um/m per kelvin by refraction"""
    pressure_hPa: Uncertainty = 0.0  # noqa: N815
    """error of the air pressure: 0.27 um/m per hectopascal"""
    level_urad: Uncertainty = 0.0
    """error of the levelling, which tilts gravity"""

    def errors(self) -> tuple[CommonError, ...]:
        """Those that are stated; a number is one standard uncertainty."""
        return tuple(_error(key, given) for key, given in self if given)


def _error(key: str, given: float | LimitTable) -> CommonError:
    scale = COMMON_KINDS[key].scale
    if not isinstance(given, LimitTable):
        return CommonError(key, given * scale)
    divisor = given.divisor or DIVISORS[given.distribution]
    freedom = given.degrees_of_freedom or math.inf
    return CommonError(key, given.limit * scale, given.distribution, divisor, freedom)
