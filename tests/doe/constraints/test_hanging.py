"""A load that hangs free, by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.arrays import Array
from calib.cell import Load
from doe.constraints import constraints_of
from tests.doe.constraints.arms import allowed, only, planar
from tests.helpers import GRAVITY


@pytest.mark.parametrize("gravity", [GRAVITY, np.array([0.0, -9.0, 0.0])])
def test_hanging_load(gravity: Array) -> None:
    """Axes about z: gravity along z leaves the tip's x axis level, gravity along y does not."""
    cell = planar(load=Load(5.0, (0, 0, 0), np.radians(30.0)), gravity=gravity)
    q = ((0, 0, 0), (29.9, 0, 0), (90, -60, 0), (30.1, 0, 0), (-40, 0, 0), (150, 0, 0), (90, 90, 0))
    level = gravity[2] != 0.0
    steep = [True, True, True, level, level, True, True]
    assert allowed(cell, *q) == steep


def test_load_that_hangs_everywhere() -> None:
    cell = planar(load=Load(5.0, (0, 0, 0)), gravity=np.array([0.0, -9.0, 0.0]))
    assert constraints_of(cell) == ()
    limited = replace(cell, load=Load(5.0, (0, 0, 0), 0.1))
    assert only(limited).name == "hanging_load"
    assert constraints_of(replace(limited, gravity=np.zeros(3))) == ()
    assert constraints_of(replace(limited, load=None)) == ()
