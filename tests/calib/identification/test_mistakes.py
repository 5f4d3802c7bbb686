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


def surely(of: Day, folder: Path) -> Mistake:
    mistake = found(of, folder)
    assert mistake is not None
    assert mistake.mended < 4e-3
    assert mistake.nominal > 10.0 * mistake.mended
    return mistake


def joints_times(arm: Arm, factors: dict[str, float]) -> Callable[[Array], Array]:
    return lambda q: q * [factors.get(name, 1.0) for name in arm.names]


def turning_times(arm: Arm, factor: float) -> Callable[[Array], Array]:
    return lambda q: q * np.where(arm.slides, 1.0, factor)


def exchanged_at(poses: Sequence[int], a: int = 0, b: int = 1) -> Callable[[Array], Array]:
    def change(points: Array) -> Array:
        points = points.copy()
        points[np.ix_(poses, [a, b])] = points[np.ix_(poses, [b, a])]
        return points

    return change


_MIRRORED = {
    "y": lambda p: p * [1.0, -1.0, 1.0],
    "z": lambda p: p * [1.0, 1.0, -1.0],
    "all": np.negative,
    "x and y mixed up": lambda p: p[..., [1, 0, 2]],
}


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("arm", "how"), [*(("heavy", how) for how in _MIRRORED), ("scara", "y"), ("seven", "z")]
)
def test_a_mirrored_frame(arm: str, how: str, tmp_path: Path) -> None:
    """A SCARA cannot tell it from a screw that runs the other way: both are said."""
    mirrored = day(ARMS[arm], 1).with_points(_MIRRORED[how])
    expected = {"mirrored"} | ({"Z reversed"} if arm == "scara" else set())
    assert names(mirrored, tmp_path) == expected


def test_a_mirrored_frame_whose_place_is_known(tmp_path: Path) -> None:
    """With the instrument in the base frame the axis is told."""
    known = replace(day(), effects=("tool", "geometry"))
    known = known.with_points(lambda p: (p - known.place[1]) @ known.place[0])
    assert names(known.with_points(_MIRRORED["y"]), tmp_path) == {"mirrored y"}
    assert names(known.with_points(np.negative), tmp_path) == {"negated"}


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("arm", "shown", "factor", "holds", "named"),
    [
        ("heavy", "mm", 1e-3, "metres", "millimetres"),
        ("scara", "m", 1e3, "millimetres", "metres"),
        ("scara", "mm", 1.0 / 25.4, "inches", "millimetres"),
        ("heavy", "m", 1.0 / 0.0254, "inches", "metres"),
        ("heavy", "mm", 25.4, "millimetres", "inches"),
    ],
)
def test_points_in_another_unit(
    arm: str, shown: str, factor: float, holds: str, named: str, tmp_path: Path
) -> None:
    """A column called mm that holds metres, and the like: as the user would write them."""
    wrong = day(ARMS[arm], 5).with_points(lambda p: p * factor)
    wrong = replace(wrong, units=("deg", "mm", shown))
    assert names(wrong, tmp_path) == {f"points in {holds} for {named}"}


def test_sliding_joints_in_another_unit(tmp_path: Path) -> None:
    wrong = day(SCARA, 6).with_joints(joints_times(SCARA, {"Z": 1e-3}))
    assert names(wrong, tmp_path) == {"slides in metres for millimetres"}
    both = wrong.with_points(lambda p: p * 1e-3)
    assert names(both, tmp_path) == {"lengths in metres for millimetres"}


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("arm", "shown", "factor", "holds"),
    [("heavy", "deg", np.pi / 180, "radians"), ("scara", "rad", 180 / np.pi, "degrees")],
)
def test_degrees_and_radians(
    arm: str, shown: str, factor: float, holds: str, tmp_path: Path
) -> None:
    wrong = day(ARMS[arm], 7).with_joints(turning_times(ARMS[arm], factor))
    mistake = found(replace(wrong, units=(shown, "mm", "mm")), tmp_path)
    assert mistake is not None
    assert mistake.names == (f"joints in {holds}",)
    first = ARMS[arm].names[0]
    assert f"{holds} in columns of {shown}" in mistake.text
    assert f"name the columns {first}_{holds[:3]}" in mistake.text


_REVERSED = [("heavy", "A2"), ("heavy", "A5"), ("heavy", "A6"), ("scara", "Z"), ("seven", "A3")]
_TWINS = {"Z": {"mirrored"}, "A5": {"A4 off by 180 deg"}, "A6": {"A5 off by 180 deg"}}
"""The same arm with a free tool: half a turn of the joint before turns the axis round."""


@pytest.mark.sampled
@pytest.mark.parametrize(("arm", "joint"), _REVERSED)
def test_a_joint_that_runs_the_other_way(arm: str, joint: str, tmp_path: Path) -> None:
    wrong = day(ARMS[arm], 8).with_joints(joints_times(ARMS[arm], {joint: -1.0}))
    assert names(wrong, tmp_path) == {f"{joint} reversed"} | _TWINS.get(joint, set())


def turned(arm: Arm, degrees: dict[str, float]) -> Callable[[Array], Array]:
    return lambda q: q + np.radians([degrees.get(name, 0.0) for name in arm.names])


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("arm", "joint", "degrees", "markers"),
    [
        (HEAVY, "A2", 90, 1),
        (HEAVY, "A3", -90, 3),
        (SCARA, "J2", 180, 1),
        (SEVEN, "A4", 90, 3),
    ],
)
def test_a_zero_of_another_convention(
    arm: Arm, joint: str, degrees: float, markers: int, tmp_path: Path
) -> None:
    wrong = day(arm, 17, markers=markers).with_joints(turned(arm, {joint: degrees}))
    mistake = surely(wrong, tmp_path)
    assert mistake.names == (f"{joint} off by {degrees:g} deg",)
    back = "180" if degrees == 180 else f"{-degrees:g}"
    assert f"add {back} deg to {joint}" in mistake.text


def test_half_a_turn_that_another_sign_explains_as_well(tmp_path: Path) -> None:
    wrong = day(HEAVY, 17).with_joints(turned(HEAVY, {"A4": 180}))
    assert names(wrong, tmp_path) == {"A4 off by 180 deg", "A5 reversed"}


def test_a_zero_that_base_or_tool_takes_up(tmp_path: Path) -> None:
    """Nobody sees it, and it harms nobody; where the base is known it is said."""
    wrong = day(HEAVY, 17).with_joints(turned(HEAVY, {"A1": 90}))
    assert found(wrong, tmp_path) is None
    known = replace(wrong, effects=("tool", "geometry"))
    known = known.with_points(lambda p: (p - known.place[1]) @ known.place[0])
    assert names(known, tmp_path) == {"A1 off by 90 deg"}


def test_two_zeros_of_another_convention(tmp_path: Path) -> None:
    wrong = day(HEAVY, 18).with_joints(turned(HEAVY, {"A2": 90, "A3": -90}))
    assert names(wrong, tmp_path) == {"A2 off by 90 deg and A3 off by -90 deg"}


def test_a_zero_off_by_no_quarter_is_no_convention(tmp_path: Path) -> None:
    assert found(day(HEAVY, 18).with_joints(turned(HEAVY, {"A2": 30})), tmp_path) is None


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
    ("arm", "one", "other"),
    [(HEAVY, 1, 2), (HEAVY, 4, 5), (SCARA, 1, 3), (SEVEN, 0, 6)],
)
def test_two_joints_swapped(arm: Arm, one: int, other: int, tmp_path: Path) -> None:
    order = np.arange(arm.dof)
    order[[one, other]] = other, one
    wrong = day(arm, 9).with_joints(lambda q: q[:, order])
    assert names(wrong, tmp_path) == {f"{arm.names[one]} and {arm.names[other]} swapped"}


@pytest.mark.parametrize(
    ("arm", "before", "joint", "sign"), [(HEAVY, 1, 2, 1.0), (SCARA, 0, 1, -1.0)]
)
def test_a_joint_counted_from_the_base(
    arm: Arm, before: int, joint: int, sign: float, tmp_path: Path
) -> None:
    def from_the_base(q: Array) -> Array:
        q = q.copy()
        q[:, joint] += sign * q[:, before]
        return q

    word = "-" if sign > 0.0 else "+"
    wrong = day(arm, 10).with_joints(from_the_base)
    assert names(wrong, tmp_path) == {f"{arm.names[joint]} {word} {arm.names[before]}"}


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


def test_exchanged_everywhere_harms_only_where_the_places_are_known(tmp_path: Path) -> None:
    every = day(seed=12).with_points(exchanged_at(range(50)))
    assert found(every, tmp_path) is None
    mistake = found(replace(every, effects=("base", "geometry")), tmp_path)
    assert mistake is not None
    assert mistake.names == ("m1 and m2 exchanged",)


@pytest.mark.parametrize(
    ("effects", "lacks"),
    [
        (("tool", "geometry"), "base"),
        (("geometry",), "base and tool"),
        (("joint_offset",), "base and tool"),
        (("base", "geometry"), "tool"),
    ],
)
def test_what_the_model_takes_as_known_and_is_elsewhere(
    effects: tuple[str, ...], lacks: str, tmp_path: Path
) -> None:
    wrong = day(seed=16)
    elsewhere = np.add(wrong.markers, [0.1, -0.2, 0.15])
    wrong = replace(wrong, effects=effects, markers=elsewhere)
    mistake = found(wrong, tmp_path)
    assert mistake is not None
    assert mistake.names == (f"{lacks} taken as known",)
    assert "to [model] effects" in mistake.text


def test_gross_errors_beside_a_mistake(tmp_path: Path) -> None:
    def gross(points: Array) -> Array:
        points = points.copy()
        points[[7, 30]] += [[[2.0, 0.0, 1.0]], [[0.0, -0.4, 0.1]]]
        return points

    wrong = day(seed=13).with_joints(joints_times(HEAVY, {"A4": -1.0}))
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
    assert recognised(model, mirrored, far).names == ("mirrored",)
    q = table.poses.q * np.where(np.arange(model.robot.dof) == 2, -1.0, 1.0)
    reversed_ = replace(table, poses=replace(table.poses, q=q))
    assert recognised(model, reversed_, far).names == (f"{model.robot.joints[2]} reversed",)


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
