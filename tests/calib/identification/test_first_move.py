"""What was read before the first move says nothing of lost motion, and must not mislead."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import calib
from calib import Cell, Measurements
from calib.arrays import Array
from calib.identification import Identification

HALF = np.array([2e-5, 1.8e-5, 2.5e-5])  # rad, of each joint
SOFT = 2e-7  # rad/(N m), of A2
EXPECTED = {
    "joint_compliance:A2.compliance": SOFT,
    **{f"backlash:A{k}.half_width": half for k, half in enumerate(HALF, 1)},
}
MARKERS = np.array([[0.05, 0.02, 0.0], [-0.03, 0.06, 0.04], [0.0, -0.07, 0.05]])
URDF = """<robot name="three">
<link name="base"/><link name="l1"/><link name="l2"/><link name="tip"/>
<joint name="A1" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0 0 0.4"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="0" velocity="1"/></joint>
<joint name="A2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.1 0 0.2"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="0" velocity="1"/></joint>
<joint name="A3" type="revolute"><parent link="l2"/><child link="tip"/><origin xyz="0.8 0 0"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="0" velocity="1"/></joint>
</robot>"""
CELL = """schema = 1
[robot]
urdf = "robot.urdf"
base = "base"
tip = "tip"
[markers_mm]
{markers}
[instrument]
sigma_mm = 0.02
[model]
effects = ["base", "tool", "joint_compliance:A2", "backlash"]
size_prior = "off"  # what the readings say by themselves
"""


def turns(axis: str, angles: Array) -> Rotation:
    return Rotation.from_euler(axis, angles[:, None])


def arm(q: Array, p: Array) -> tuple[Array, Array]:
    """Points (m, M, 3) of markers, and the torque (m,) of a newton upwards at the tip about A2."""
    around = turns("z", q[:, 0])
    upper, fore = around * turns("y", q[:, 1]), around * turns("y", q[:, 1] + q[:, 2])
    reach = upper.apply([0.8, 0.0, 0.0])
    shoulder = around.apply([0.1, 0.0, 0.6])
    tip = (shoulder + reach)[:, None]
    torque = (np.cross(reach, [0.0, 0.0, 1.0]) * around.apply([0.0, 1.0, 0.0])).sum(axis=1)
    return tip + np.stack([fore.apply(own) for own in p], axis=1), torque


@dataclass(frozen=True)
class Truth:
    """A plan, free and loaded, of which the first reading was reached by an unrecorded move."""

    q: Array
    force: Array
    approach: Array

    @classmethod
    def drawn(cls) -> Truth:
        rng = np.random.default_rng(3)
        q = np.repeat(rng.uniform([-2.5, -2.0, -2.4], [2.5, 0.3, 2.4], (14, 3)), 2, axis=0)
        force = np.tile([0.0, -600.0], 14)
        approach = np.sign(np.diff(q[::2], axis=0, prepend=q[:1] - [[1.0, -1.0, 1.0]]))
        return cls(q, force, np.repeat(approach, 2, axis=0))

    def points(self) -> Array:
        """A2 gives by the torque of the load, which hangs in the tip's origin, on the axis of A3."""
        dq = self.approach * HALF
        dq[:, 1] += SOFT * self.force * arm(self.q, MARKERS)[1]
        return arm(self.q + dq, MARKERS)[0]

    def day(self, folder: Path, sign: float, told: bool = False) -> tuple[Cell, Measurements]:
        """The files of a day, its noise turned round or not; ``told``: with columns of the approach."""
        noise = sign * np.random.default_rng(1).normal(size=(28, 3, 3)) * 2e-5
        points = Rotation.from_euler("xyz", [0.3, -0.8, 2.0]).apply(self.points().reshape(-1, 3))
        points = np.add(points.reshape(-1, 3, 3), [2.0, -1.0, 0.5]) + noise
        head = ["pose", "marker", *(f"A{k}_deg" for k in (1, 2, 3)), "fz_N", "x_mm", "y_mm", "z_mm"]
        lines = [",".join(head + [f"approach_A{k}" for k in (1, 2, 3)] * told)]
        for i, q in enumerate(np.degrees(self.q)):
            for j, p in enumerate(points[i] * 1e3, 1):
                own = [*q, self.force[i], *p, *(self.approach[i] if told else ())]
                lines.append(f"p{i:02d},m{j}," + ",".join(f"{v:.9f}" for v in own))
        (folder / "robot.urdf").write_text(URDF)
        shown = "\n".join(f"m{j} = {(p * 1e3).tolist()}" for j, p in enumerate(MARKERS, 1))
        (folder / "cell.toml").write_text(CELL.format(markers=shown))
        (folder / "measurements.csv").write_text("\n".join([*lines, ""]))
        cell = calib.load_cell(folder / "cell.toml")
        return cell, calib.load_measurements(cell, folder / "measurements.csv")


def errors(result: Identification) -> Array:
    """Of compliance and half widths, in standard deviations."""
    ids = [p.id for p in result.model.parameters]
    at = [ids.index(name) for name in EXPECTED]
    return (result.values[at] - list(EXPECTED.values())) / result.std[at]


def test_the_mean_of_days_is_the_truth(tmp_path: Path) -> None:
    """Of two days with opposite noise, which is that of many: the first reading would draw it away."""
    days = [calib.identify(*Truth.drawn().day(tmp_path, sign)) for sign in (1.0, -1.0)]
    assert not any(day.fit.outlier.any() for day in days)
    assert np.abs(errors(days[0]) + errors(days[1])).max() / 2.0 < 0.02


def test_it_says_which_reading_took_no_part(tmp_path: Path) -> None:
    result = calib.identify(*Truth.drawn().day(tmp_path, 1.0))
    assert result.waiting == ("p00", "p01")
    assert any("p00, p01 skipped: direction unknown" in w for w in result.warnings)
    assert calib.identify(*Truth.drawn().day(tmp_path, 1.0, told=True)).waiting == ()
