"""Measurements from plain arrays, and a share of them that is held out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import calib
from calib import CalibError, Cell, Measurements
from calib.heldout import parted
from tests.helpers import simulated

Q, POINTS = np.zeros((4, 6)), np.zeros((4, 3, 3))


def test_arrays_are_read_as_the_table(kr270: Cell, table_two: calib.Poses) -> None:
    day = simulated(kr270, table_two, 0)[0]
    points = np.where(day.seen[..., None], day.points, np.nan)
    points[0, 1] = np.nan
    ours = Measurements.of(day.poses.q, points, sigma=1e-5, wrench=day.poses.wrench)
    assert not ours.seen[0, 1]
    assert ours.seen.sum() == day.seen.sum() - 1
    np.testing.assert_array_equal(ours.points[1:], day.points[1:])
    np.testing.assert_array_equal(
        ours.poses.approach, calib.Measurements.of(day.poses.q, points).poses.approach
    )
    found = calib.identify(kr270, ours, heldout=0.3)
    assert found.heldout is not None
    assert len(found.fit.data) + len(found.heldout.data) == len(day)
    same = calib.identify(kr270, *parted(ours, 0.3)[:1], heldout=parted(ours, 0.3)[1])
    np.testing.assert_array_equal(found.values, same.values)
    assert calib.__version__


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"q": "plan.csv"}, "q is a str, expected numbers"),
        ({"q": Q[0]}, r"q has shape \(6,\), expected 2 axes"),
        ({"q": np.full((4, 6), np.nan)}, "q has values that are not finite"),
        ({"points": POINTS[:3]}, r"points have shape \(3, 3, 3\), expected \(4, markers, 3\)"),
        ({"sigma": np.ones((4, 2))}, r"sigma has shape \(4, 2\), expected \(4, 3\) or one number"),
        ({"names": ["a"]}, "names are 1, expected 4"),
    ],
)
def test_an_argument_of_another_shape_is_named(given: dict[str, Any], said: str) -> None:
    with pytest.raises(CalibError, match=said):
        Measurements.of(**{"q": Q, "points": POINTS, **given})


@pytest.mark.parametrize("share", [0.0, 1.5, True, "0.3"])
def test_a_share_is_between_none_and_all(share: Any) -> None:
    with pytest.raises(CalibError, match="heldout"):
        parted(Measurements.of(Q, POINTS), share)
