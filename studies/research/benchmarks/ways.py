"""Ways between thirty poses: whether they are free, how many are straight, how long the day takes.

    python -m studies.research.benchmarks.ways [--arm NAME] .. [--days 5] [--json FILE]

Thirty poses are drawn at which nothing is met and a marker is seen, ordered, and joined. MuJoCo then
looks for contacts of the same capsules and obstacles every half degree. The arms stand among a table, a
fence and a tracker's stand: the demo's KR 270, a UR10, and the KR 270 on a track of three metres. Their
shapes and speeds are written here by hand, about those of the makers' drawings.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from calib import Cell
from calib.arrays import Array
from calib.cell.planned import Box
from calib.poses import poses_at
from doe.constraints import constraints_of, scene_of, visible
from doe.constraints.scene import BASE, named_capsules
from doe.constraints.self_collision import SelfCollision
from doe.day.day import PlannedDay, day_of, quickest_order
from doe.day.duration import durations
from studies.demo.embedded import embedded_text
from studies.research.bench import Output, Row, bench, cell_from, clocked, each, several, table
from studies.research.cameras import quaternion

_POSES, _STEP = 30, np.radians(0.5)

_KR270 = """
[robot.capsules_mm]
base = [{ from = [0, 0, 150], to = [0, 0, 300], radius = 330 }]
A1 = [{ from = [0, 0, 0], to = [350, 0, 0], radius = 250 }]
A2 = [{ from = [0, 0, 0], to = [1150, 0, 0], radius = 190 }]
A3 = [{ from = [-150, 0, 0], to = [350, 0, -41], radius = 190 },
      { from = [350, 0, -41], to = [1000, 0, -41], radius = 130 }]
A5 = [{ from = [0, 0, 0], to = [150, 0, 0], radius = 110 }]
tool = [{ from = [20, 0, 0], to = [280, 0, 0], radius = 110 }]
[robot.speed_deg_s]
A1 = 105
A2 = 101
A3 = 107
A4 = 122
A5 = 113
A6 = 175
"""
_UR10 = """
schema = 1
[robot]
urdf = "robot.urdf"
base = "base"
tip = "tool"
[robot.capsules_mm]
base = [{ from = [0, 0, 40], to = [0, 0, 60], radius = 95 }]
j1 = [{ from = [0, 0, 0], to = [0, 176, 0], radius = 85 }]
j2 = [{ from = [0, 0, 0], to = [0, 0, 612], radius = 75 }]
j3 = [{ from = [0, 0, 0], to = [0, 0, 572], radius = 60 }]
j4 = [{ from = [0, 0, 0], to = [0, 115, 0], radius = 55 }]
j5 = [{ from = [0, 0, 0], to = [0, 0, 115], radius = 50 }]
tool = [{ from = [0, 0, -20], to = [0, 0, 120], radius = 45 }]
[robot.speed_deg_s]
j1 = 120
j2 = 120
j3 = 180
j4 = 180
j5 = 180
j6 = 180
[markers_mm]
m1 = [60, 0, 130]
m2 = [-40, 50, 130]
m3 = [-40, -50, 130]
[instrument]
sigma_mm = 0.02
position_mm = [1700, -1200, 600]
[model]
effects = ["base", "tool", "geometry"]
[design]
margin_mm = 20
"""
_LENGTHS = (
    ("0 0 0.1273", "0 0 1"), ("0 0.220941 0", "0 1 0"), ("0 -0.1719 0.612", "0 1 0"),
    ("0 0 0.5723", "0 1 0"), ("0 0.1149 0", "0 0 1"), ("0 0 0.1157", "0 1 0"),
)  # fmt: skip


def _ur10() -> str:
    """A UR10 that stands upright at zero, about the maker's lengths."""
    links = "".join(
        f'<link name="{n}"/>' for n in ("base", *(f"l{k}" for k in range(1, 7)), "tool")
    )
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="{"base" if k == 1 else f"l{k - 1}"}"/>'
        f'<child link="l{k}"/><origin xyz="{at}"/><axis xyz="{axis}"/>'
        '<limit lower="-3.14" upper="3.14" effort="0" velocity="0"/></joint>'
        for k, (at, axis) in enumerate(_LENGTHS, 1)
    )
    tip = (
        '<joint name="t" type="fixed"><parent link="l6"/><child link="tool"/>'
        '<origin xyz="0 0.0922 0" rpy="-1.5708 0 0"/></joint>'
    )
    return f'<robot name="ur10">{links}{joints}{tip}</robot>'


def _boxes(*boxes: tuple[tuple[float, ...], tuple[float, ...]]) -> str:
    """Tables of boxes, centre and size in mm."""
    return "".join(
        f'\n[[design.obstacle]]\ntype = "box"\ncenter_mm = {list(c)}\nsize_mm = {list(s)}\n'
        for c, s in boxes
    )


_FENCE = ((2600, -1800, 700), (400, 400, 1400)), ((-2300, 0, 1000), (50, 4600, 2000))
_KR270_CELL = _boxes(
    ((1900, 0, 350), (800, 1400, 700)), ((0, 2300, 1000), (6000, 50, 2000)), *_FENCE
)
_TRACK_CELL = _boxes(((2100, 1500, 350), (800, 3000, 700)), *_FENCE)
_UR10_CELL = _boxes(
    ((0, 0, -30), (1600, 1600, 40)),
    ((700, 0, 150), (400, 600, 300)),
    ((0, 900, 700), (2000, 40, 1600)),
    ((-800, 0, 900), (400, 800, 40)),
)
_TRACK = """<link name="track"/><joint name="E1" type="prismatic"><parent link="track"/>
<child link="base_link"/><axis xyz="0 1 0"/>
<limit lower="0" upper="3" effort="0" velocity="1"/></joint></robot>"""


def _kr270(sight: bool = False, track: bool = False) -> Cell:
    text = embedded_text("cell.toml").replace('"kr270.urdf"', '"robot.urdf"')
    text = re.sub(r"levels = \{ A2.*", "floor_mm = 0\nmargin_mm = 30", text, count=1)
    text = re.sub(r"effects = \[.*\]", 'effects = ["base", "tool", "geometry"]', text)
    text = re.sub(r"\[(model.knots_deg|load)\].*?\n\n", "\n", text, flags=re.S)
    own = "position_mm = [2600, -1800, 1500]\n" + "keep_sight = true\n" * sight
    text = text.replace("[instrument]\n", f"[instrument]\n{own}") + _KR270
    urdf = embedded_text("kr270.urdf")
    if not track:
        return cell_from(text + _KR270_CELL, urdf)
    text = text.replace('"base_link"', '"track"').replace("base = [{ from", "E1 = [{ from")
    return cell_from(text + _TRACK_CELL, urdf.replace("</robot>", _TRACK))


ARMS: dict[str, Callable[[], Cell]] = {
    "KR 270": _kr270,
    "KR 270, sight kept": lambda: _kr270(sight=True),
    "KR 270 on a track": lambda: _kr270(track=True),
    "UR10": lambda: cell_from(_UR10 + _UR10_CELL, _ur10()),
}


def thirty(cell: Cell, seed: int) -> Array:
    """Poses at which nothing is met and a marker is seen."""
    drawn = cell.robot.sobol(4096, seed)
    scene = scene_of(cell, drawn)
    fit = np.all([own.allows(scene) for own in constraints_of(cell)], axis=0)
    return np.asarray(drawn[fit & visible(scene).any(axis=1)][:_POSES])


def day(arm: str, seed: int) -> Row:
    """One day: seconds of planning on a processor, ways, and durations beside other orders."""
    cell = ARMS[arm]()
    q = thirty(cell, seed)
    found, planned = clocked(lambda: day_of(cell, poses_at(q[quickest_order(cell, q)])))
    other = {"random": q, "nearest": q[_nearest(cell, q)]}
    longer = {name: day_of(cell, poses_at(own), around=False).moving for name, own in other.items()}
    return {
        "arm": arm,
        "planning_s": planned,
        "straight": found.direct,
        "around": sum(len(way.points) > 2 for way in found.ways),
        "unknown": len(found.blocked),
        "contacts": sum(_contacts(cell, found)),
        "moving_s": found.moving,
        "above_bound": found.moving / found.least_moving - 1.0,
        **{f"{name}_s": own for name, own in longer.items()},
    }


def _nearest(cell: Cell, q: Array) -> list[int]:
    """From the first pose to the nearest that is left, whatever is in between."""
    way, apart = [0], durations(cell, q[:, None] - q)
    while len(way) < len(q):
        left = np.setdiff1d(np.arange(len(q)), way)
        way.append(int(left[apart[way[-1], left].argmin()]))
    return way


def _contacts(cell: Cell, found: PlannedDay) -> Iterator[int]:
    """Of each proved way, how many of MuJoCo's looks every half degree, or 5 mm, find a contact."""
    import mujoco

    model, wanted = in_mujoco(cell)
    data = mujoco.MjData(model)
    for way in found.ways:
        hits = 0
        for a, b in zip(way.points[:-1], way.points[1:], strict=True):
            looks = int(np.abs(b - a).max() / _STEP) + 2
            for q in a + np.linspace(0.0, 1.0, looks)[:, None] * (b - a):
                data.qpos[:] = q
                mujoco.mj_kinematics(model, data)
                mujoco.mj_collision(model, data)
                hits += any(tuple(sorted(pair)) in wanted for pair in data.contact.geom.tolist())
        yield hits if way.free else 0


def in_mujoco(cell: Cell) -> tuple[Any, set[tuple[int, int]]]:
    """The arm among its boxes as MuJoCo's model, and the pairs of geoms that must keep apart."""
    import mujoco

    robot, spec = cell.robot, mujoco.MjSpec()
    bodies = [spec.worldbody]
    for k in range(robot.dof + 1):
        T = robot.origins[k]
        body = bodies[-1].add_body(pos=T[:3, 3], quat=quaternion(T[:3, :3]))
        if k < robot.dof:
            slides = robot.prismatic[k]
            kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
            body.add_joint(type=kind, axis=robot.axes[k])
        body.mass, body.inertia, body.explicitinertial = 1.0, np.ones(3), True
        bodies.append(body)
    shapes = list(named_capsules(cell))
    for number, (body, _, own) in enumerate(shapes):
        ends = np.array([*own.start, *own.end])
        kind = mujoco.mjtGeom.mjGEOM_CAPSULE
        bodies[body].add_geom(name=f"c{number}", type=kind, fromto=ends, size=[own.radius, 0, 0])
    boxes = [own for own in cell.design.obstacles if isinstance(own, Box)]
    for number, box in enumerate(boxes):
        T = box.T_base_box
        spec.worldbody.add_geom(
            name=f"b{number}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=box.half,
            pos=T[:3, 3],
            quat=quaternion(T[:3, :3]),
        )
    model = spec.compile()
    capsules = [model.geom(f"c{number}").id for number in range(len(shapes))]
    still = [model.geom(f"b{number}").id for number in range(len(boxes))]
    moving = [own for own, (body, _, _) in zip(capsules, shapes, strict=True) if body != BASE]
    clear = next(own for own in constraints_of(cell) if isinstance(own, SelfCollision))
    pairs = [(capsules[i], capsules[j]) for i, j in clear.pairs]
    pairs += [(a, b) for a in still for b in moving]
    return model, {(min(pair), max(pair)) for pair in pairs}


@bench(several("--arm", tuple(ARMS)), days=5, days_help="Draws of thirty poses for each arm.")
def main(arm: tuple[str, ...], days: int, seed: int) -> Output:
    """Print, for each arm, the worst of its days."""
    rows = each(day, [(name, seed + k) for name in arm for k in range(days)])
    return [table([_over([row for row in rows if row["arm"] == name]) for name in arm])], rows


def _over(rows: list[Row]) -> Row:
    """The days of one arm in a line."""
    total = {key: sum(row[key] for row in rows) for key in rows[0] if key != "arm"}
    return {
        "arm": rows[0]["arm"],
        "straight": f"{total['straight']} of {len(rows) * (_POSES - 1)}",
        "over points": total["around"],
        "unknown": total["unknown"],
        "contacts": total["contacts"],
        "planning, most [s of a processor]": f"{max(row['planning_s'] for row in rows):.1f}",
        "moving [s]": f"{total['moving_s'] / len(rows):.0f}",
        "above bound, most": f"{100 * max(row['above_bound'] for row in rows):.1f} %",
        "nearest": f"{total['nearest_s'] / total['moving_s']:.2f}",
        "random": f"{total['random_s'] / total['moving_s']:.2f}",
    }


if __name__ == "__main__":
    main()
