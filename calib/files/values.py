"""Identified values, read back from a result."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from calib.effects.protocol import Parameter
from calib.errors import InputError


def load_values(path: Path, parameters: Sequence[Parameter]) -> dict[str, float]:
    """Values in SI by parameter id, from the JSON of ``posecal identify``.

    parameters : of the model at hand; the result must know each of them, in the same unit

    Raises InputError.
    """
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
        found = {entry["id"]: (entry["value"], entry["unit"]) for entry in result["parameters"]}
    except OSError as error:
        raise InputError(path, "", f"cannot be read ({error.strerror})") from None
    except (ValueError, TypeError, KeyError):
        raise InputError(
            path, "", "is not a result of posecal identify", "write one with identify --json"
        ) from None
    values = {}
    for p in parameters:
        value, unit = found.get(p.id, (None, None))
        if not isinstance(value, int | float) or unit != p.unit:
            raise InputError(
                path,
                f"parameter {p.id}",
                f"has no value in {p.unit}",
                "identify with the same [model], knots included",
            )
        values[p.id] = value * p.scale
    return values
