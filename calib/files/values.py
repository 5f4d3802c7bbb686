"""Identified values, read back from a result."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from calib.effects.protocol import Parameter
from calib.errors import InputError
from calib.files.read import read_text

_LARGEST_FILE = 200_000_000  # bytes; residuals of every point stand in it
_LARGEST_NUMBER = 1e12  # in any unit


def load_values(path: Path, parameters: Sequence[Parameter]) -> dict[str, float]:
    """Values in SI by parameter id, from the JSON of ``posecal identify``.

    parameters : of the model at hand; the result must know each of them, in the same unit

    Raises InputError.
    """
    text = read_text(path, _LARGEST_FILE)
    try:
        result = json.loads(text)
        found = {entry["id"]: (entry["value"], entry["unit"]) for entry in result["parameters"]}
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InputError(
            path, "", "is not a result of posecal identify", "write one with identify --json"
        ) from None
    values = {}
    for p in parameters:
        value, unit = found.get(p.id, (None, None))
        if type(value) not in (int, float) or not abs(value) < _LARGEST_NUMBER or unit != p.unit:
            raise InputError(
                path,
                f"parameter {p.id}",
                f"has no value in {p.unit}",
                "identify with the same [model], knots included",
            )
        values[p.id] = value * p.scale
    return values
