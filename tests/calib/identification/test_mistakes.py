"""Mistakes of users on days of arms in MuJoCo: each is said, and nothing is said of honest days."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arrays import Array
from calib.errors import ImplausibleData, Unsolvable
from calib.identification.mistakes import Mistake, recognised
from calib.identification.start import initial_values
from calib.model.build import build
from calib.model.covariance import identifiable
from studies.research.withheld.robots import HEAVY, Arm
from tests.calib.arm_days import SCARA, SEVEN, Day, day

ARMS = {arm.name: arm for arm in (HEAVY, SCARA, SEVEN)}


def found(of: Day, folder: Path) -> Mistake | None:
    cell, data = of.read(folder)
    model = build(cell, data.poses).model
    off = data.points - model.predict(initial_values(model, data), data.poses)
    return recognised(model, data, np.sqrt((off**2).sum(axis=-1).mean(axis=-1)))


def names(of: Day, folder: Path) -> set[str]:
    return set(surely(of, folder).names)


def names_of(mistake: Mistake | None) -> tuple[str, ...]:
    return () if mistake is None else mistake.names


def surely(of: Day, folder: Path) -> Mistake:
    mistake = found(of, folder)
    assert mistake is not None
    assert mistake.mended < 4e-3
    assert mistake.nominal > 10.0 * mistake.mended
    return mistake


def joints_times(arm: Arm, **factors: float) -> Callable[[Array], Array]:
    return lambda q: q * [factors.get(name, 1.0) for name in arm.names]


def turned(arm: Arm, **degrees: float) -> Callable[[Array], Array]:
    return lambda q: q + np.radians([degrees.get(name, 0.0) for name in arm.names])


def turning_times(arm: Arm, factor: float) -> Callable[[Array], Array]:
    return lambda q: q * np.where(arm.slides, 1.0, factor)


def swapped(arm: Arm, one: int, other: int) -> Callable[[Array], Array]:
    order = np.arange(arm.dof)
    order[[one, other]] = other, one
    return lambda q: q[:, order]


def mixed(arm: Arm, joint: int, before: int, sign: float) -> Callable[[Array], Array]:
    return lambda q: q + sign * q[:, [before]] * (np.arange(arm.dof) == joint)


def times(factors: float | Sequence[float]) -> Callable[[Array], Array]:
    return lambda p: p * factors


def known(of: Day) -> Day:
    """The day with the instrument in the base frame, as the cell says."""
    of = replace(of, effects=("tool", "geometry"))
    return of.with_points(lambda p: (p - of.place[1]) @ of.place[0])


def lacking(*effects: str) -> Day:
    """A day whose base, and markers, are not where the cell has them."""
    of = day(seed=16)
    return replace(of, effects=effects, markers=np.add(of.markers, [0.1, -0.2, 0.15]))


def exchanged_at(poses: Sequence[int], a: int = 0, b: int = 1) -> Callable[[Array], Array]:
    def change(points: Array) -> Array:
        points = points.copy()
        points[np.ix_(poses, [a, b])] = points[np.ix_(poses, [b, a])]
        return points

    return change


def points(arm: Arm, seed: int, change: Callable[[Array], Array], shown: str = "mm") -> Day:
    return replace(day(arm, seed).with_points(change), units=("deg", "mm", shown))


def joints(
    arm: Arm, seed: int, change: Callable[[Array], Array], shown: str = "deg", markers: int = 3
) -> Day:
    of = day(arm, seed, markers=markers).with_joints(change)
    return replace(of, units=(shown, "mm", "mm"))


WRONG: list[tuple[Callable[[], Day], set[str]]] = [
    (lambda: points(HEAVY, 1, times([1, -1, 1])), {"mirrored"}),
    (lambda: points(HEAVY, 1, times([1, 1, -1])), {"mirrored"}),
    (lambda: points(HEAVY, 1, np.negative), {"mirrored"}),
    (lambda: points(HEAVY, 1, lambda p: p[..., [1, 0, 2]]), {"mirrored"}),
    # A SCARA cannot tell it from a screw that runs the other way: both are said.
    (lambda: points(SCARA, 1, times([1, -1, 1])), {"mirrored", "Z reversed"}),
    (lambda: points(SEVEN, 1, times([1, 1, -1])), {"mirrored"}),
    # With the instrument in the base frame the axis is told.
    (lambda: known(day()).with_points(times([1, -1, 1])), {"mirrored y"}),
    (lambda: known(day()).with_points(np.negative), {"negated"}),
    # A column called mm that holds metres, and the like: as the user would write them.
    (lambda: points(HEAVY, 5, times(1e-3), "mm"), {"points in metres for millimetres"}),
    (lambda: points(SCARA, 5, times(1e3), "m"), {"points in millimetres for metres"}),
    (lambda: points(SCARA, 5, times(1 / 25.4), "mm"), {"points in inches for millimetres"}),
    (lambda: points(HEAVY, 5, times(1 / 0.0254), "m"), {"points in inches for metres"}),
    (lambda: points(HEAVY, 5, times(25.4), "mm"), {"points in millimetres for inches"}),
    (
        lambda: joints(SCARA, 6, joints_times(SCARA, Z=1e-3)),
        {"slides in metres for millimetres"},
    ),
    (
        lambda: joints(SCARA, 6, joints_times(SCARA, Z=1e-3)).with_points(times(1e-3)),
        {"lengths in metres for millimetres"},
    ),
    (lambda: joints(HEAVY, 8, joints_times(HEAVY, A2=-1.0)), {"A2 reversed"}),
    # The same arm with a free tool: half a turn of the joint before turns the axis round.
    (lambda: joints(HEAVY, 8, joints_times(HEAVY, A5=-1.0)), {"A5 reversed", "A4 off by 180 deg"}),
    (lambda: joints(HEAVY, 8, joints_times(HEAVY, A6=-1.0)), {"A6 reversed", "A5 off by 180 deg"}),
    (lambda: joints(SCARA, 8, joints_times(SCARA, Z=-1.0)), {"Z reversed", "mirrored"}),
    (lambda: joints(SEVEN, 8, joints_times(SEVEN, A3=-1.0)), {"A3 reversed"}),
    (lambda: joints(HEAVY, 17, turned(HEAVY, A4=180)), {"A4 off by 180 deg", "A5 reversed"}),
    (lambda: known(joints(HEAVY, 17, turned(HEAVY, A1=90))), {"A1 off by 90 deg"}),
    (
        lambda: joints(HEAVY, 18, turned(HEAVY, A2=90, A3=-90)),
        {"A2 off by 90 deg and A3 off by -90 deg"},
    ),
    (lambda: joints(HEAVY, 9, swapped(HEAVY, 1, 2)), {"A2 and A3 swapped"}),
    (lambda: joints(HEAVY, 9, swapped(HEAVY, 4, 5)), {"A5 and A6 swapped"}),
    (lambda: joints(SCARA, 9, swapped(SCARA, 1, 3)), {"J2 and R swapped"}),
    (lambda: joints(SEVEN, 9, swapped(SEVEN, 0, 6)), {"A1 and A7 swapped"}),
    (lambda: joints(HEAVY, 10, mixed(HEAVY, 2, 1, 1.0)), {"A3 - A2"}),
    (lambda: joints(SCARA, 10, mixed(SCARA, 1, 0, -1.0)), {"J2 + J1"}),
]


@pytest.mark.sampled
@pytest.mark.parametrize("case", range(len(WRONG)))
def test_what_is_wrong_with_every_reading(case: int, tmp_path: Path) -> None:
    wrong, expected = WRONG[case]
    assert names(wrong(), tmp_path) == expected


@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        (lambda: lacking("tool", "geometry"), "base taken as known"),
        (lambda: lacking("geometry"), "base and tool taken as known"),
        (lambda: lacking("joint_offset"), "base and tool taken as known"),
        (lambda: lacking("base", "geometry"), "tool taken as known"),
        (
            lambda: replace(
                day(seed=12).with_points(exchanged_at(range(50))), effects=("base", "geometry")
            ),
            "m1 and m2 exchanged",
        ),
    ],
)
def test_what_is_elsewhere_than_the_cell_says(
    wrong: Callable[[], Day], name: str, tmp_path: Path
) -> None:
    mistake = found(wrong(), tmp_path)
    assert mistake is not None
    assert mistake.names == (name,)
    assert "to [model] effects" in mistake.text or "in [markers_mm]" in mistake.text


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("arm", "shown", "factor", "holds"),
    [(HEAVY, "deg", np.pi / 180, "radians"), (SCARA, "rad", 180 / np.pi, "degrees")],
)
def test_degrees_and_radians(
    arm: Arm, shown: str, factor: float, holds: str, tmp_path: Path
) -> None:
    mistake = found(joints(arm, 7, turning_times(arm, factor), shown), tmp_path)
    assert mistake is not None
    assert mistake.names == (f"joints in {holds}",)
    assert f"{holds} in columns of {shown}" in mistake.text
    assert f"name the columns {arm.names[0]}_{holds[:3]}" in mistake.text


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("arm", "joint", "degrees", "markers"),
    [(HEAVY, "A2", 90, 1), (HEAVY, "A3", -90, 3), (SCARA, "J2", 180, 1), (SEVEN, "A4", 90, 3)],
)
def test_a_zero_of_another_convention(
    arm: Arm, joint: str, degrees: float, markers: int, tmp_path: Path
) -> None:
    wrong = joints(arm, 17, turned(arm, **{joint: degrees}), markers=markers)
    mistake = surely(wrong, tmp_path)
    assert mistake.names == (f"{joint} off by {degrees:g} deg",)
    back = "180" if degrees == 180 else f"{-degrees:g}"
    assert f"add {back} deg to {joint}" in mistake.text


@pytest.mark.parametrize(
    "harmless",
    [
        lambda: joints(HEAVY, 17, turned(HEAVY, A1=90)),  # base or tool take it up
        lambda: joints(HEAVY, 18, turned(HEAVY, A2=30)),  # no quarter is no convention
        lambda: day(seed=12).with_points(exchanged_at(range(50))),  # markers are free
    ],
)
def test_what_is_no_mistake(harmless: Callable[[], Day], tmp_path: Path) -> None:
    assert found(harmless(), tmp_path) is None


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("arm", "markers", "by"),
    [("heavy", 1, 1), ("heavy", 3, -1), ("scara", 3, 1), ("seven", 1, -1)],
)
def test_points_shifted_by_one_pose(arm: str, markers: int, by: int, tmp_path: Path) -> None:
    """As a user has them who pastes a column one line too high or too low: one end has no partner."""
    good = day(ARMS[arm], 19, markers=markers)
    rows = slice(None, -1) if by > 0 else slice(1, None)
    points = good.points[1:] if by > 0 else good.points[:-1]
    mistake = found(replace(good, q=good.q[rows], points=points), tmp_path)
    assert mistake is not None
    assert mistake.names == (f"shifted by {by}",)
    assert f"move their columns {'down' if by > 0 else 'up'} by one pose" in mistake.text
    assert mistake.poses == ()


@pytest.mark.sampled
@pytest.mark.parametrize(("first", "last"), [(0, 30), (12, 50), (43, 50)])
def test_points_shifted_from_a_lost_one_on(first: int, last: int, tmp_path: Path) -> None:
    def lost(points: Array) -> Array:
        points = points.copy()
        points[first:last] = np.roll(points[first:last], -1, axis=0)
        return points

    mistake = found(day(HEAVY, 19).with_points(lost), tmp_path)
    assert mistake is not None
    assert mistake.names == ("shifted by 1",)
    assert mistake.poses == tuple(f"p{i:03d}" for i in range(first, last - 1))


def test_poses_held_out_hide_no_shift(tmp_path: Path) -> None:
    cell, data = day(HEAVY, 19).with_points(lambda p: np.roll(p, 1, axis=0)).read(tmp_path)
    kept, held = data.split(0.3, np.random.default_rng(0))
    with pytest.raises(ImplausibleData, match="shifted by one pose"):
        calib.identify(cell, kept, heldout=held)


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("arm", "markers", "count"),
    [("heavy", 2, 1), ("heavy", 3, 19), ("scara", 3, 6), ("seven", 2, 19)],
)
def test_two_markers_exchanged_at_some_poses(
    arm: str, markers: int, count: int, tmp_path: Path
) -> None:
    wrong = sorted(np.random.default_rng(count).choice(50, count, replace=False).tolist())
    mistake = found(day(ARMS[arm], 11, markers=markers).with_points(exchanged_at(wrong)), tmp_path)
    assert mistake is not None
    assert mistake.poses == tuple(f"p{i:03d}" for i in wrong)
    assert f"markers m1 and m2 are exchanged at p{wrong[0]:03d}" in mistake.text


def test_gross_errors_beside_a_mistake(tmp_path: Path) -> None:
    def gross(points: Array) -> Array:
        points = points.copy()
        points[[7, 30]] += [[[2.0, 0.0, 1.0]], [[0.0, -0.4, 0.1]]]
        return points

    wrong = day(seed=13).with_joints(joints_times(HEAVY, A4=-1.0))
    assert names(wrong.with_points(gross), tmp_path) == {"A4 reversed"}
    assert found(day(seed=13).with_points(gross), tmp_path) is None


@pytest.mark.sampled
@pytest.mark.parametrize(("arm", "markers"), [("heavy", 1), ("scara", 3), ("seven", 1)])
def test_nothing_is_said_of_an_arm_that_errs(arm: str, markers: int, tmp_path: Path) -> None:
    for seed, (poses, link) in enumerate([(50, 0.0), (12, 0.03), (50, 0.1)]):
        honest = day(ARMS[arm], 20 + seed, poses=poses, markers=markers, link=link)
        assert found(honest, tmp_path) is None


@pytest.mark.sampled
@pytest.mark.parametrize("name", ["irb120_faro", "fanuc_r2000", "ur10_leica_b", "meca500_right80"])
def test_real_days(data: Path, name: str) -> None:
    """Nothing of them as they are; mirrored, or with a joint reversed, that alone."""
    cell = calib.load_cell(data / name / "cell.toml")
    table = calib.load_measurements(cell, data / name / "measurements.csv")
    model = build(cell, table.poses).model
    far = np.full(len(table), model.robot.reach)
    assert recognised(model, table, far) is None, "asked, though the misfit gives no cause"
    mirrored = replace(table, readings=table.points * [1.0, -1.0, 1.0])
    assert names_of(recognised(model, mirrored, far)) == ("mirrored",)
    q = table.poses.q * np.where(np.arange(model.robot.dof) == 2, -1.0, 1.0)
    reversed_ = replace(table, poses=replace(table.poses, q=q))
    assert names_of(recognised(model, reversed_, far)) == (f"{model.robot.joints[2]} reversed",)


def test_verbs_refuse_with_what_is_known(tmp_path: Path) -> None:
    cell, data = day(seed=14).with_points(lambda p: p / 25.4).read(tmp_path)
    for verb in (calib.identify, calib.diagnose):
        with pytest.raises(ImplausibleData, match=r"inches.* multiply x, y and z by 25\.4") as said:
            verb(cell, data)
        assert said.value.mistakes == ("points in inches for millimetres",)
        assert said.value.nominal > 1.0
        assert said.value.mended < 3e-3


def test_what_is_no_number_is_no_traceback() -> None:
    """As an arm has it that is too soft to stand, where nothing in the table helps."""
    rows = np.eye(4)
    rows[2, 1] = np.nan
    with pytest.raises(Unsolvable, match="check the units"):
        identifiable(rows, np.ones(4), ("a", "b", "c", "d"))
