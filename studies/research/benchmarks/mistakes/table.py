"""Mistakes of people on the files of a good day, and what the line that they get must hold."""

from __future__ import annotations

import csv
import io
import operator
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from studies.research.benchmarks.mistakes import robots

Rows = list[list[str]]
Edit = Callable[[Path], None]

MEASURED = "measurements.csv"
IDENTIFY = f"identify cell.toml {MEASURED}"
_INIT = "init arm.urdf -o new"
_DESIGN = "design new/cell.toml --candidates 100 --poses 12 -o plan.csv"
_PROGRAM = "program new/cell.toml new/plan.csv -o plan.src"


@dataclass(frozen=True)
class Mistake:
    """One mistake.

    did : what a person did; call : words after ``posecal``; arm : of ``benchmarks.day.ARMS``
    place, remedy : patterns of where it is and what to do, to be found in what is said
    refused : whether it must end with status 2; otherwise it is a warning or a note
    before : an earlier call in the same folder, whose words do not count
    """

    did: str
    call: str
    place: str
    remedy: str
    edit: Edit = lambda _: None
    refused: bool = True
    arm: str = "6R"
    before: str = ""


def _text(file: str, change: Callable[[str], str]) -> Edit:
    def edit(folder: Path) -> None:
        path = folder / file
        path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")

    return edit


def _table(change: Callable[[list[str], Rows], Rows]) -> Edit:
    """Rows of the measurements changed; the columns' names stay."""

    def edit(text: str) -> str:
        head, *rows = csv.reader(io.StringIO(text))
        out = io.StringIO()
        csv.writer(out, lineterminator="\n").writerows([head, *change(head, rows)])
        return out.getvalue()

    return _text(MEASURED, edit)


def _columns(names: tuple[str, ...], change: Callable[[float], float]) -> Edit:
    def changed(head: list[str], rows: Rows) -> Rows:
        own = [k for k, name in enumerate(head) if name in names]
        return [
            [f"{change(float(x)):.7f}" if k in own else x for k, x in enumerate(row)]
            for row in rows
        ]

    return _table(changed)


def _added(**degrees: float) -> Edit:
    """Joints that count from elsewhere."""

    def edit(folder: Path) -> None:
        for joint, more in degrees.items():
            _columns((f"{joint}_deg",), partial(operator.add, more))(folder)

    return edit


def _swapped(file: str, old: str, new: str) -> Edit:
    return _text(file, lambda text: text.replace(old, new, 1))


def _by_pose(rows: Rows) -> list[Rows]:
    poses: dict[str, Rows] = {}
    for row in rows:
        poses.setdefault(row[0], []).append(row)
    return list(poses.values())


def _shifted(by: int, first: int = 0) -> Edit:
    """The joints of each pose with the points of the one ``by`` later; what has none is left out."""

    def changed(_: list[str], rows: Rows) -> Rows:
        poses = _by_pose(rows)
        found = poses[:first]
        for i in range(first, len(poses)):
            if 0 <= i + by < len(poses):
                pairs = zip(poses[i], poses[i + by], strict=True)
                found.append([[*own[:-3], *other[-3:]] for own, other in pairs])
        return [row for pose in found for row in pose]

    return _table(changed)


def _copied(count: int) -> Edit:
    def changed(_: list[str], rows: Rows) -> Rows:
        copies = [
            [[f"c{i:03d}", *row[1:]] for row in p] for i, p in enumerate(_by_pose(rows)[:count])
        ]
        return [*rows, *(row for pose in copies for row in pose)]

    return _table(changed)


def _stuck(at: int) -> Edit:
    def changed(_: list[str], rows: Rows) -> Rows:
        poses = _by_pose(rows)
        poses[at] = [
            [*own[:-3], *last[-3:]] for own, last in zip(poses[at], poses[at - 1], strict=True)
        ]
        return [row for pose in poses for row in pose]

    return _table(changed)


def _quoted(text: str) -> str:
    head, *rows = text.strip().split("\n")
    shown = [
        [f'"{f.replace(".", ",")}"' if "." in f else f for f in row.split(",")] for row in rows
    ]
    return "\n".join([head, *map(",".join, shown), ""])


def _with_units(text: str) -> str:
    head, rest = text.split("\n", 1)
    units = [name.rpartition("_")[2] if "_" in name else "" for name in head.split(",")]
    return f"{head}\n{','.join(units)}\n{rest}"


def _robot(text: str) -> Edit:
    return lambda folder: _write(folder / "arm.urdf", text)


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="utf-8")


def _planned(text: str) -> Edit:
    """A cell of a robot, and a plan by hand."""

    def edit(folder: Path) -> None:
        _write(folder / "new" / "arm.urdf", text)
        _write(folder / "new" / "cell.toml", _CELL)
        _write(folder / "new" / "plan.csv", _PLAN)

    return edit


_CELL = """schema = 1
name = "arm"
[robot]
urdf = "arm.urdf"
base = "base"
tip = "tool0"
[markers_mm]
m1 = [50, 0, 20]
[instrument]
sigma_mm = 0.01
[model]
effects = ["base", "tool", "geometry"]
"""
_PLAN = """pose,pan_deg,lift_deg,elbow_deg,wrist_deg,roll_deg
p1,0,10,-10,5,0
"""


# fmt: off
_ZEROS = (
    ("6R", "elbow", 90), ("6R", "lift", -90), ("6R", "wrist_1", 90), ("6R", "wrist_1", 180),
    ("7R", "e1", 90), ("SCARA", "J2", 90),
)
_SHIFTED, _FROM_12 = "shifted by one pose", r"shifted by one pose.* from \w+_012"
_FORMS: dict[str, Callable[[str], str]] = {
    "tabs": lambda t: t.replace(",", "\t"),
    "semicolons": lambda t: t.replace(",", ";"),
    "semicolons and decimal commas": lambda t: t.replace(",", ";").replace(".", ","),
    "decimal commas in quotes": _quoted,
    "a title above the columns' names": lambda t: "Report of the day\n" + t,
    "a line of units below them": _with_units,
}
_GRIPPERS = (
    ("a jaw beside a fixed frame (as so101)", robots.JAW, "gripper"),
    ("a gripper's mover alone (as z1)", robots.MOVER, "jointGripper"),
    ("a gripper behind a force sensor (as talos)", robots.LEFT, "gripper_left_joint"),
    ("one sliding finger beside tool0", robots.FINGER, "j7"),
)
_NO_MESH = r"not checked for collisions, as .*l2 \(l2.stl is not there\)"

MISTAKES: tuple[Mistake, ...] = (
    # zeros of joints
    *(Mistake(f"{arm}: {joint} counts from {degrees} deg", IDENTIFY,
              f"the zero of joint {joint} is off by {degrees} deg",
              f"add {180 if degrees == 180 else -degrees} deg to {joint}",
              _added(**{joint: float(degrees)}), arm=arm)
      for arm, joint, degrees in _ZEROS),
    Mistake("6R: lift and elbow count from -90 and 90 deg", IDENTIFY,
            "lift is off by -90 deg and .*elbow",
            "add 90 deg to lift and add -90 deg to elbow", _added(lift=-90.0, elbow=90.0)),
    # rows
    Mistake("points one pose too early", IDENTIFY, _SHIFTED, "down by one pose", _shifted(1)),
    Mistake("points one pose too late", IDENTIFY, _SHIFTED, "up by one pose", _shifted(-1)),
    Mistake("points one pose too early, some held out", f"{IDENTIFY} --holdout 0.3", _SHIFTED,
            "down by one pose", _shifted(1)),
    Mistake("one point lost, all later ones one pose too early", IDENTIFY, _FROM_12,
            "down by one pose", _shifted(1, 12)),
    Mistake("the same, diagnosed", f"diagnose cell.toml {MEASURED}", _FROM_12, "down by one pose",
            _shifted(1, 12)),
    Mistake("20 poses copied under new names", IDENTIFY, r"p\w+_000 and c000", "left out",
            _copied(20), refused=False),
    Mistake("one pose copied under a new name", IDENTIFY, r"p\w+_000 and c000", "left out",
            _copied(1), refused=False),
    Mistake("an instrument that stuck for one pose", IDENTIFY, r"p\w+_005 and p\w+_006",
            "measure these", _stuck(6), refused=False),
    Mistake("a joint of the other sense", IDENTIFY, "elbow runs the other way", "turn the sign",
            _columns(("elbow_deg",), lambda x: -x)),
    Mistake("points in metres under mm", IDENTIFY, "in metres, not in", "multiply",
            _columns(("x_mm", "y_mm", "z_mm"), lambda x: 1e-3 * x)),
    # forms of tables
    *(Mistake(did, IDENTIFY, "line [12]", "save it|write|delete", _text(MEASURED, form))
      for did, form in _FORMS.items()),
    Mistake("degrees for a slide", IDENTIFY, "Z_deg", "name it Z_mm", _swapped(MEASURED, "Z_mm",
            "Z_deg"), arm="SCARA"),
    Mistake("a joint's name in small letters", IDENTIFY, "'j2_deg'", "did you mean 'J2_deg'",
            _swapped(MEASURED, "J2_deg", "j2_deg"), arm="SCARA"),
    Mistake("a column misspelt", IDENTIFY, "markr", "as 'marker'", _swapped(MEASURED, "marker",
            "markr")), # files of robots
    *(Mistake(did, _INIT, f"{joint} moves a gripper and is left out", "To include it: --tip",
              _robot(text), refused=False) for did, text, joint in _GRIPPERS),
    Mistake("control: a wrist called HandYaw stays", _INIT, "5 joints from base to tool0",
            "HandYaw", _robot(robots.TURNING), refused=False),
    Mistake("meshes absent, first cell", _INIT, r"no shape of l2 \(l2.stl is not there\)",
            "put the meshes", _robot(robots.MESHES), refused=False),
    Mistake("meshes absent, planned", _DESIGN, _NO_MESH, "Put the meshes", _robot(robots.MESHES),
            refused=False, before=_INIT),
    Mistake("meshes absent, programmed", _PROGRAM, _NO_MESH, "Put the meshes",
            _planned(robots.MESHES), refused=False),
    Mistake("an arm without a shape, planned", _DESIGN, "not checked for collisions", "capsules_mm",
            _robot(robots.BARE), refused=False, before=_INIT),
    Mistake("a linkage whose joint mimics another", _INIT, "elbow follows lift", "the table tells",
            _robot(robots.LINKAGE), refused=False),
    Mistake("a linkage, programmed", _PROGRAM, "joint elbow: mimics lift", "drive lift by hand",
            _planned(robots.LINKAGE)),
    Mistake("limits of turning joints in degrees", _INIT, "limits of pan", "write radians",
            _robot(robots.DEGREES), refused=False),
    Mistake("a slide's limits in degrees", _INIT, "limits of rail", "write metres",
            _robot(robots.FAR_SLIDE), refused=False),
    Mistake("a slide under [robot.limits_deg]", IDENTIFY, "limits_deg.Z", "limits_mm",
            _text("cell.toml", lambda t: f"{t}[robot.limits_deg]\nZ = [0, 90]\n"), arm="SCARA"),
    Mistake("a flange that only markers know, exported", f"{IDENTIFY} --urdf out.urdf",
            "only the markers", "Program to the markers", refused=False),
    # words
    Mistake("a topic misspelt", "explain backlsh", "backlsh", "did you mean backlash"),
    Mistake("a command misspelt", "identfy cell.toml", "identfy", "Did you mean 'identify'"),
    Mistake("an option misspelt", f"{IDENTIFY} --holdot 0.3", "--holdot", "--holdout"),
    Mistake("a key misspelt", IDENTIFY, "sigmma_mm", "did you mean 'sigma_mm'",
            _swapped("cell.toml", "sigma_mm", "sigmma_mm")),
    Mistake("an effect misspelt", IDENTIFY, "backlsh", "did you mean 'backlash'",
            _swapped("cell.toml", '"geometry"', '"backlsh"')),
    Mistake("an effect at no joint", IDENTIFY, "no place 'J9'", "places are",
            _swapped("cell.toml", '"geometry"', '"backlash:J9"')),
)
"""All that are made, by kind."""
# fmt: on
