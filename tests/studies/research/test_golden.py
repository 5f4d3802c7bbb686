"""A comparison of golden results finds what moved, and nothing else."""

from __future__ import annotations

from typing import Any

import pytest

from studies.research.golden import differences

OLD = {"rms_mm": {"heldout": 0.058}, "effects": [{"where": "A2", "std": 1e-3}], "seconds": 3.0}


@pytest.mark.parametrize(
    ("new", "kinds"),
    [
        (OLD, []),
        ({**OLD, "seconds": 9.0}, []),
        ({**OLD, "rms_mm": {"heldout": 0.058 * (1.0 + 1e-13)}}, []),
        ({**OLD, "rms_mm": {"heldout": 0.058 * (1.0 + 1e-9)}}, ["value"]),
        ({**OLD, "rms_mm": {"heldout": None}}, ["value"]),
        ({**OLD, "effects": []}, ["value"]),
        ({**OLD, "effects": [{"where": "A3", "std": 1e-3}]}, ["value"]),
        ({**OLD, "effects": [{"where": "A2"}]}, ["key"]),
    ],
)
def test_what_moved_is_found(new: dict[str, Any], kinds: list[str]) -> None:
    assert [kind for kind, _ in differences(OLD, new, 1e-12)] == kinds
