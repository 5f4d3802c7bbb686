"""Images of another moment: the joints are displaced to where their path was then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.arrays import Array
from calib.effects.lens import Distortion, Focal, LensEffect, PrincipalPoint
from calib.effects.time_offset import TimeOffset
from calib.instruments import FixedCamera
from calib.instruments.lens import Lens
from calib.poses import poses_at
from calib.poses.moves import with_moves
from studies.research.cameras import pixels
from tests.camera_cells import LENS
from tests.helpers import central_difference, random_context, random_robot

TIME = np.linspace(0.0, 20.0, 80)
DELAY = np.array([0.04])


def path(time: Array, count: int) -> Array:
    return np.sin(np.outer(time, 0.2 + 0.03 * np.arange(count)) + np.arange(count))


def effect_of() -> tuple[TimeOffset, int]:
    rng = np.random.default_rng(2)
    robot = random_robot(rng, 5)
    context = replace(random_context(rng, robot), instruments=(FixedCamera(name="cam"),))
    (where,) = TimeOffset.places(context)
    return TimeOffset.at(context, where), robot.dof


def test_joints_stand_where_the_path_was() -> None:
    effect, n = effect_of()
    poses = with_moves(poses_at(path(TIME, n), time=TIME))
    along = np.einsum(
        "nmi,ni->mn", [xi for _, xi in effect.displacements(poses, DELAY)], effect.axes
    )
    true = path(TIME + DELAY, n) - path(TIME, n)
    assert np.abs(true).max() > 5e-3
    np.testing.assert_allclose(along[1:-1], true[1:-1], atol=2e-5)


def test_its_derivative() -> None:
    effect, n = effect_of()
    poses = with_moves(poses_at(path(TIME, n), time=TIME))

    def displaced(values: Array) -> Array:
        return np.stack([xi for _, xi in effect.displacements(poses, values)], axis=-2)

    by = np.stack([xi for _, xi in effect._twists(poses, DELAY)], axis=-3)
    numeric = central_difference(displaced, DELAY, np.array([1e-3]))
    np.testing.assert_allclose(by, numeric, atol=1e-9)


def test_several_instruments_have_no_clock_of_one() -> None:
    rng = np.random.default_rng(2)
    context = random_context(rng, random_robot(rng, 5))
    both = (FixedCamera(name="a"), FixedCamera(name="b"))
    assert TimeOffset.places(replace(context, instruments=both)) == ()


# -- A lens that is not the cell's reads what OpenCV's projection with the true lens reads ---------


cv2 = pytest.importorskip("cv2", exc_type=ImportError)
WRONG = {
    Focal: np.array([6.0, -4.0]),
    PrincipalPoint: np.array([3.5, -3.0]),
    Distortion: np.array([-0.03, 0.01, 4e-4, -3e-4, 2e-3]),
}


@pytest.mark.parametrize("kind", WRONG)
def test_pixels_are_those_of_the_true_lens(kind: type[LensEffect]) -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform(-0.4, 0.4, (50, 2)), np.ones((50, 1))], axis=1)
    nominal = Lens(LENS)
    by = np.zeros(9)
    by[kind.values] = WRONG[kind]
    lens = LENS + by
    true = pixels(points, np.eye(4), lens[:2], lens[2:4], lens[4:])
    effect = kind("camera:cam", nominal)
    poses = poses_at(np.zeros((1, 6)))
    read, _, _ = effect.linearise(WRONG[kind], poses, nominal.project(points)[None])
    np.testing.assert_allclose(read[0], true, atol=1e-6)
    same, _, _ = effect.linearise(0.0 * WRONG[kind], poses, nominal.project(points)[None])
    np.testing.assert_allclose(same[0], nominal.project(points), atol=1e-6)
