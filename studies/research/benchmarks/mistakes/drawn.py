"""Mistakes of people on the files of a good day, and what the line that they get must hold."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from studies.research.benchmarks.mistakes import robots

Rows = list[list[str]]
Edit = Callable[[Path], None]

IDENTIFY = "identify cell.toml measurements.csv"
MEASURED = "measurements.csv"


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
    edit: Edit = field(default=lambda _: None)
    refused: bool = True
    arm: str = "6R"
    before: str = ""


def mistakes() -> Iterator[Mistake]:
    """All that are drawn, by kind."""
    yield from _zeros()
    yield from _rows()
    yield from _tables()
    yield from _files_of_robots()
    yield from _words()


def _zeros() -> Iterator[Mistake]:
    off = r"the zero of joint {} is off by {} deg"
    for arm, joint, degrees in (
        ("6R", "elbow", 90.0),
        ("6R", "lift", -90.0),
        ("6R", "wrist_1", 90.0),
        ("6R", "wrist_1", 180.0),
        ("7R", "e1", 90.0),
        ("SCARA", "J2", 90.0),
    ):
        yield Mistake(
            f"{arm}: {joint} counts from {degrees:g} deg",
            IDENTIFY,
            off.format(joint, f"{degrees:g}"),
            rf"add {180.0 if degrees == 180.0 else -degrees:g} deg to {joint}",
            _added(joint, degrees),
            arm=arm,
        )
    yield Mistake(
        "6R: lift and elbow count from -90 and 90 deg",
        IDENTIFY,
        r"lift is off by -90 deg and .*elbow",
        "add 90 deg to lift and add -90 deg to elbow",
        lambda folder: (_added("lift", -90.0)(folder), _added("elbow", 90.0)(folder))[0],
    )


def _rows() -> Iterator[Mistake]:
    shifted = "shifted by one pose"
    from_12 = rf"{shifted}.* from \w+_012"
    yield Mistake("points one pose too early", IDENTIFY, shifted, "down by one pose", _shifted(1))
    yield Mistake("points one pose too late", IDENTIFY, shifted, "up by one pose", _shifted(-1))
    yield Mistake(
        "points one pose too early, some held out",
        f"{IDENTIFY} --holdout 0.3",
        shifted,
        "down by one pose",
        _shifted(1),
    )
    yield Mistake(
        "one point lost, all later ones one pose too early",
        IDENTIFY,
        from_12,
        "down by one pose",
        _shifted(1, 12),
    )
    yield Mistake(
        "the same, diagnosed",
        "diagnose cell.toml measurements.csv",
        from_12,
        "down by one pose",
        _shifted(1, 12),
    )
    yield Mistake(
        "20 poses copied under new names",
        IDENTIFY,
        r"p\w+_000 and c000",
        "left out",
        _copied(20),
        refused=False,
    )
    yield Mistake(
        "one pose copied under a new name",
        IDENTIFY,
        r"p\w+_000 and c000",
        "left out",
        _copied(1),
        refused=False,
    )
    yield Mistake(
        "an instrument that stuck for one pose",
        IDENTIFY,
        r"p\w+_005 and p\w+_006",
        "measure these",
        _stuck(6),
        refused=False,
    )
    yield Mistake(
        "a joint of the other sense",
        IDENTIFY,
        "elbow runs the other way",
        "turn the sign",
        _column("elbow_deg", lambda x: -x),
    )
    yield Mistake("points in metres under mm", IDENTIFY, "in metres, not in", "multiply", _metres)


def _tables() -> Iterator[Mistake]:
    again = "posecal import"
    for did, edit in {
        "tabs": lambda t: t.replace(",", "\t"),
        "semicolons": lambda t: t.replace(",", ";"),
        "semicolons and decimal commas": lambda t: t.replace(",", ";").replace(".", ","),
        "decimal commas in quotes": _quoted,
        "a title above the columns' names": lambda t: "Report of the day\n" + t,
        "a line of units below them": _with_units,
    }.items():
        where = "line [12]"
        yield Mistake(f"{did}", IDENTIFY, where, again, _text(MEASURED, edit))
        yield Mistake(
            f"{did}, imported",
            IDENTIFY.replace(MEASURED, "new.csv"),
            "The error at",
            ".",
            _text(MEASURED, edit),
            refused=False,
            before=f"import {MEASURED} -o new.csv",
        )
    joined = "import points.txt --joints joints.csv --unit mm --cell cell.toml -o new.csv"
    yield Mistake(
        "two title lines in the instrument's export",
        joined,
        "120 points",
        "wrote",
        _exported("Report of the day\n", ""),
        refused=False,
    )
    yield Mistake(
        "two title lines in the controller's export",
        joined,
        "120 points",
        "wrote",
        _exported("", "Robot 7\n"),
        refused=False,
    )
    yield Mistake(
        "degrees for a slide",
        IDENTIFY,
        "Z_deg",
        "name it Z_mm",
        _text(MEASURED, lambda t: t.replace("Z_mm", "Z_deg")),
        arm="SCARA",
    )
    yield Mistake(
        "a joint's name in small letters",
        IDENTIFY,
        "'j2_deg'",
        "did you mean 'J2_deg'",
        _text(MEASURED, lambda t: t.replace("J2_deg", "j2_deg")),
        arm="SCARA",
    )
    yield Mistake(
        "a column misspelt",
        IDENTIFY,
        "markr",
        "as 'marker'",
        _text(MEASURED, lambda t: t.replace("marker", "markr", 1)),
    )


def _files_of_robots() -> Iterator[Mistake]:
    init = "init arm.urdf -o new"
    for did, text, joint in (
        ("a jaw beside a fixed frame (as so101)", robots.JAW, "gripper"),
        ("a gripper's mover alone (as z1)", robots.MOVER, "jointGripper"),
        ("a gripper behind a force sensor (as talos)", robots.LEFT, "gripper_left_joint"),
        ("one sliding finger beside tool0", robots.FINGER, "j7"),
    ):
        yield Mistake(
            did,
            init,
            f"{joint} moves a gripper and is left out",
            "To include it: --tip",
            _file(text),
            refused=False,
        )
    yield Mistake(
        "control: a wrist called HandYaw stays",
        init,
        "5 joints from base to tool0",
        "HandYaw",
        _file(robots.TURNING),
        refused=False,
    )
    yield Mistake(
        "meshes absent, first cell",
        init,
        r"no shape of l2 \(l2.stl is not there\)",
        "put the meshes",
        _file(robots.MESHES),
        refused=False,
    )
    design = "design new/cell.toml --candidates 100 --poses 12 -o plan.csv"
    unchecked = r"not checked for collisions, as .*l2 \(l2.stl is not there\)"
    yield Mistake(
        "meshes absent, planned",
        design,
        unchecked,
        "Put the meshes",
        _file(robots.MESHES),
        refused=False,
        before=init,
    )
    yield Mistake(
        "meshes absent, programmed",
        "program new/cell.toml new/plan.csv -o plan.src",
        unchecked,
        "Put the meshes",
        _planned(robots.MESHES),
        refused=False,
    )
    yield Mistake(
        "an arm without a shape, planned",
        design,
        "not checked for collisions",
        "capsules_mm",
        _file(robots.BARE),
        refused=False,
        before=init,
    )
    yield Mistake(
        "a linkage whose joint mimics another",
        init,
        "elbow follows lift",
        "the table tells",
        _file(robots.LINKAGE),
        refused=False,
    )
    yield Mistake(
        "a linkage, programmed",
        "program new/cell.toml new/plan.csv -o plan.src",
        "joint elbow: mimics lift",
        "drive lift by hand",
        _planned(robots.LINKAGE),
    )
    yield Mistake(
        "limits of turning joints in degrees",
        init,
        "limits of pan",
        "write radians",
        _file(robots.DEGREES),
        refused=False,
    )
    yield Mistake(
        "a slide's limits in degrees",
        init,
        "limits of rail",
        "write metres",
        _file(robots.FAR_SLIDE),
        refused=False,
    )
    yield Mistake(
        "a slide under [robot.limits_deg]",
        IDENTIFY,
        "limits_deg.Z",
        "limits_mm",
        _text("cell.toml", lambda t: f"{t}[robot.limits_deg]\nZ = [0, 90]\n"),
        arm="SCARA",
    )
    yield Mistake(
        "a flange that only markers know, exported",
        f"{IDENTIFY} --urdf out.urdf",
        "only the markers",
        "Program to the markers",
        refused=False,
    )


def _words() -> Iterator[Mistake]:
    yield Mistake("a topic misspelt", "explain backlsh", "backlsh", "did you mean backlash")
    yield Mistake("a command misspelt", "identfy cell.toml", "identfy", "Did you mean 'identify'")
    yield Mistake("an option misspelt", f"{IDENTIFY} --holdot 0.3", "--holdot", "--holdout")
    yield Mistake(
        "a key misspelt",
        IDENTIFY,
        "sigmma_mm",
        "did you mean 'sigma_mm'",
        _text("cell.toml", lambda t: t.replace("sigma_mm", "sigmma_mm")),
    )
    yield Mistake(
        "an effect misspelt",
        IDENTIFY,
        "backlsh",
        "did you mean 'backlash'",
        _text("cell.toml", lambda t: t.replace('"geometry"', '"backlsh"')),
    )
    yield Mistake(
        "an effect at no joint",
        IDENTIFY,
        "no place 'J9'",
        "places are",
        _text("cell.toml", lambda t: t.replace('"geometry"', '"backlash:J9"')),
    )


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


def _column(name: str, change: Callable[[float], float]) -> Edit:
    def changed(head: list[str], rows: Rows) -> Rows:
        k = head.index(name)
        return [[*row[:k], f"{change(float(row[k])):.7f}", *row[k + 1 :]] for row in rows]

    return _table(changed)


def _added(joint: str, degrees: float) -> Edit:
    return _column(f"{joint}_deg", lambda x: x + degrees)


def _metres(folder: Path) -> None:
    for name in ("x_mm", "y_mm", "z_mm"):
        _column(name, lambda x: 1e-3 * x)(folder)


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


def _file(text: str) -> Edit:
    def edit(folder: Path) -> None:
        (folder / "arm.urdf").write_text(text, encoding="utf-8")

    return edit


def _planned(text: str) -> Edit:
    """A cell of a robot, and a plan by hand."""

    def edit(folder: Path) -> None:
        (folder / "new").mkdir()
        (folder / "new" / "arm.urdf").write_text(text, encoding="utf-8")
        (folder / "new" / "cell.toml").write_text(
            'schema = 1\nname = "arm"\n[robot]\nurdf = "arm.urdf"\nbase = "base"\ntip = "tool0"\n'
            "[markers_mm]\nm1 = [50, 0, 20]\n[instrument]\nsigma_mm = 0.01\n[model]\n"
            'effects = ["base", "tool", "geometry"]\n',
            encoding="utf-8",
        )
        (folder / "new" / "plan.csv").write_text(
            "pose,pan_deg,lift_deg,elbow_deg,wrist_deg,roll_deg\np1,0,10,-10,5,0\n",
            encoding="utf-8",
        )

    return edit


def _exported(above_points: str, above_joints: str) -> Edit:
    """The day as an instrument and a controller write it, with a title above."""

    def edit(folder: Path) -> None:
        with (folder / MEASURED).open(encoding="utf-8") as file:
            head, *rows = csv.reader(file)
        points = [",".join([row[0], row[1], *row[-3:]]) for row in rows]
        joints = [",".join([own[0][0], *own[0][2:-3]]) for own in _by_pose(rows)]
        units = [",,mm,mm,mm"] if above_points else []
        points = ["group,point,x,y,z", *units, *points]
        text = "\n".join([",".join(["pose", *head[2:-3]]), *joints, ""])
        (folder / "points.txt").write_text(
            above_points + "\n".join([*points, ""]), encoding="utf-8"
        )
        (folder / "joints.csv").write_text(above_joints + text, encoding="utf-8")

    return edit
