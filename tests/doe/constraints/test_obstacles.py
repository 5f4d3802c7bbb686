"""The arm against what stands in the cell, by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from calib.arm.robot import Shapes
from doe.constraints import constraints_of
from tests.doe.constraints.arms import LINK, allowed, only, planar
from tests.helpers import designed


@pytest.mark.parametrize(
    ("obstacle", "name"),
    [
        (
            {
                "type": "box",
                "center_mm": (0, 2500, 0),
                "size_mm": (2000, 200, 200),
                "rpy_deg": (0, 0, 90),
            },
            "obstacle 1 (box)",
        ),
        ({"type": "sphere", "center_mm": (0, 2500, 0), "radius_mm": 1000}, "obstacle 1 (sphere)"),
        (
            {"type": "halfspace", "point_mm": (7, 1500, 7), "normal": (0, 3, 0)},
            "obstacle 1 (halfspace)",
        ),
    ],
)
def test_obstacles(obstacle: dict[str, Any], name: str) -> None:
    """All three begin 1.5 m from the base along y: two links reach it, less than 1.4 m does not."""
    cell = designed(planar(2, shapes=Shapes({"j1": (LINK,), "j2": (LINK,)})), obstacle=[obstacle])
    assert only(replace(cell, shapes=Shapes({"j2": (LINK,)}))).name == name
    found = allowed(cell, (90, 0), (90, 180), (-90, 0), (90, 90), (90, 70), (90, 66))
    # One metre up and then 1 m at 20 or 24 degrees: 0.34 or 0.41 m further up, 0.1 m thick.
    sideways = obstacle["type"] == "halfspace"
    assert found == [False, True, True, True, True, not sideways]


def test_base_may_touch_obstacles() -> None:
    floor = {"type": "halfspace", "point_mm": (0, 0, -50), "normal": (0, 0, -1)}
    on_floor = designed(planar(shapes=Shapes({"base": (LINK,)})), obstacle=[floor])
    assert constraints_of(on_floor) == ()
    touching = replace(on_floor, shapes=Shapes({"base": (LINK,), "j1": (LINK,)}))
    assert allowed(touching, (0, 0, 0)) == [False]
