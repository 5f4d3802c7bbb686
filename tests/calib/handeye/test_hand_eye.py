"""Hand-eye calibration: against OpenCV, against the truth, and how often what it says is true."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arrays import Array
from calib.errors import CalibError
from calib.handeye.errors import Missed, folds, lower, missed_by, target_of
from calib.handeye.judge import ARM_AS_IT_IS, ARM_TOO
from calib.handeye.opencv import METHODS, Method, hand_eye_by, missing
from calib.handeye.samples import pairs_of
from calib.poses import poses_at
from tests.calib.handeye.days import LENS, OFF, SIGMA_PX, TILES, Arm, Kind, seen_by_opencv
from tests.plain_arm import frame

cv2 = pytest.importorskip("cv2", exc_type=ImportError)
KINDS: tuple[Kind, ...] = ("camera in hand", "camera on base", "poses")
needs_methods = pytest.mark.skipif(bool(missing()), reason="this OpenCV has no calibrateHandEye")


def samples(noise: float, count: int = 12) -> tuple[Array, Array, Array]:
    """E, F and C of a camera, plain frames."""
    rng = np.random.default_rng(3)
    E, W = (frame(rng.normal(size=6)) for _ in range(2))
    F = np.array([frame(rng.normal(size=6)) for _ in range(count)])
    C = np.linalg.inv(F @ E) @ W
    return E, F, np.array([own @ frame(noise * rng.normal(size=6)) for own in C])


@needs_methods
@pytest.mark.parametrize("method", METHODS)
def test_methods_are_those_of_opencv(method: Method) -> None:
    E, F, C = samples(0.0)
    found = hand_eye_by(method, F, C)
    assert found is not None
    np.testing.assert_allclose(found, E, atol=1e-6)
    _, F, C = samples(1e-3)
    number = getattr(cv2, f"CALIB_HAND_EYE_{method.upper()}")
    R, t = cv2.calibrateHandEye(F[:, :3, :3], F[:, :3, 3], C[:, :3, :3], C[:, :3, 3], method=number)
    found = hand_eye_by(method, F, C)
    assert found is not None
    np.testing.assert_allclose(found[:3, :3], R, atol=1e-9)
    np.testing.assert_allclose(found[:3, 3], t[:, 0], atol=1e-12)


@needs_methods
def test_a_method_without_result_says_so_and_opencv_stays_silent(
    capfd: pytest.CaptureFixture[str],
) -> None:
    still = np.tile(np.eye(4), (5, 1, 1))
    assert hand_eye_by("Tsai", still, still) is None
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("module", [None, type(sys)("cv2")])
def test_without_opencv_it_says_what_to_install(
    module: object, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if module is not None:
        monkeypatch.setattr(module, "__version__", "5.0.0", raising=False)
    monkeypatch.setitem(sys.modules, "cv2", module)
    assert "pip install 'opencv-python-headless" in missing()
    day = Arm.of(tmp_path, "poses").day(20, 1)
    found = calib.hand_eye(day.cell, day.data)
    assert found.left_out == missing()
    assert {own.method for own in found.judged} == {ARM_AS_IT_IS, ARM_TOO}


@pytest.mark.parametrize("kind", KINDS)
def test_samples_are_where_the_target_is(kind: Kind, tmp_path: Path) -> None:
    arm = Arm.of(tmp_path, kind)
    day = arm.day(12, 2, noise=0.0)
    fit = calib.identify(replace(day.cell, effects=("base", "tool")), day.data)
    (pair,) = pairs_of(day.cell, day.data, None)
    true = arm.seen(day.data.poses.q)
    predicted = pair.predicted(fit.model, fit.values, day.data.poses)
    np.testing.assert_allclose(predicted, true, atol=1e-7)
    moved = np.array([own @ frame(np.full(6, 2e-3)) for own in true])
    measured, there = pair.measured(day.data, moved)
    assert there.all()
    np.testing.assert_allclose(measured, true, atol=1e-6)
    E, by = pair.standing(fit.model, fit.values)
    np.testing.assert_allclose(E, day.E, atol=1e-7)

    def coordinates(values: Array) -> Array:
        T, _ = pair.standing(fit.model, values)
        turn = E[:3, :3].T @ T[:3, :3]
        spin = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        return np.concatenate([T[:3, 3], spin / 2.0])

    steps = 1e-6 * np.eye(len(fit.values))
    ahead, back = (np.array([coordinates(fit.values + s * own) for own in steps]) for s in (1, -1))
    np.testing.assert_allclose(by, (ahead - back).T / 2e-6, atol=1e-6)


def test_images_show_what_solve_pnp_finds(tmp_path: Path) -> None:
    arm = Arm.of(tmp_path, "camera in hand")
    day = arm.day(8, 4)
    (pair,) = pairs_of(day.cell, day.data, None)
    found, _ = pair.measured(day.data, arm.seen(day.data.poses.q))
    K = np.array([[LENS[0], 0.0, LENS[2]], [0.0, LENS[1], LENS[3]], [0.0, 0.0, 1.0]])
    for own, pixels in zip(found, day.data.readings, strict=True):
        start = cv2.Rodrigues(own[:3, :3])[0], own[:3, 3:].copy()
        _, r, t = cv2.solvePnP(TILES, pixels, K, LENS[4:], *start, True)
        # The one makes rays fit best, the other pixels: apart by less than their noise.
        np.testing.assert_allclose(own[:3, 3], t[:, 0], atol=3e-4)
        np.testing.assert_allclose(own[:3, :3], cv2.Rodrigues(r)[0], atol=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_missed_is_what_plain_formulas_say(kind: Kind, tmp_path: Path) -> None:
    arm = Arm.of(tmp_path, kind)
    day = arm.day(10, 5)
    (pair,) = pairs_of(day.cell, day.data, None)
    fit = calib.identify(replace(day.cell, effects=("base", "tool")), day.data)
    F, C = pair.carried(fit.model, day.data.poses), arm.seen(day.data.poses.q)
    E, W = arm.places
    wrong = E @ frame(np.array([1e-3, 0.0, 0.0, 0.0, 0.0, 2e-3]))
    missed = missed_by(pair, F, wrong, W, day.data, np.arange(10), C)
    predicted = np.linalg.inv(F @ wrong) @ W
    turn = [np.degrees(np.arccos((np.trace(a[:3, :3].T @ b[:3, :3]) - 1) / 2))
            for a, b in zip(predicted, C, strict=True)]  # fmt: skip
    np.testing.assert_allclose(np.degrees(missed.mrad), turn, rtol=1e-4)
    if kind == "poses":
        places = np.linalg.inv(predicted)[:, :3, 3] - np.linalg.inv(C)[:, :3, 3]
        np.testing.assert_allclose(missed.mm, np.linalg.norm(places, axis=1))
        assert missed.rms("px") is None
        return
    middle = [*TILES.mean(axis=0), 1.0]
    np.testing.assert_allclose(missed.mm, np.linalg.norm((predicted - C) @ middle, axis=1))
    off = np.array([seen_by_opencv(T) for T in predicted]) - day.data.readings
    rms = missed.rms("px")
    assert rms is not None
    assert rms.value == pytest.approx(np.sqrt(np.mean(np.sum(np.square(off), axis=-1))))
    np.testing.assert_allclose(missed.loss, np.sum(np.square(off), axis=(1, 2)) / SIGMA_PX**2)


@pytest.mark.parametrize("kind", KINDS)
def test_a_target_beside_the_true_camera_is_the_true_one(kind: Kind, tmp_path: Path) -> None:
    arm = Arm.of(tmp_path, kind)
    day = arm.day(10, 6, noise=0.0)
    (pair,) = pairs_of(day.cell, day.data, None)
    fit = calib.identify(replace(day.cell, effects=("base", "tool")), day.data)
    F, C = pair.carried(fit.model, day.data.poses), arm.seen(day.data.poses.q)
    E, W = arm.places
    near = np.array([own @ frame(np.full(6, 1e-3)) for own in C]) if kind != "poses" else C
    found = target_of(pair, F, E, day.data, near, np.ones(10, dtype=bool))
    np.testing.assert_allclose(found, W, atol=1e-7)


def test_every_configuration_is_held_out_once() -> None:
    group = np.repeat(np.arange(13), 2)
    masks = np.array(list(folds(group, 5, np.random.default_rng(0))))
    assert (masks.sum(axis=0) == 1).all()
    assert (masks[:, ::2] == masks[:, 1::2]).all()


def drawn(scale: float, count: int, rng: np.random.Generator) -> Missed:
    error = scale * np.abs(rng.normal(size=count))
    none = np.full(count, np.nan)
    return Missed(np.arange(count), np.zeros(count), np.zeros(count), error, none, error**2)


def test_less_is_less_beyond_chance_as_often_as_it_says() -> None:
    rng = np.random.default_rng(7)
    alike = [lower(drawn(1.0, 25, rng), drawn(1.0, 25, rng)) for _ in range(400)]
    assert 8 <= sum(p is not None and p < 0.05 for p in alike) <= 34
    less = [lower(drawn(0.4, 25, rng), drawn(1.0, 25, rng)) for _ in range(100)]
    assert sum(p is not None and p < 0.05 for p in less) > 85
    assert lower(drawn(0.1, 5, rng), drawn(1.0, 5, rng)) is None


def test_an_rms_lies_in_its_range_as_often_as_it_says() -> None:
    rng = np.random.default_rng(8)
    inside = 0
    for _ in range(300):
        rms = drawn(1e-3, 40, rng).rms("mm")
        assert rms is not None
        inside += rms.low <= 1.0 <= rms.high
    assert 273 <= inside <= 297


@pytest.mark.long
@pytest.mark.parametrize("kind", ["camera in hand", "poses"])
def test_an_arm_that_is_off_limits_and_one_that_is_not_does_not(kind: Kind, tmp_path: Path) -> None:
    good = Arm.of(tmp_path, kind).day(25, 9)
    found = calib.hand_eye(good.cell, good.data)
    assert not found.calibrated
    (standing,) = found.standing
    turn = standing.T[:3, :3].T @ good.E[:3, :3]
    spin = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
    off = np.concatenate([good.E[:3, 3] - standing.T[:3, 3], spin])
    assert (np.abs(off) < 4.0 * standing.std).all()
    assert (standing.half > 1.9 * standing.std).all()
    size = 12.0 if kind == "poses" else 4.0  # that a few poses of this noise show
    bad = Arm.of(tmp_path, kind, size * OFF).day(40, 10)
    found = calib.hand_eye(bad.cell, bad.data)
    assert found.calibrated
    errors = {own.method: own.missed.loss.sum() for own in found.judged}
    assert errors[ARM_TOO] < 0.5 * errors[ARM_AS_IT_IS]
    if not found.left_out:
        assert set(METHODS) <= set(errors)
        assert all(errors[method] > 1.5 * errors[ARM_TOO] for method in METHODS)


def test_held_out_poses_are_those_given(tmp_path: Path) -> None:
    arm = Arm.of(tmp_path, "poses")
    day, other = arm.day(20, 11), arm.day(9, 12)
    found = calib.hand_eye(day.cell, day.data, heldout=other.data)
    assert not found.crossed
    assert {len(own.missed.group) for own in found.judged} == {9}
    assert found.poses == 20


def test_poses_read_by_a_camera_place_the_camera_on_the_base(tmp_path: Path) -> None:
    arm = Arm.of(tmp_path, "poses")
    day = arm.day(15, 13, noise=0.0)
    found = calib.hand_eye(day.cell, day.data, eye="on-base")
    (standing,) = found.standing
    assert (standing.camera, standing.carrier) == ("board", "base")
    np.testing.assert_allclose(standing.T, arm.places[1], atol=1e-6)


def test_too_few_poses_for_the_arm_still_place_the_camera(tmp_path: Path) -> None:
    day = Arm.of(tmp_path, "poses").day(4, 14)
    found = calib.hand_eye(day.cell, day.data)
    assert found.p is None
    assert found.why
    assert not found.calibrated


def test_what_is_no_hand_eye_is_refused(tmp_path: Path) -> None:
    arm = Arm.of(tmp_path, "camera in hand")
    day = arm.day(6, 15)
    with pytest.raises(CalibError, match='the cell has it on = "tip"'):
        calib.hand_eye(day.cell, day.data, eye="on-base")
    tracker = calib.Cell(day.cell.robot, {"m1": (0.0, 0.0, 0.1)})
    data = calib.simulate(tracker, poses_at(day.data.poses.q))
    with pytest.raises(CalibError, match="no camera sees a board"):
        calib.hand_eye(tracker, data)


def test_summary_has_a_row_for_each_method(tmp_path: Path) -> None:
    day = Arm.of(tmp_path, "poses").day(15, 16)
    found = calib.hand_eye(day.cell, day.data)
    assert len(found.rows()) == len(found.judged)
    assert "held-out poses" in found.summary()
