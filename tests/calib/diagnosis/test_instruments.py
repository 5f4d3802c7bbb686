"""Faults of instruments and what they look at: named where they are, none where nothing is wrong."""

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
    along_a_wire,
    in_sockets,
    on_a_table,
    seen_from_the_tip,
    seen_from_the_world,
    with_a_body,
)
from tests.camera_days import SETUPS, Truth, kr270_day

Make = Callable[..., Day]
MOVED = (5e-4, -3e-4, 2e-4, 3e-4, -2e-4, 4e-4)
TURNED = (4e-4, 3e-4, -2e-4, 1e-3, -8e-4, 5e-4)
WORLD, TIP, SOCKETS = seen_from_the_world, seen_from_the_tip, in_sockets
WIRE, TABLE, BODY = along_a_wire, on_a_table, with_a_body


PLATE, EYE, CUP = "board:plate", "camera:eye", "socket:cup"
DRUM, GAUGE, MOCAP = "distance:wire", "plane:table", "pose:mocap"
# What moves one number a reading as a zero does, with further directions that the readings do not ask.
LIKE_IT = {"step:base", "step:marker:ball"}
# What is wrong, by what names it is told, on what it depends, and its first parameter. A camera or a
# board in the world that was moved is, from the readings, one and the same as a base that was.
CASES = {
    "pitch": (TIP, Fault(pitch=3e-3), {f"board_scale:{PLATE}"}, "none", 3000.0),
    "pitch on the tip": (WORLD, Fault(pitch=3e-3), {f"board_scale:{PLATE}"}, "none", 3000.0),
    "focal": (WORLD, Fault(focal=3e-3), {f"focal:{EYE}"}, "none", None),
    "camera on the tip": (TIP, Fault(camera=MOVED), {f"step:{EYE}"}, "time", None),
    "camera in the world": (WORLD, Fault(camera=MOVED), {f"step:{EYE}", "step:base"}, "time", None),
    "board in the world": (TIP, Fault(board=TURNED), {f"step:{PLATE}", "step:base"}, "time", None),
    "board on the tip": (WORLD, Fault(board=TURNED), {f"step:{PLATE}"}, "time", None),
    "socket": (SOCKETS, Fault(socket=(4e-4, -3e-4, 2e-4)), {f"step:{CUP}"}, "time", None),
    "zero of a wire": (WIRE, Fault(zero=3e-4), {f"step:{DRUM}"}, "time", None),
    "zero of a gauge": (TABLE, Fault(zero=3e-4), {f"step:{GAUGE}", "step:base"}, "time", None),
    "6-D tracker": (BODY, Fault(camera=MOVED), {f"step:{MOCAP}"}, "time", None),
}  # fmt: skip


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("make", "fault", "names", "depends_on", "value"), CASES.values(), ids=CASES
)
def test_what_is_wrong(
    tmp_path: Path, make: Make, fault: Fault, names: set[str], depends_on: str, value: float | None
) -> None:
    """By its name first, at its place, in its size; where two are one and the same, both are said."""
    cell, data = make(tmp_path, fault, 0)
    found = calib.diagnose(cell, data)
    (cause,) = found.causes
    members = [member.key for member, _ in cause.named.members]
    assert members[0] in names
    assert names <= set(members) <= names | LIKE_IT
    assert [(p.where, p.depends_on) for p in found.located] == [
        (cause.named.candidate.where, depends_on)
    ]
    if value is not None:
        p = cause.named.candidate.effect.parameters[0]
        assert abs(cause.values[0] / p.scale - value) < 4.0 * cause.std[0] / p.scale


@pytest.mark.sampled
@pytest.mark.parametrize("make", [TIP, BODY, WORLD, SOCKETS])
def test_nothing_is_wrong(tmp_path: Path, make: Make) -> None:
    cell, data = make(tmp_path, Fault(), 0)
    found = calib.diagnose(cell, data)
    assert (found.verdict, found.causes, found.located) == ("no_gap", (), ())
    asked = {f"{h.effect}:{h.where}" for h in found.hidden if np.isfinite(h.smallest)}
    told = (cause.partition(":")[2] for cause in asked)
    places = {where for where in told if ":" in where and not where.startswith("marker:")}
    assert places == {
        SOCKETS: {f"socket:{s}" for s in ("nest", "cup", "cone", "rim")}, BODY: {MOCAP, DRUM}
    }.get(make, {EYE, PLATE})  # fmt: skip


@pytest.mark.parametrize(
    "seeds",
    [
        pytest.param([9], marks=pytest.mark.part),
        pytest.param(range(20), marks=pytest.mark.long),
    ],
)
def test_two_cameras_at_the_level_of_noise_leave_nothing(tmp_path: Path, seeds: range) -> None:
    """Though their noise is not larger where the board looks smaller, as they are taken to have it.

    A variance enters by chance on one clean day in twenty: it is told as scatter, and is no gap. More
    than three of twenty would come once in sixty.
    """
    scatters = 0
    for seed in seeds:
        truth = Truth(np.array([0.0, 8e-4, -6e-4, 0.0, 1.1e-3, 0.0]), seed=seed, grows=False)
        found = calib.diagnose(*kr270_day(tmp_path, SETUPS["kr270, two"], truth, 30, 4))
        assert (found.verdict, found.causes) == ("no_gap", ())
        scatters += found.rest.kind != "none"
    assert scatters <= (3 if len(seeds) > 1 else 0)
