"""What ``[gravity]``, ``[payload]`` and ``[load]`` pull at the arm with."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator, Field

from calib.files.schema.values import NotNegative, Number, Table, Vector

_HEAVIEST = 2500.0  # kg: the largest arms on the market carry 2300
_PULLS_MOST = 30.0  # m/s^2
_STANDARD = 9.80665
_GRAVITIES = {"cm/s^2": 100.0, "mm/s^2": 1000.0, "ft/s^2": 3.28084, "in/s^2": 39.3701}


def _mass(kilograms: float) -> float:
    if kilograms > _HEAVIEST:
        grams = f"; if these are grams, write {kilograms / 1e3:g}"
        raise ValueError(f"no arm carries so many kilograms{grams}")
    return kilograms


def _gravity(m_s2: tuple[float, float, float]) -> tuple[float, float, float]:
    pull = math.hypot(*m_s2)
    if pull > _PULLS_MOST:
        unit = min(_GRAVITIES, key=lambda u: abs(math.log(pull / _GRAVITIES[u] / _STANDARD)))
        raise ValueError(
            f"is no gravity in m/s^2; if it is in {unit}, divide by {_GRAVITIES[unit]:g}"
        )
    return m_s2


Mass = Annotated[NotNegative, AfterValidator(_mass)]


class GravityTable(Table):
    m_s2: Annotated[Vector, AfterValidator(_gravity)] = (0.0, 0.0, -9.80665)


class PayloadTable(Table):
    mass_kg: Mass = 0.0
    com_mm: Vector = (0.0, 0.0, 0.0)


class LoadTable(Table):
    mass_kg: Mass
    com_mm: Vector
    max_tilt_deg: Annotated[Number, Field(ge=0, le=90)] = 90.0
