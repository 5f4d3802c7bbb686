"""Instruments that touch, measure lengths or read whole poses: places, ranks, scatter, tables.

The truth is plain numpy: a chain, surfaces, contacts and frames that share no code with the estimator.
A contact is made by moving the joints until the marker is where it belongs, its noise aside.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import calib
from calib import Cell, Measurements
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.effects.protocol import Effect
from calib.files.write_tables import measurements_csv
from calib.instruments import Distance, Instrument, KnownDistance, Plane, Pose, Socket, Tracker
from calib.instruments.riding import corners_of
from calib.model.build import build
from calib.model.covariance import errors_at
from calib.noise import Noise
from calib.poses import poses_at
from tests import touched_arm as touched
from tests.helpers import all_seen, cell_of, central_difference, random_robot
from tests.plain_arm import frame, rotation, tips
from tests.touched_arm import MARKERS, OFFSETS, SITES, TRUE, arm, drawn, measured, points_of, slopes

SIGMA = 2e-5
_TRIALS = 6
ANCHOR = np.array([0.9, -1.4, 0.6])
CENTRE = np.array([0.7, -0.5, 0.4])
OFFSET_NAMES = [f"joint_offset:{j}.offset" for j in OFFSETS]


# -- What touches, measures lengths or reads points


@dataclass(frozen=True, eq=False)
class Kind:
    """Instruments, their true places, and their readings by hand.

    reading : of points (m, M, 3) by place and site (m,), shape (m, C, r), NaN where nothing is read
    touched : whether it is made zero by moving the arm
    sigma : m, (C, 1); markers, count : of the arm and the poses
    """

    instruments: Sequence[Instrument]
    place: Array
    reading: Callable[[Array, Array, Array], Array]
    touched: bool = False
    sites: tuple[str, ...] = ()
    sigma: Array | float = SIGMA
    markers: int = 1
    count: int = 16

    def parts(self, theta: Array, q: Array, site: Array) -> Array:
        """Readings by offsets and place."""
        points = points_of(arm(), q, theta[:3], MARKERS[: self.markers])
        return self.reading(points, theta[3:], site)

    def drawn(self, theta: Array) -> tuple[Array, Array]:
        """Joints (count, 4), at which the readings are zero where they are made so, and sites."""
        if not self.touched:
            return drawn(self.count, 0), np.zeros(self.count, dtype=int)
        q = drawn((10 if self.sites else 4) * self.count, 5)
        site = np.arange(len(q)) % max(1, len(self.sites))
        q, met = touched.led_to(q, lambda q: self.parts(theta, q, site)[:, 0])
        there = np.flatnonzero(met)[: self.count]
        assert len(there) == self.count
        return q[there], site[there]


def socket(p: Array, place: Array, site: Array) -> Array:
    return p - place.reshape(-1, 1, 3)[site]


def distance(p: Array, place: Array, site: Array) -> Array:
    return touched.length(p - place[:3])[..., None] + (place[3] if len(place) > 3 else 0.0)


def known_anchor(p: Array, place: Array, site: Array) -> Array:
    return touched.length(p - CENTRE)[..., None] + place[0]


def plane(p: Array, place: Array, site: Array) -> Array:
    """Its normal is the vertical turned about a horizontal axis."""
    angle = np.hypot(*place[:2])
    x, y = place[:2] / angle
    normal = np.array([y * np.sin(angle), -x * np.sin(angle), np.cos(angle)])
    return (p @ normal)[..., None] - place[2]


def laser(p: Array, place: Array, site: Array) -> Array:
    return p @ rotation(place[3:]).T + place[:3]


def beside_a_bar(p: Array, place: Array, site: Array) -> Array:
    """Half of the poses are read by the tracker, half by the bar, some by both."""
    read = np.full((len(p), 4, 3), np.nan)
    read[:14, :2] = laser(p[:14], place[:6], site)
    read[10:, 2:, :1] = distance(p[10:], place[6:], site)
    return read


FLAT, STATION = np.array([0.3, -0.4, 0.35]), np.array([0.3, -2.0, 0.8, 0.4, -1.1, 0.7])
NEST = np.array([0.5, 0.2, 0.6, -0.4, 0.3, 0.2])
WIRE = {"name": "own", "sigma": SIGMA}
SHORT = np.array([[SIGMA], [SIGMA], [5e-6], [5e-6]])
LASER = Tracker(name="laser", noise=Noise.isotropic(SIGMA))
KINDS = {
    "distance": Kind([Distance(**WIRE)], CENTRE, distance),
    "distance with offset": Kind(
        [Distance(**WIRE, offset=True)], np.append(CENTRE, -0.2), distance
    ),
    "distance from a known anchor": Kind(
        [Distance(**WIRE, standing=CENTRE, known=True, offset=True)], np.array([0.1]), known_anchor
    ),
    "gauge over a plane": Kind([Plane(**WIRE)], FLAT, plane),
    "plane": Kind([Plane(**WIRE)], FLAT, plane, touched=True),
    "sockets": Kind(
        [Socket(name="a", sigma=SIGMA, sites=("a", "b"))], NEST, socket, True, ("a", "b")
    ),
    "tracker": Kind([LASER], STATION, laser, markers=2),
    "bar beside a tracker": Kind(
        [LASER, Distance(name="bar", sigma=5e-6)], np.append(STATION, ANCHOR), beside_a_bar,
        sigma=SHORT, markers=2, count=24,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_covariance_rank_and_refits(name: str) -> None:
    """Found without a guess, of full rank; errors scatter as the information by hand says."""
    kind, rng, squared = KINDS[name], np.random.default_rng(1), 0.0
    theta = np.concatenate([TRUE, kind.place])
    q, site = kind.drawn(theta)
    exact = kind.parts(theta, q, site)
    read, sigma = np.isfinite(exact), np.broadcast_to(kind.sigma, exact.shape)
    J = slopes(lambda t: kind.parts(t, q, site), theta)[read.ravel()] / sigma[read][:, None]
    expected = np.linalg.inv(J.T @ J)
    cell = touched.cell_with(*kind.instruments)
    cell = replace(cell, markers=MARKERS[: kind.markers], marker_names=("m1", "m2")[: kind.markers])
    sites = {"site": np.array(kind.sites)[site]} if kind.sites else {}
    gain = touched.followed(q, lambda q: kind.parts(theta, q, site)[:, 0]) if kind.touched else None
    for _ in range(_TRIALS):
        noise, where = sigma * rng.standard_normal(exact.shape), q
        readings = np.where(read, exact + noise, 0.0)
        if gain is not None:  # the arm is elsewhere, and what is read is nothing
            where, readings = q + (gain @ noise[:, 0, :, None])[..., 0], np.zeros_like(exact)
        found = calib.identify(cell, measured(where, readings, read.any(axis=-1), **sites))
        at = touched.positions(found, *OFFSET_NAMES)
        at += [i for i, p in enumerate(found.model.parameters) if p.effect == "base"]
        assert found.status == "converged"
        assert found.rank == len(theta) == len(found.values)
        assert found.dof == read.sum() - len(theta)
        error = found.values[at] - theta
        squared += error @ np.linalg.solve(expected, error)
        stated = found.std[at] / found.noise.factor
        np.testing.assert_allclose(stated, np.sqrt(np.diag(expected)), rtol=0.03)
    # Chi-square, four standard deviations.
    dof = float(_TRIALS * len(theta))
    assert squared == pytest.approx(dof, abs=4.0 * np.sqrt(2.0 * dof))


def test_derivatives_of_a_known_distance() -> None:
    """Between two markers that are free."""
    cell = touched.cell_with(Plane(**WIRE), effects=("base", "tool", "joint_offset:j2,j3"))
    cell = replace(cell, known_distances=(KnownDistance(("m1", "m2"), 0.1, 1e-5),))
    model = build(cell, poses_at(drawn(6, 4))).model
    values = np.random.default_rng(3).normal(size=len(model.parameters)) * 10.0 * model.sizes
    _, by_known = model.prior_residuals(values)
    numeric = central_difference(lambda v: -model.prior_residuals(v)[0], values, 0.1 * model.sizes)
    np.testing.assert_allclose(by_known, numeric, rtol=1e-6, atol=1e-6 * np.abs(by_known).max())


def test_scale_from_a_known_distance() -> None:
    """One pair a known way apart tells how large the arm is; without one it stays as in the model."""
    robot = random_robot(np.random.default_rng(12), 6)
    data, centres = touched.contacts_of_a_larger_arm(robot)
    assert len(data) > 60
    cell = cell_of(robot, MARKERS[:1] + np.array([0.08, -0.05, 0.06]), ("tool", "geometry"))
    cell = replace(cell, instruments=(Socket(name="a", sigma=SIGMA, sites=SITES),))
    bar = KnownDistance(("a", "b"), float(touched.length(centres[0] - centres[1])), 1e-6)

    def between_c_and_d(found: calib.Identification) -> float:
        own = found.values[
            touched.positions(found, *(f"base:{s}.{x}" for s in "cd" for x in "xyz"))
        ]
        return float(touched.length(own[:3] - own[3:]))

    truth = float(touched.length(centres[2] - centres[3]))
    found = calib.identify(replace(cell, known_distances=(bar,)), data)
    assert found.rms("fitted") == pytest.approx(0.0, abs=1e-7)
    assert between_c_and_d(found) == pytest.approx(truth, abs=2e-6)
    assert not any("no length" in text for text in found.warnings)
    without = calib.identify(cell, data)
    assert without.rms("fitted") == pytest.approx(0.0, abs=1e-7)
    assert any("no length is measured" in text for text in without.warnings)
    assert len(without.values) == len(found.values) - 1
    assert abs(between_c_and_d(without) / truth - 1.0) < 0.01


# -- Tables of two instruments, and what an error of a target is


def test_rows_of_two_instruments_go_through_a_table(tmp_path: Path) -> None:
    """By the column ``instrument``; what does not apply is empty."""
    q, cell = drawn(5, 6), touched.cell_with(LASER, Distance(name="bar", markers=(1,)))
    readings, seen = np.zeros((5, 3, 3)), np.ones((5, 3), dtype=bool)
    readings[:, :2] = points_of(arm(), q, TRUE)
    readings[:, 2, 0] = touched.length(readings[:, 1] - ANCHOR)
    seen[3, 0] = seen[1, 2] = False
    data = measured(q, readings, seen)
    text = measurements_csv(cell, data)
    assert text.splitlines()[0].endswith("x_mm,y_mm,z_mm,d_mm")
    (tmp_path / "m.csv").write_text(text)
    back = calib.load_measurements(cell, tmp_path / "m.csv")
    np.testing.assert_array_equal(back.seen, seen)
    np.testing.assert_allclose(back.readings, data.readings, atol=6e-9)
    for old, new, said in (
        (",bar,", ",rod,", "'rod' is not in the cell; instruments are laser, bar"),
        ("m2,bar,", "m1,bar,", "is nothing that instrument 'bar' reads"),
    ):
        refused(cell, text.replace(old, new, 1), said, tmp_path)


def refused(cell: Cell, table: str, said: str, folder: Path) -> None:
    (folder / "bad.csv").write_text(table)
    with pytest.raises(calib.CalibError, match=said):
        calib.load_measurements(cell, folder / "bad.csv")


def test_accuracy_at_targets_counts_points() -> None:
    """Whatever reads, the error expected of a target is that of its points."""
    targets = poses_at(drawn(3, 9))
    model = build(touched.cell_with(Distance(name="bar")), targets).model
    at = model.where(Effect)
    own = [i for i in at if model.parameters[i].effect == "joint_offset"]
    cov = np.zeros((len(at), len(at)))
    cov[own, own] = 1e-8
    errors = errors_at(model, model.initial, cov, targets)
    moved = slopes(lambda t: points_of(arm(), targets.q, t, np.zeros((1, 3))), np.zeros(3))
    expected = 1e-4 * np.sqrt((moved.reshape(3, -1) ** 2).sum(axis=1))
    np.testing.assert_allclose(errors, expected, rtol=1e-6)


# -- Whole poses: places and bodies without a guess, ranks, tables

STD = np.repeat([2e-4, 5e-4], 3)  # m, rad
MIXED = np.eye(6) + 0.3 * np.array([[(-1.0) ** (i + j) for j in range(6)] for i in range(6)])
COVARIANCE = MIXED * np.outer(STD, STD)
ARM = "joint_offset:j2,j3"  # that of the last joint is the body's


def seen_from(q: Array, Y: Array, X: Array) -> Array:
    """A body at X as an instrument at Y reads it."""
    return np.asarray(frame(Y) @ tips(arm(), q + np.array([0.0, *TRUE[:2], 0.0])) @ frame(X))


def rows(T: Array) -> Array:
    """As the instrument has them: origin and two axes."""
    return np.concatenate([T[:, :3, 3], T[:, :3, 0], T[:, :3, 1]], axis=1)[:, None]


def eye(bodies: int = 1) -> Pose:
    read = tuple(range(3 * bodies))
    return Pose(name="eye", markers=read, noise=Noise.isotropic(2e-4), covariance=COVARIANCE)


def with_bodies(
    robot: Robot | None = None, effects: tuple[str, ...] = ("base", "tool", ARM), bodies: int = 1
) -> Cell:
    """Bodies guessed at the tip's frame."""
    names = [f"body{b}" for b in range(bodies)]
    corners = np.concatenate([corners_of(np.eye(3), np.zeros(3)) for _ in names])
    return replace(
        cell_of(arm() if robot is None else robot, corners, effects),
        marker_names=tuple(n + end for n in names for end in ("", ":x", ":y")),
        bodies={name: slice(3 * b, 3 * b + 3) for b, name in enumerate(names)},
        instruments=(eye(bodies),),
    )


def of_bodies(q: Array, *T: Array) -> Measurements:
    return all_seen(poses_at(q), np.concatenate([rows(t) for t in T], axis=1))


def anywhere(rng: np.random.Generator) -> Array:
    """A frame that stands and is turned anyhow."""
    axis = rng.normal(size=3)
    turned = rng.uniform(0.1, 3.1) * axis / np.linalg.norm(axis)
    return np.concatenate([rng.uniform(-2.0, 2.0, 3), turned])


@pytest.mark.parametrize(
    ("seed", "bodies", "known"), [*((k, 1, False) for k in range(6)), (3, 2, False), (3, 1, True)]
)
def test_place_and_bodies_without_a_guess(seed: int, bodies: int, known: bool) -> None:
    """A body sits where the cell says if the model is without the tool."""
    rng, q = np.random.default_rng(seed), drawn(12, seed)
    Y, X = anywhere(rng), [anywhere(rng) for _ in range(bodies)]
    cell = with_bodies(effects=("base", *(() if known else ("tool",)), ARM), bodies=bodies)
    if known:
        cell = replace(cell, markers=corners_of(frame(X[0])[:3, :3], X[0][:3]))
    found = calib.identify(cell, of_bodies(q, *(seen_from(q, Y, x) for x in X)))
    assert len(found.values) == (8 if known else 8 + 6 * bodies)
    at = touched.positions(found, *OFFSET_NAMES[:2])
    np.testing.assert_allclose(found.values[at], TRUE[:2], atol=1e-9)
    placed = found.model.instruments[0].bodies(found.marker_positions)
    for (_, (p, r)), x in zip(placed, X, strict=True):
        np.testing.assert_allclose(frame(np.concatenate([p, r])), frame(x), atol=1e-9)
    np.testing.assert_allclose(frame(found.bases["base"]), frame(Y), atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_axes_that_are_all_parallel(seed: int) -> None:
    """They leave a shift along them open between place and body; the poses are met all the same."""
    rng = np.random.default_rng(seed)
    robot = touched.parallel(random_robot(rng, 3))
    q = rng.uniform(-2.0, 2.0, (15, 3))
    T = frame(anywhere(rng)) @ tips(robot, q) @ frame(anywhere(rng))
    found = calib.identify(with_bodies(robot, ("base", "tool")), of_bodies(q, T))
    assert len(found.values) == 11
    assert found.distances["fitted_all"].max() < 1e-8
    assert found.by_instrument["eye", "mrad"]["fitted_all"] < 1e-5


@pytest.mark.parametrize(("dof", "prismatic"), [(2, ()), (4, (1,)), (6, ()), (7, ())])
def test_rank_of_a_generic_chain(dof: int, prismatic: tuple[int, ...]) -> None:
    """Whole poses see four constants a joint that turns, two a joint that slides, and six."""
    robot = random_robot(np.random.default_rng(dof), dof, prismatic)
    built = build(with_bodies(robot, ("base", "tool", "geometry")))
    assert len(built.model.parameters) == 4 * dof - 2 * len(prismatic) + 6


def test_quaternions_go_through_a_table(tmp_path: Path) -> None:
    """Of either sign; what is none is refused."""
    rng, q, cell = np.random.default_rng(2), drawn(40, 6), with_bodies()
    T = seen_from(q, anywhere(rng), anywhere(rng))
    turns = Rotation.from_matrix(T[:, :3, :3]).as_quat(canonical=True, scalar_first=True)
    text = measurements_csv(cell, of_bodies(q, T))
    header, *lines = text.splitlines()
    assert header.endswith("x_mm,y_mm,z_mm,qw,qx,qy,qz")
    cut = [line.split(",") for line in lines]
    written = np.array([own[-7:] for own in cut], dtype=float)
    np.testing.assert_allclose(written, np.c_[1e3 * T[:, :3, 3], turns], atol=1e-5)
    signs = [",".join([*own[:-4], *(f"{-float(v)}" for v in own[-4:])]) for own in cut]
    (tmp_path / "m.csv").write_text("\n".join([header, *signs]) + "\n")
    back = calib.load_measurements(cell, tmp_path / "m.csv")
    np.testing.assert_allclose(back.readings, rows(T), atol=2e-8)
    long = ",".join([*cut[0][:-4], "1.0", "1.0", "0.0", "0.0"])
    for old, new, said in (
        (lines[0], long, "line 2, column qw: .* a quaternion has a length of one"),
        (",qz", ",qq", "column qz is missing"),
        ("body0,", "body0:x,", r"'body0:x' is not in the cell's \[markers_mm\] or \[bodies\]"),
    ):
        refused(cell, text.replace(old, new, 1), said, tmp_path)


def test_a_deviation_of_its_own_scales_the_covariance() -> None:
    """A reading said to be three times worse counts a ninth."""
    pose, place = eye(), np.zeros(6)
    row = rows(frame(anywhere(np.random.default_rng(1)))[None])
    usual = pose.whitening(place, row, np.array([[np.nan]]))
    size = float(np.sqrt(np.trace(COVARIANCE[:3, :3]) / 3.0))
    np.testing.assert_allclose(pose.whitening(place, row, np.array([[3.0 * size]])), usual / 3.0)


def test_approach_pose_is_for_points() -> None:
    q = drawn(12, 1)
    data = of_bodies(q, seen_from(q, np.zeros(6), np.zeros(6)))
    with pytest.raises(calib.CalibError, match="use approach points"):
        calib.identify(with_bodies(), data, approach="pose")
