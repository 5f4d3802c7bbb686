"""Public robots with several arms: read, begun, planned and identified, against MuJoCo.

    python -m studies.research.benchmarks.several_arms ROBOT.urdf --tip LINK [--tip LINK ..] [--soft]

``posecal init`` writes the cell, ``posecal design`` plans for it. The true robot is the same file with
the origin of every joint displaced, read by MuJoCo, which has the kinematics and the torques of
gravity; with ``--soft`` its drives yield. What is identified without noise must lead to where MuJoCo
has the markers at other poses. The robot's meshes are not needed.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import click
import numpy as np
from click.testing import CliRunner
from defusedxml.ElementTree import fromstring
from scipy.spatial.transform import Rotation

import calib
import doe
from calib.arrays import Array
from calib.poses import Measurements, Poses, poses_at
from studies.cli import main as posecal
from studies.research.bench import Output, Row, bench, clocked, count, rms_3d, table

_OFF_M, _OFF_RAD = 3e-4, 5e-4
_SOFT = 5e-5  # rad/(N m)
_JUDGED, _CANDIDATES, _ROUNDS = 200, 2000, 40
_KEEP = {
    "fusestatic": "false",
    "discardvisual": "true",
    "boundmass": "1e-9",
    "boundinertia": "1e-9",
}


@dataclass(frozen=True, eq=False)
class InMujoco:
    """A robot in MuJoCo with its joints by name.

    soft : ndarray, shape (n,), rad/(N m) of the joints of the cell
    """

    model: Any
    cell: calib.Cell
    soft: Array

    @classmethod
    def of(cls, text: str, cell: calib.Cell, soft: float) -> InMujoco:
        """From the text of a URDF, without its shapes."""
        import mujoco

        root: Element = fromstring(text)
        for link in root.iter("link"):
            for shape in [e for e in link if e.tag in ("visual", "collision")]:
                link.remove(shape)
        for own in root.iter("inertia"):  # in public files some are of no body; none counts at rest
            own.attrib.update(dict.fromkeys(("ixx", "iyy", "izz"), "0.01"))
            own.attrib.update(dict.fromkeys(("ixy", "ixz", "iyz"), "0"))
        flags = SubElement(root, "mujoco")
        SubElement(flags, "compiler", _KEEP)
        model = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
        turns = ~cell.robot.prismatic
        return cls(model, cell, np.where(turns, soft, 0.0))

    def points(self, q: Array) -> Array:
        """All markers where the drives hold the links, world axes, shape (m, M, 3), m."""
        import mujoco

        robot, data = self.cell.robot, mujoco.MjData(self.model)
        at = [int(self.model.joint(name).qposadr[0]) for name in robot.joints]
        dof = [int(self.model.joint(name).dofadr[0]) for name in robot.joints]
        tips = dict(zip(range(robot.dof + 1, robot.frame_count), robot.tips, strict=True))
        on = [self.model.body(tips[frame]).id for frame in self.cell.marker_frames.tolist()]
        found = []
        for row in q:
            data.qpos[at] = row
            mujoco.mj_forward(self.model, data)
            for _ in range(_ROUNDS if self.soft.any() else 0):
                data.qpos[at] = row - self.soft * data.qfrc_bias[dof]
                mujoco.mj_forward(self.model, data)
            R = data.xmat[on].reshape(-1, 3, 3)
            found.append(np.einsum("kij,kj->ki", R, self.cell.markers) + data.xpos[on])
        return np.array(found)

    def read(self, poses: Poses) -> Measurements:
        """What an exact tracker reads."""
        points = self.points(poses.q)
        seen = np.ones(points.shape[:-1], dtype=bool)
        return Measurements(poses, points, seen, np.full(seen.shape, np.nan))


def displaced(text: str, joints: tuple[str, ...], rng: np.random.Generator) -> str:
    """A URDF in which the origins of these joints are off.

    Where a head or a gripper hangs is not read: were it off, its weight would act elsewhere.
    """
    root: Element = fromstring(text)
    for joint in (own for own in root.findall("joint") if own.get("name") in joints):
        origin = joint.find("origin")
        origin = SubElement(joint, "origin") if origin is None else origin
        xyz, rpy = (
            np.array(origin.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy")
        )
        turned = Rotation.from_euler("xyz", rpy) * Rotation.from_rotvec(
            _OFF_RAD * rng.normal(size=3)
        )
        moved = xyz + _OFF_M * rng.normal(size=3)
        origin.set("xyz", " ".join(map(repr, moved.tolist())))
        origin.set("rpy", " ".join(map(repr, turned.as_euler("xyz").tolist())))
    return tostring(root, encoding="unicode")


def run(robot: Path, tips: tuple[str, ...], base: str, poses: int, soft: bool, seed: int) -> Row:
    """The row of one robot."""
    text, rng = robot.read_text(encoding="utf-8"), np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ends = [word for tip in tips for word in ("--tip", tip)] + (
            ["--base", base] if base else []
        )
        begun = CliRunner().invoke(posecal, ["init", str(robot), "-o", name, *ends])
        if begun.exit_code:
            raise click.ClickException(begun.output)
        cell = calib.load_cell(folder / "cell.toml")
        design = partial(doe.design, cell, poses=poses, candidates=_CANDIDATES)
        plan, planned = clocked(partial(design, seed=seed))
    effects = (*cell.effects, "joint_compliance") if soft else cell.effects
    cell = replace(cell, effects=effects, size_prior={})
    truth = InMujoco.of(displaced(text, cell.robot.joints, rng), cell, _SOFT if soft else 0.0)
    data = truth.read(plan.poses)
    fit, identified = clocked(lambda: calib.identify(cell, data))
    low, high = cell.robot.sample_limits().T
    q = cell.robot.tied(rng.uniform(low, high, (_JUDGED, cell.robot.dof)))
    others = truth.read(poses_at(q))
    off, before = (
        fit.model.predict(values, others.poses) - others.readings
        for values in (fit.values, fit.nominal)
    )
    return {
        "robot": cell.robot.name,
        "tips": " ".join(tips),
        "joints": cell.robot.dof,
        "parameters": fit.choice.rank,
        "efficiency": f"{plan.efficiency:.3f}",
        "expected [mm]": plan.assessment.task_rms * 1e3,
        "nominal [mm]": rms_3d(before) * 1e3,
        "largest error [m]": float(np.abs(off).max()),
        "plan [s]": planned,
        "identify [s]": identified,
    }


@bench(
    click.argument("robot", type=click.Path(exists=True, dir_okay=False, path_type=Path)),
    click.option("--tip", "tips", multiple=True, required=True, help="A link with markers."),
    click.option("--base", default="", help="First link, else the one that init proposes."),
    count("--poses", 40, least=10),
    click.option("--soft", is_flag=True, help="Drives yield under the links' weight."),
)
def main(
    robot: Path, tips: tuple[str, ...], base: str, poses: int, soft: bool, seed: int
) -> Output:
    """Begin, plan and identify a robot with several arms."""
    row = run(robot, tips, base, poses, soft, seed)
    return [table([row])], row


if __name__ == "__main__":
    main()
