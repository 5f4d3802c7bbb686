"""The curve of a located error against what was put in."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from calib.diagnosis import Diagnosis, error_curve
from calib.diagnosis.error_curve import ErrorCurve, frame_of
from tests.day import diagnosed

pytestmark = pytest.mark.long


@cache
def found(effect: str, values: tuple[float, ...]) -> tuple[Diagnosis, ErrorCurve]:
    result = diagnosed(effect, values, 5)
    kind, where = effect.split(":")
    (cause,) = result.causes
    assert (cause.named.candidate.effect.kind, cause.named.candidate.where) == (kind, where)
    curve = error_curve.error_curve(result, cause.named.candidate)
    assert curve is not None
    return result, curve


HALF = 60e-6


HARMONIC = (150e-6, -100e-6, 0.0, 0.0)


def test_lost_motion_is_twice_its_half_width_whatever_the_offset() -> None:
    _, curve = found("backlash:A3", (HALF,))
    assert curve.absorbed == 1  # a constant error of the joint is one of geometry
    low, high = curve.value[[0, -1], 0]
    assert (curve.knots[0], curve.knots[-1]) == (-1.0, 1.0)
    error = high - low - 2.0 * HALF
    assert abs(error) < 4.0 * (curve.std[0, 0] + curve.std[-1, 0])
    assert curve.std[[0, -1]].max() < 0.1 * HALF
    assert curve.function == (True,)


def test_a_curve_follows_the_truth_within_its_band() -> None:
    result, curve = found("transmission_harmonic:A4", HARMONIC)
    q = result.data.poses.q[:, 3]
    truth = HARMONIC[0] * np.cos(q) + HARMONIC[1] * np.sin(q)
    # Both without what nothing but their difference shows: a constant.
    off = curve.at_poses[:, 0] - truth
    off = off - np.average(off, weights=curve.std_at_poses[:, 0] ** -2)
    h = np.diff(curve.knots)[0]
    interpolated = h**2 / 8.0 * np.hypot(*HARMONIC[:2])  # error of a line through knots
    assert np.abs(off).max() < interpolated + 4.0 * curve.std_at_poses.max()
    assert np.std(off) < 0.35 * np.std(truth)


def test_the_effect_is_drawn_as_fitted_but_for_what_is_absorbed() -> None:
    result, curve = found("transmission_harmonic:A4", HARMONIC)
    q, a = result.data.poses.q[:, 3], result.causes[0].values
    fitted = a[0] * np.cos(q) + a[1] * np.sin(q) + a[2] * np.cos(2 * q) + a[3] * np.sin(2 * q)
    gone = fitted - curve.effect[:, 0]
    # What is taken out is itself a line through the knots, here nearly a constant.
    assert np.ptp(gone) < 0.1 * np.ptp(fitted)


def test_each_pose_by_itself_scatters_around_the_curve() -> None:
    _, curve = found("backlash:A3", (HALF,))
    rest = curve.single - curve.at_poses
    assert abs(np.mean(rest)) < 0.05 * HALF
    assert np.isfinite(rest).all()


def test_tilts_across_a_joint_and_loads() -> None:
    _, curve = found("bearing_compliance:A3", (40e-9,))
    assert curve.directions.shape == (6, 2)
    np.testing.assert_allclose(curve.directions.T @ curve.directions, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(curve.directions[:3], 0.0)
    assert curve.load is not None
    slope = np.polyfit(curve.variable, curve.effect[:, 0], 1)[0]
    assert slope == pytest.approx(40e-9, rel=0.25)
    assert curve.function[0]
    assert not curve.function[1]  # the other tilt has a moment of its own


def test_places_without_a_single_frame_have_no_curve() -> None:
    result, _ = found("backlash:A3", (HALF,))
    robot = result.after.model.robot
    assert [frame_of(where, robot) for where in ("base", "A1", "A6", "tool")] == [0, 1, 6, 7]
    assert [frame_of(where, robot) for where in ("arm", "instrument", "payload")] == [None] * 3
