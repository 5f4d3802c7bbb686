"""Faults of instruments and what they look at: named where they are, none where nothing is wrong."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cv2", exc_type=ImportError)

import calib
from tests.day import Sizes, day
from tests.instrument_days import SITES

MOVED = (5e-4, -3e-4, 2e-4, 3e-4, -2e-4, 4e-4)
TURNED = (4e-4, 3e-4, -2e-4, 1e-3, -8e-4, 5e-4)
TIP, WORLD = "camera on the tip", "camera in the world"
PLATE, EYE, MOCAP = "board:plate", "camera:eye", "pose:mocap"
# What moves one number a reading as a zero does, with further directions that the readings do not ask.
LIKE_IT = {"step:base", "step:marker:ball"}
# Scene, what is wrong there, by what names it is told, on what it depends, and its first parameter.
# A camera or a board in the world that was moved is, from the readings, one with a base that was.
CASES = [
    (TIP, "pitch", 3e-3, {f"board_scale:{PLATE}"}, "none", 3000.0),
    (WORLD, "focal", 3e-3, {f"focal:{EYE}"}, "none", None),
    (TIP, "camera", MOVED, {f"step:{EYE}"}, "time", None),
    (TIP, "board", TURNED, {f"step:{PLATE}", "step:base"}, "time", None),
    (WORLD, "board", TURNED, {f"step:{PLATE}"}, "time", None),
    ("sockets", "socket", (4e-4, -3e-4, 2e-4), {"step:socket:cup"}, "time", None),
    ("wire", "zero", 3e-4, {"step:distance:wire"}, "time", None),
    ("gauge", "zero", 3e-4, {"step:plane:table", "step:base"}, "time", None),
    ("6-D tracker", "camera", MOVED, {f"step:{MOCAP}"}, "time", None),
]
PLACES = {
    TIP: {EYE, PLATE},
    "6-D tracker": {MOCAP, "distance:wire"},
    "sockets": {f"socket:{site}" for site in SITES},
}


@pytest.mark.sampled
@pytest.mark.parametrize(("scene", "cause", "size", "names", "depends_on", "value"), CASES)
def test_what_is_wrong(
    scene: str, cause: str, size: Sizes, names: set[str], depends_on: str, value: float | None
) -> None:
    """By its name first, at its place, in its size; where two are one and the same, both are said."""
    cell, data, _, _ = day("kr270", cause, size, scene)
    found = calib.diagnose(cell, data)
    (own,) = found.causes
    members = [member.key for member, _ in own.named.members]
    assert members[0] in names
    assert names <= set(members) <= names | LIKE_IT
    where = own.named.candidate.where
    assert [(p.where, p.depends_on) for p in found.located] == [(where, depends_on)]
    if value is not None:
        p = own.named.candidate.effect.parameters[0]
        assert abs(own.values[0] / p.scale - value) < 4.0 * own.std[0] / p.scale


@pytest.mark.sampled
@pytest.mark.parametrize("scene", PLACES)
def test_nothing_is_wrong(scene: str) -> None:
    cell, data, _, _ = day("kr270", instrument=scene)
    found = calib.diagnose(cell, data)
    assert (found.verdict, found.causes, found.located) == ("no_gap", (), ())
    asked = (h.where for h in found.hidden if np.isfinite(h.smallest))
    places = {where for where in asked if ":" in where and not where.startswith("marker:")}
    assert places == PLACES[scene]
