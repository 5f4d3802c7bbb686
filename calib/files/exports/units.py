"""Units of length as exports state them, and values in millimetres without a rounding."""

from __future__ import annotations

import re
from collections.abc import Iterable
from decimal import Decimal

_TO_MM = {"mm": Decimal(1), "m": Decimal("1E3"), "in": Decimal("25.4")}

_NAMES = {
    "mm": ("mm", "millimeter", "millimeters", "millimetre", "millimetres"),
    "m": ("m", "meter", "meters", "metre", "metres"),
    "in": ("in", "inch", "inches"),
}
_SPELT = {name: unit for unit, names in _NAMES.items() for name in names}
_OTHERS = ("deg", "degree", "degrees", "°", "rad", "radians", "s", "degc", "°c")
_STATED = re.compile(r"\b(?:units?|einheit(?:en)?)\b[\s:=]*[\[(]?\s*([A-Za-z]+)", re.IGNORECASE)
_IN_BRACKETS = re.compile(r"[\[(]\s*([A-Za-z]+)\s*[\])]")


def known_unit(text: str) -> str | None:
    """``mm``, ``m`` or ``in`` for any usual spelling, None for what is no such unit."""
    return _SPELT.get(text.lower())


def is_unit(text: str) -> bool:
    """Whether a field is the unit of a column and no name of one."""
    return known_unit(text.strip("[]()")) is not None or text.strip("[]()").lower() in _OTHERS


def stated_units(comments: Iterable[str]) -> set[str]:
    """Units that comment lines state, as ``Units: mm`` or, beside X, Y and Z, as ``[mm]``."""
    found = set()
    for line in comments:
        words = _STATED.findall(line)
        if {"x", "y", "z"} <= set(re.findall(r"\b[xyz]\b", line.lower())):
            words += _IN_BRACKETS.findall(line)
        found |= {unit for word in words if (unit := known_unit(word)) is not None}
    return found


def in_mm(number: str, unit: str) -> str:
    """The text of a number in millimetres: unchanged from mm, multiplied exactly from m and in.

    >>> in_mm("1.2345678901", "m"), in_mm("-2", "in"), in_mm("1.50", "mm")
    ('1234.5678901', '-50.8', '1.50')
    """
    if unit == "mm":
        return number
    return format(Decimal(number) * _TO_MM[unit], "f")
