"""Results that must not move unnoticed: of each a digest, kept in ``tests/reference/golden.json``.

    python -m tests.test_golden > tests/reference/golden.json

Most days are drawn by programs that share no code with the estimator. A digest proves nothing of them:
it says that a change of the code changed a result, and below which key of its JSON.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
import doe
from calib import Cell, Tracker
from calib.cell import Repeatability
from calib.noise import Noise
from calib.poses import poses_at
from studies import result_of
from tests.day import SMALL, anywhere, day, diagnosed
from tests.instrument_days import SCENES

Found = tuple[Cell, Any]
Digest = dict[str, tuple[int, float]]
# Of the run, and look-alikes, of which some are nearly as like as others.
UNSTEADY = {"seconds", "seconds_by_part", "version", "inputs", "sha256", "holdout", "look_alikes"}
_SMALLEST, _SHARE = 1e-7, 1e-4  # below which a number is as good as zero, and what counts as moved
_POLAR = Noise(along=4e-6, across=6e-6, along_per_m=1e-6, across_per_m=3e-6)
_TWICE: dict[str, Any] = {"index": 0, "scatter": 3e-5, "approaches": 2, "poses": 16}


def _identified(instrument: str) -> Found:
    cell, data, *_ = day(instrument=instrument)
    return cell, calib.identify(cell, data)


def _by_beam() -> Found:
    cell, data, heldout, _ = day("6R", index=1, poses=24)
    tracker = Tracker(noise=_POLAR, stands=np.array([3.0, -1.0, 0.5]))
    cell = replace(cell, instruments=(tracker,))
    return cell, calib.identify(cell, data, heldout=heldout)


def _scattering() -> tuple[Cell, calib.Measurements]:
    cell, data, *_ = day("6R", **_TWICE)
    return replace(cell, repeatability=Repeatability(2e-5, 5e-5)), data


def _identified_scattering() -> Found:
    cell, data = _scattering()
    return cell, calib.identify(cell, data)


def _loaded(**options: str) -> Found:
    cell, data, heldout, _ = day("kr270", "backlash:A3", 1e-4)
    return cell, calib.identify(cell, data, heldout=heldout, **options)


def _compensated() -> Found:
    cell, found = _identified_scattering()
    targets = poses_at(anywhere(cell, np.random.default_rng(0), 12).q * 0.8)
    return cell, calib.compensate(cell, found, targets, weights=np.arange(12.0))


def _enough() -> Found:
    cell, data = _scattering()
    return cell, doe.enough(cell, data.take(np.arange(20)), data.poses, goal=5e-5)


def _designed(criterion: str) -> Found:
    cell, _ = _scattering()
    table = anywhere(cell, np.random.default_rng(0), 80)
    return cell, doe.design(cell, poses=10, criterion=criterion, candidates=table)


def _foreseen() -> Found:
    cell, data, *_ = day("kr270")
    return cell, doe.foresee(cell, data.poses.take(np.arange(0, 60, 4)))


def _diagnosed(arm: str, cause: str, size: float, **more: Any) -> Found:
    return day(arm, cause, size, **more).cell, diagnosed(cause, size, 0, arm, **more)


CASES: dict[str, Callable[[], Found]] = {
    **{f"identify: {name}": partial(_identified, name) for name in SCENES},
    "identify: tracker by beam": _by_beam,
    "identify: an arm that scatters": _identified_scattering,
    "identify: loads": _loaded,
    "identify: loads, two steps": lambda: _loaded(method="two-step"),
    "identify: loads, full poses": lambda: _loaded(approach="pose"),
    "diagnose: backlash": lambda: _diagnosed("kr270", "backlash:A3", 1e-4),
    "diagnose: once a turn": lambda: _diagnosed("6R", "", 0.0, **SMALL),
    "compensate": _compensated,
    "enough": _enough,
    "design: task": lambda: _designed("task"),
    "design: D": lambda: _designed("D"),
    "foresee": _foreseen,
}


def digest(found: Found) -> Digest:
    """Of what stands below each key of a result's JSON: how much, and a weighted sum of it."""
    parts = json.loads(result_of(*found).to_json())
    numbers = {key: [*_numbers(own)] for key, own in parts.items() if key not in UNSTEADY}
    return {
        key: (len(own), round(float(np.cos(np.arange(len(own))) @ own), 6))
        for key, own in numbers.items()
        if own
    }


def _numbers(value: Any) -> Iterator[float]:
    """Numbers by the size of their logarithm, so that each counts by its relative change; words."""
    if isinstance(value, dict):
        for key, own in value.items():
            if key not in UNSTEADY:
                yield from _numbers(own)
    elif isinstance(value, list):
        for own in value:
            yield from _numbers(own)
    elif isinstance(value, str):
        yield zlib.crc32(Path(value).name.encode()) / 2.0**32
    elif value is not None:
        yield float(np.arcsinh(value / _SMALLEST))


def moved(old: Mapping[str, Sequence[float]], new: Digest) -> list[str]:
    """Keys below which something changed by more than a share of about 1e-4."""
    found = []
    for key in sorted(old.keys() | new.keys()):
        (many, then), (now_many, now) = (own.get(key, (0, 0.0)) for own in (old, new))
        if many != now_many or abs(then - now) > _SHARE * max(many, 1) ** 0.5:
            found.append(key)
    return found


PATH = Path(__file__).parent / "reference" / "golden.json"
KEPT = json.loads(PATH.read_text())


@pytest.mark.parametrize("name", CASES)
def test_nothing_moved(name: str) -> None:
    assert moved(KEPT[name], digest(CASES[name]())) == [], "python -m tests.test_golden, if meant"


if __name__ == "__main__":
    lines = (f'"{name}": {json.dumps(digest(case()))}' for name, case in CASES.items())
    print("{\n" + ",\n".join(lines) + "\n}")
