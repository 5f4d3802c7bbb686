"""Faults of cameras, boards and sockets: named where they are, and none where nothing is wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2", exc_type=ImportError)

import calib
from tests.calib.diagnosis.instrument_days import (
    Day,
    Fault,
    in_sockets,
    seen_from_the_tip,
    seen_from_the_world,
)

Make = Callable[..., Day]
MOVED = (5e-4, -3e-4, 2e-4, 3e-4, -2e-4, 4e-4)
TURNED = (4e-4, 3e-4, -2e-4, 1e-3, -8e-4, 5e-4)
WORLD, TIP, SOCKETS = seen_from_the_world, seen_from_the_tip, in_sockets


PLATE, EYE, CUP = "board:plate", "camera:eye", "socket:cup"
# What is wrong, by what names it is told, on what it depends, and its first parameter. A camera or a
# board in the world that was moved is, from the readings, one and the same as a base that was.
CASES = {
    "pitch": (TIP, Fault(pitch=3e-3), {f"board_scale:{PLATE}"}, "none", 3000.0),
    "pitch on the tip": (WORLD, Fault(pitch=3e-3), {f"board_scale:{PLATE}"}, "none", 3000.0),
    "focal": (WORLD, Fault(focal=3e-3), {f"focal_scale:{EYE}"}, "none", 3000.0),
    "by time": (WORLD, Fault(per_hour=2e-4), {f"focal_drift:{EYE}"}, "time", 200.0),
    "by heat": (WORLD, Fault(per_kelvin=1e-4), {f"focal_expansion:{EYE}"}, "temperature", 100.0),
    "camera on the tip": (TIP, Fault(camera=MOVED), {f"step:{EYE}"}, "time", None),
    "camera in the world": (WORLD, Fault(camera=MOVED), {f"step:{EYE}", "step:base"}, "time", None),
    "board in the world": (TIP, Fault(board=TURNED), {f"step:{PLATE}", "step:base"}, "time", None),
    "board on the tip": (WORLD, Fault(board=TURNED), {f"step:{PLATE}"}, "time", None),
    "socket": (SOCKETS, Fault(socket=(4e-4, -3e-4, 2e-4)), {f"step:{CUP}"}, "time", None),
    "seat": (SOCKETS, Fault(seat=(2e-4, -3e-4, 2.5e-4)), {f"socket_seat:{CUP}"}, "none", 200.0),
}
QUICK = ("pitch", "camera on the tip", "seat")


@pytest.mark.parametrize(
    ("make", "fault", "names", "depends_on", "value"),
    [
        pytest.param(*case, id=name, marks=() if name in QUICK else pytest.mark.long)
        for name, case in CASES.items()
    ],
)
def test_what_is_wrong(
    tmp_path: Path, make: Make, fault: Fault, names: set[str], depends_on: str, value: float | None
) -> None:
    """By its name, at its place, in its size; where two are one and the same, both are said."""
    cell, data = make(tmp_path, fault, 0)
    found = calib.diagnose(cell, data)
    (cause,) = found.causes
    assert {member.key for member, _ in cause.named.members} == names
    assert [(p.where, p.depends_on) for p in found.located] == [
        (cause.named.candidate.where, depends_on)
    ]
    if value is not None:
        p = cause.named.candidate.effect.parameters[0]
        assert abs(cause.values[0] / p.scale - value) < 4.0 * cause.std[0] / p.scale


@pytest.mark.parametrize(
    "make", [TIP, *(pytest.param(m, marks=pytest.mark.long) for m in (WORLD, SOCKETS))]
)
def test_nothing_is_wrong(tmp_path: Path, make: Make) -> None:
    cell, data = make(tmp_path, Fault(), 0)
    found = calib.diagnose(cell, data)
    assert (found.verdict, found.causes, found.located) == ("no_gap", (), ())
    asked = {f"{h.effect}:{h.where}" for h in found.hidden if np.isfinite(h.smallest)}
    told = (cause.partition(":")[2] for cause in asked)
    places = {where for where in told if where.startswith(("camera:", "board:", "socket:"))}
    assert places == (
        {f"socket:{s}" for s in ("nest", "cup", "cone", "rim")}
        if make is SOCKETS
        else {"camera:eye", "board:plate"}
    )
