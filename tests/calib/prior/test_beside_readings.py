"""What a cell says of sizes counts once, whoever asks: estimates by hand, of an arm of plain numpy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import calib
import doe
from calib import Cell, Measurements
from calib.arrays import Array
from calib.diagnosis import Diagnosis
from calib.inference.widths import Key
from tests.plain_arm import shift, turn

Given = tuple[Array, Array, Array, Array]
_POSES, _LINKS, _AXES = 30, (0.3, 0.4, 0.35, 0.1), "zyyx"
SIGMA = 10e-6  # m
MARKERS = np.array([[0.15, 0.02, 0.0], [0.0, 0.12, 0.08], [-0.05, 0.0, 0.16]])
TRANSLATION, ROTATION = 5e-5, 1e-4  # m and rad, of each coordinate of a tip that scatters
ARM = "repeatability_mm = 0.05\nrepeatability_urad = 100"
EXACT = "repeatability_mm = 0"  # else scatter that the readings do not rule out would count
KEYS: tuple[Key, ...] = (
    ("backlash", "j2", "half_width"),
    ("joint_compliance", "j3", "compliance"),
    ("joint_offset", "j2", "offset"),
    ("thermal_expansion", "j2", "growth"),
)
STD = np.array([2e-5, 3e-7, 5e-5, 4e-6])
TRUTH = np.array([0.5, -0.5, 0.7, 0.5]) * STD
WIDTHS = {
    "backlash_urad": 20.0,
    "joint_compliance_urad_per_Nm": 0.3,
    "joint_offset_urad": 50.0,
    "thermal_expansion_um_per_mK": 4.0,
}
PLACE = np.array([0.05, -0.4, 0.7, 1.0, -2.0, 0.5])
URDF = """\
<robot name="arm"><link name="base"/>{links}
{joints}
</robot>
"""
_JOINT = """\
<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0 0 {z}"/><axis xyz="{axis}"/>
<limit lower="-2" upper="2" effort="0" velocity="1"/></joint>"""
CELL = """\
schema = 1
name = "one"
[robot]
urdf = "robot.urdf"
base = "base"
tip = "l4"
{arm}
[markers_mm]
m1 = [150, 20, 0]
m2 = [0, 120, 80]
m3 = [-50, 0, 160]
[instrument]
sigma_mm = 0.01
[model]
effects = ["base", "tool", {kinds}]
"""


def urdf() -> str:
    """The arm as its maker describes it: z, y, y, x."""
    axes = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    names = ["base", "l1", "l2", "l3", "l4"]
    joints = [
        _JOINT.format(k=k + 1, parent=names[k], child=names[k + 1], z=_LINKS[k], axis=axes[axis])
        for k, axis in enumerate(_AXES)
    ]
    links = "".join(f'<link name="{name}"/>' for name in names[1:])
    return URDF.format(links=links, joints="\n".join(joints))


def points(
    q: Array,
    wrench: Array,
    approach: Array,
    warming: Array,
    own: Array,
    markers: Array | None = None,
) -> Array:
    """Markers in the instrument's frame, (m, 3, 3), m.

    own : ndarray, shape (19,), the robot's parameters in the order of KEYS, base, and markers
    """
    gap, soft, offset, growth = own[:4]
    place, found = Rotation.from_rotvec(own[4:7]), []
    markers = MARKERS + own[10:].reshape(3, 3) if markers is None else markers
    for angles, force, came, kelvin in zip(q, wrench, approach, warming, strict=True):
        angles = angles + np.array([0.0, offset + gap * came[1], 0.0, 0.0])
        third, tip = _chain(angles, growth * kelvin)
        for _ in range(2):
            lever = tip[:3, 3] - third[:3, 3]
            torque = third[:3, 1] @ (force[3:] + np.cross(lever, force[:3]))
            third, tip = _chain(angles + np.array([0.0, 0.0, soft * torque, 0.0]), growth * kelvin)
        found.append(place.apply(markers @ tip[:3, :3].T + tip[:3, 3]) + own[7:10])
    return np.array(found)


def _chain(angles: Array, grown: float) -> tuple[Array, Array]:
    """Frames of the third joint, which turns about its y, and of the tip."""
    T, frames = np.eye(4), []
    for k, (link, axis) in enumerate(zip(_LINKS, _AXES, strict=True)):
        T = T @ shift(z=link * (1.0 + grown * (k == 2))) @ turn(axis, float(angles[k]))
        frames.append(T)
    return frames[2], T


def day(
    folder: Path, seed: int, loud: float = 1.0, scatters: bool = False, arm: str = ""
) -> tuple[Cell, Measurements, Given]:
    """A cell, what was read, and the arguments of :func:`points` as they stand in the table.

    loud : of the noise over what the cell states; scatters : whether the tip comes elsewhere each time
    arm : lines of [robot]
    """
    rng = np.random.default_rng(seed)
    q = np.radians(np.round(np.degrees(rng.uniform(-1.8, 1.8, (_POSES, 4))), 6))
    wrench = np.round(rng.normal(size=(_POSES, 6)) * [150.0, 150.0, 150.0, 30.0, 30.0, 30.0], 3)
    came, kelvin = rng.choice([-1.0, 1.0], q.shape), np.round(rng.uniform(-8.0, 8.0, _POSES), 3)
    given, true = (q, wrench, came, kelvin), np.concatenate([TRUTH, PLACE, np.zeros(9)])
    read = points(*given, true)
    if scatters:
        tip, (moved, turned) = (
            points(*given, true, np.zeros((1, 3))),
            rng.normal(size=(2, _POSES, 1, 3)),
        )
        read += TRANSLATION * moved + ROTATION * np.cross(turned, read - tip)
    read += loud * SIGMA * rng.normal(size=read.shape)
    joints = [f"j{k}" for k in range(1, 5)]
    head = ["pose", "marker", *(f"{j}_deg" for j in joints), *(f"approach_{j}" for j in joints)]
    head += ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm", "temperature_degC"]
    lines = [",".join([*head, "x_mm", "y_mm", "z_mm"])]
    rows = np.column_stack([np.degrees(q), came, wrench, 20.0 + kelvin])
    for i, row in enumerate(rows):
        for j, three in enumerate(read[i] * 1e3, 1):
            numbers = (f"{x:.9f}" for x in (*row, *three))
            lines.append(",".join([f"p{i}", f"m{j}", *numbers]))
    kinds = ", ".join(f'"{kind}:{where}"' for kind, where, _ in KEYS)
    (folder / "robot.urdf").write_text(urdf())
    (folder / "cell.toml").write_text(CELL.format(arm=arm, kinds=kinds))
    (folder / "measurements.csv").write_text("\n".join([*lines, ""]))
    cell = calib.load_cell(folder / "cell.toml")
    data = calib.load_measurements(cell, folder / "measurements.csv")
    return cell, data, given


def with_sizes(cell: Cell) -> Cell:
    """The cell whose errors have these widths."""
    return replace(cell, size_prior=WIDTHS)


def by_hand(
    data: Measurements, given: Given, sigma: float, arm: bool = False
) -> tuple[Array, Array]:
    """Mean and standard deviations of the parameters but base and markers, (4,) each, by Bayes.

    arm : whether the tip comes elsewhere each time as ``ARM`` says, beside the noise of each point
    """
    scale = np.concatenate([STD, np.full(15, 1e-4)])
    start = np.concatenate([np.zeros(4), PLACE, np.zeros(9)])
    tip = points(*given, start, np.zeros((1, 3)))
    d = points(*given, start) - tip
    H = np.stack([np.cross(axis, d).reshape(len(d), 9) for axis in np.eye(3)], axis=-1)
    together = np.tile(np.eye(3), (3, 1))
    V = TRANSLATION**2 * together @ together.T + ROTATION**2 * H @ np.swapaxes(H, -1, -2)
    whiten = np.linalg.inv(np.linalg.cholesky(sigma**2 * np.eye(9) + arm * V))

    def off(x: Array) -> Array:
        own = x * scale
        r = (points(*given, own) - data.points).reshape(-1, 9, 1)
        return np.concatenate([(whiten @ r).ravel(), own[:4] / STD])

    found = least_squares(off, start / scale, method="lm", diff_step=1e-5)
    return found.x[:4] * STD, np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))[:4] * STD


def told(found: calib.Identification | Diagnosis) -> tuple[Array, Array]:
    """The same of a result."""
    fit = found.after if isinstance(found, Diagnosis) else found
    cov = fit.covariance * (found.scale**2 if isinstance(found, Diagnosis) else 1.0)
    keys = fit.model.keys
    at = [keys.index(key) for key in KEYS]
    return fit.values[at], np.sqrt(np.diag(cov))[at]


@pytest.mark.parametrize(
    ("loud", "arm"),
    [(1.0, EXACT), (8.0, ""), (1.0, ARM)],
    ids=["as stated", "loud", "an arm that scatters"],
)
def test_it_counts_as_by_hand(tmp_path: Path, loud: float, arm: str) -> None:
    """Under loads, with lost motion and heat: by either approach, and of what is to come."""
    cell, data, given = day(tmp_path, 3, loud, arm == ARM, arm)
    known = with_sizes(cell)
    found = calib.identify(known, data)
    sigma = SIGMA * found.noise.factor
    mean, std = by_hand(data, given, sigma, arm == ARM)
    in_poses = calib.identify(known, data, approach="pose")
    for values, own in (told(found), told(in_poses)):
        np.testing.assert_allclose((values - mean) / std, 0.0, atol=0.02)
        np.testing.assert_allclose(own, std, rtol=0.02)
    keys = found.model.keys
    foreseen = doe.enough(known, data).steps[0].std[[keys.index(key) for key in KEYS]]
    np.testing.assert_allclose(foreseen, told(found)[1], rtol=0.01)
    alone = told(calib.identify(cell, data))[1]
    assert (std < 0.999 * alone).all()


def test_it_is_foreseen_as_it_will_count_where_readings_show_the_scatter(tmp_path: Path) -> None:
    cell, data, _ = day(tmp_path, 3, scatters=True)
    found = calib.identify(with_sizes(cell), data)
    keys = found.model.keys
    steps = doe.enough(with_sizes(cell), data).steps
    np.testing.assert_allclose(
        steps[0].std[[keys.index(key) for key in KEYS]], told(found)[1], rtol=0.01
    )


def test_a_diagnosis_asks_beside_it(tmp_path: Path) -> None:
    """However loud the readings are: fits to first order have it, and the fit in full."""
    cell, data, given = day(tmp_path, 3, 8.0)
    found = calib.diagnose(with_sizes(cell), data)
    assert found.verdict == "no_gap"
    mean, std = by_hand(data, given, SIGMA * found.noise.factor)
    values, own = told(found)
    np.testing.assert_allclose((values - mean) / std, 0.0, atol=0.05)
    np.testing.assert_allclose(own, std, rtol=0.03)
    assert found.after.model.prior_rows == len(KEYS)
