"""Whole poses: place and body without a guess, the Cramer-Rao bound, ranks, tables.

The truth is plain numpy: a chain, two frames and quaternions that share no code with the estimator.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Measurements
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.files.write_tables import measurements_csv
from calib.instruments import Instrument, Pose
from calib.instruments.riding import corners_of
from calib.model.build import build
from calib.noise import Noise
from calib.poses import poses_at
from calib.simulation import drawn_readings
from tests.calib.instruments.test_slot import arm, drawn
from tests.helpers import all_seen, cell_of, random_robot
from tests.plain_arm import frame, tips

SIGMA = np.repeat([2e-4, 5e-4], 3)  # m, rad
MIXED = np.eye(6) + 0.3 * np.array([[(-1.0) ** (i + j) for j in range(6)] for i in range(6)])
COVARIANCE = MIXED * np.outer(SIGMA, SIGMA)
OFFSETS = ("j2", "j3")  # that of the last joint is the body's
OFF = f"joint_offset:{','.join(OFFSETS)}"
EFFECTS = ("base", "tool", OFF)
TRUE = np.array([4e-4, -7e-4])  # rad, of the joints of OFFSETS


def seen_from(robot: Robot, q: Array, off: Array, Y: Array, X: Array) -> Array:
    """A body at X as an instrument at Y reads it, the joints of OFFSETS off by so much."""
    error = np.zeros(robot.dof)
    error[[robot.joints.index(j) for j in OFFSETS]] = off
    return np.asarray(frame(Y) @ tips(robot, q + error) @ frame(X))


def noisy(T: Array, noise: Array) -> Array:
    """Each pose displaced in its own axes by (m, 6)."""
    return np.array([one @ frame(xi) for one, xi in zip(T, noise, strict=True)])


def entries(T: Array) -> Array:
    """Position and quaternion by the trace, which must not be near -1."""
    R = T[:, :3, :3]
    w = np.sqrt(1.0 + R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2]) / 2.0
    odd = [R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]]
    return np.column_stack([T[:, :3, 3], w, *(o / (4.0 * w) for o in odd)])


def rows(T: Array) -> Array:
    """As the instrument has them: origin and two axes."""
    return np.concatenate([T[:, :3, 3], T[:, :3, 0], T[:, :3, 1]], axis=1)[:, None]


def eye(first: int = 0, bodies: int = 1) -> Pose:
    read = tuple(range(first, first + 3 * bodies))
    return Pose(name="eye", markers=read, noise=Noise.isotropic(2e-4), covariance=COVARIANCE)


def cell_with(
    robot: Robot, *more: Instrument, effects: tuple[str, ...] = EFFECTS, bodies: int = 1
) -> Cell:
    """Bodies guessed at the tip's frame, a marker before them where a tracker reads one."""
    alone = [[0.1, -0.05, 0.02]] if more else []
    first, names = len(alone), [f"body{b}" for b in range(bodies)]
    corners = [corners_of(np.eye(3), np.zeros(3)) for _ in names]
    markers = np.concatenate([np.reshape(alone, (-1, 3)), *corners])
    cell = cell_of(robot, markers, effects)
    return replace(
        cell,
        marker_names=("m1",) * first + tuple(n + end for n in names for end in ("", ":x", ":y")),
        bodies={name: slice(first + 3 * b, first + 3 * b + 3) for b, name in enumerate(names)},
        instruments=(*more, eye(first, bodies)),
    )


def measured(q: Array, readings: Array) -> Measurements:
    return all_seen(poses_at(q), readings)


def anywhere(rng: np.random.Generator) -> Array:
    """A frame that stands and is turned anyhow."""
    axis = rng.normal(size=3)
    turned = rng.uniform(0.1, 3.1) * axis / np.linalg.norm(axis)
    return np.concatenate([rng.uniform(-2.0, 2.0, 3), turned])


@pytest.mark.parametrize("seed", range(6))
def test_place_and_body_without_a_guess(seed: int) -> None:
    rng, robot = np.random.default_rng(seed), arm()
    Y, X, q = anywhere(rng), anywhere(rng), drawn(12, seed)
    found = calib.identify(cell_with(robot), measured(q, rows(seen_from(robot, q, TRUE, Y, X))))
    np.testing.assert_allclose(found.values[in_order_of_offsets(found)], TRUE, atol=1e-9)
    ((_, (p, r)),) = found.model.instruments[0].bodies(found.marker_positions)
    np.testing.assert_allclose(frame(np.concatenate([p, r])), frame(X), atol=1e-9)
    np.testing.assert_allclose(frame(found.bases["base"]), frame(Y), atol=1e-9)


def in_order_of_offsets(found: calib.Identification) -> list[int]:
    ids = [p.id for p in found.model.parameters]
    return [ids.index(f"joint_offset:{j}.offset") for j in OFFSETS]


@pytest.mark.parametrize("seed", range(3))
def test_axes_that_are_all_parallel(seed: int) -> None:
    """They leave a shift along them open between place and body; the poses are met all the same."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, 3)
    origins = robot.origins.copy()
    origins[1:3, :3, :3] = np.eye(3)
    robot = replace(robot, axes=np.tile([0.0, 0.0, 1.0], (3, 1)), origins=origins)
    q = rng.uniform(-2.0, 2.0, (15, 3))
    T = frame(anywhere(rng)) @ tips(robot, q) @ frame(anywhere(rng))
    found = calib.identify(cell_with(robot, effects=("base", "tool")), measured(q, rows(T)))
    assert len(found.values) == 11
    assert found.distances["fitted_all"].max() < 1e-8
    assert found.by_instrument["eye", "mrad"]["fitted_all"] < 1e-5


def test_two_bodies_and_a_known_one() -> None:
    """Without the tool in the model the body sits where the cell says."""
    rng, robot, q = np.random.default_rng(3), arm(), drawn(10, 3)
    Y, X = anywhere(rng), (anywhere(rng), anywhere(rng))
    T = [seen_from(robot, q, TRUE, Y, x) for x in X]
    both = np.concatenate([rows(t) for t in T], axis=1)
    found = calib.identify(cell_with(robot, bodies=2), measured(q, both))
    np.testing.assert_allclose(found.values[in_order_of_offsets(found)], TRUE, atol=1e-9)
    known = cell_with(robot, effects=("base", OFF))
    known = replace(known, markers=corners_of(frame(X[0])[:3, :3], X[0][:3]))
    found = calib.identify(known, measured(q, rows(T[0])))
    assert len(found.values) == 8
    np.testing.assert_allclose(frame(found.bases["base"]), frame(Y), atol=1e-9)


@pytest.mark.parametrize(("dof", "prismatic"), [(2, ()), (4, (1,)), (6, ()), (7, ())])
def test_rank_of_a_generic_chain(dof: int, prismatic: tuple[int, ...]) -> None:
    """Whole poses see four constants a joint that turns, two a joint that slides, and six."""
    robot = random_robot(np.random.default_rng(dof), dof, prismatic)
    built = build(cell_with(robot, effects=("base", "tool", "geometry")))
    assert len(built.model.parameters) == 4 * dof - 2 * len(prismatic) + 6


def test_simulated_as_it_is_whitened() -> None:
    """Errors ``predicted^-1 measured`` of a simulated day have the stated covariance."""
    poses = poses_at(drawn(4000, 7))
    model = build(cell_with(arm()), poses).model
    exact = model.predict(model.initial, poses)
    data = drawn_readings(model, model.initial, poses, None, np.random.default_rng(8))
    error = eye().shown(data.readings, data.readings - exact)[:, 0]
    correlation = np.cov(error.T) / np.outer(SIGMA, SIGMA)
    np.testing.assert_allclose(correlation, MIXED, atol=6.0 * 1.3 / np.sqrt(4000))


def test_through_a_table(tmp_path: Path) -> None:
    """Quaternions of either sign, a station's own frame and deviation; what is none is refused."""
    rng, robot, q = np.random.default_rng(2), arm(), drawn(40, 6)
    T = seen_from(robot, q, TRUE, anywhere(rng), anywhere(rng))
    plain = np.trace(T[:, :3, :3], axis1=1, axis2=2) > -0.5
    q, T = q[plain], T[plain]
    cell = cell_with(robot)
    text = measurements_csv(cell, measured(q, rows(T)))
    header, *lines = text.splitlines()
    assert header.endswith("x_mm,y_mm,z_mm,qw,qx,qy,qz")
    written = np.array([line.split(",")[-7:] for line in lines], dtype=float)
    expected = entries(T) * [1e3, 1e3, 1e3, 1.0, 1.0, 1.0, 1.0]
    np.testing.assert_allclose(written, expected, atol=1e-5)
    cut = [line.split(",") for line in lines]
    signs = [",".join([*own[:-4], *(f"{-float(v)}" for v in own[-4:])]) for own in cut]
    (tmp_path / "m.csv").write_text("\n".join([header, *signs]) + "\n")
    back = calib.load_measurements(cell, tmp_path / "m.csv")
    np.testing.assert_allclose(back.readings, rows(T), atol=2e-8)
    long = ",".join([*lines[0].split(",")[:-4], "1.0", "1.0", "0.0", "0.0"])
    for old, new, said in (
        (lines[0], long, "line 2, column qw: .* a quaternion has a length of one"),
        (",qz", ",qq", "column qz is missing"),
        ("body0,", "body0:x,", r"'body0:x' is not in the cell's \[markers_mm\] or \[bodies\]"),
    ):
        (tmp_path / "bad.csv").write_text(text.replace(old, new, 1))
        with pytest.raises(calib.CalibError, match=said):
            calib.load_measurements(cell, tmp_path / "bad.csv")


def test_a_deviation_of_its_own_scales_the_covariance() -> None:
    """A reading said to be three times worse counts a ninth."""
    pose, place = eye(), np.zeros(6)
    row = rows(frame(anywhere(np.random.default_rng(1)))[None])
    usual = pose.whitening(place, row, np.array([[np.nan]]))
    size = float(np.sqrt(np.trace(COVARIANCE[:3, :3]) / 3.0))
    np.testing.assert_allclose(pose.whitening(place, row, np.array([[3.0 * size]])), usual / 3.0)


def test_approach_pose_is_for_points() -> None:
    q = drawn(12, 1)
    data = measured(q, rows(seen_from(arm(), q, TRUE, np.zeros(6), np.zeros(6))))
    with pytest.raises(calib.CalibError, match="use approach points"):
        calib.identify(cell_with(arm()), data, approach="pose")


HELD_OUT = {
    "fr3_eye_in_hand": (1.6, 4.2),
    "positioner_poses": (0.44, 1.0),
    "iiwa7_torque": (0.70, 4.0),
}
NOMINAL = {"fr3_eye_in_hand": (4.54, 12.1), "positioner_poses": (0.458, 0.98)}


@pytest.mark.long
@pytest.mark.parametrize("name", list(HELD_OUT))
def test_real_poses(data: Path, name: str) -> None:
    cell = calib.load_cell(data / name / "cell.toml")
    table = calib.load_measurements(cell, data / name / "measurements.csv")
    found = []
    for seed in range(10):
        kept, held = table.split(0.3, np.random.default_rng(seed))
        result = calib.identify(cell, kept, heldout=held)
        assert result.status == "converged"
        found.append([rms["heldout"] for rms in result.by_instrument.values()])
    assert (np.median(found, axis=0) <= HELD_OUT[name]).all()
    if name in NOMINAL:
        nominal = [rms["nominal"] for rms in calib.identify(cell, table).by_instrument.values()]
        np.testing.assert_allclose(nominal, NOMINAL[name], rtol=0.01)
