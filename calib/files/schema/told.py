"""``[report]``: lines that a reader is told as they stand."""

from __future__ import annotations

from datetime import date, time
from typing import Annotated, Any

from pydantic import AfterValidator

_LONGEST_TEXT = 300


def _told(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, str | int | float | date | time):
        raise ValueError("is no text, number or date")
    if len(str(value)) > _LONGEST_TEXT or not str(value).isprintable():
        raise ValueError(f"is no line of text, of {_LONGEST_TEXT} characters at most")
    return value


Told = Annotated[Any, AfterValidator(_told)]
"""What a reader is told as it stands."""
