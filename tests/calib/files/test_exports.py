"""Point lists and joint files as instruments and controllers write them."""

from __future__ import annotations

import random
import time
from pathlib import Path

import pytest

from calib.errors import InputError
from calib.files.exports import PointList, read_joints, read_points
from calib.files.exports.join import join
from calib.files.exports.matching import name_pattern
from calib.files.exports.points import MeasuredPoint

ROWS = [
    (f"P{k}", f"m{j}", f"{1000.5 * k + 0.125:.6f}", f"{-20.25 * j:.6f}", f"{0.001 * k * j:.6f}")
    for k in range(1, 4)
    for j in range(1, 4)
]
HEAD = "// SA 2022\n// Frame A::WORLD\n// Cartesian\n// Collection,  Group,  Point,  X,  Y,  Z\n\n"


def commas(text: str) -> str:
    return text.replace(".", ",")


STYLES: dict[str, bytes] = {
    "spatialanalyzer": (
        '// "open\n//\n'
        + HEAD
        + "".join(f"A,  {g},  {p},  {x},  {y},  {z}\n" for g, p, x, y, z in ROWS)
    ).encode(),
    "byte order mark, CRLF": b"\xef\xbb\xbf"
    + "".join(f"{g}, {p}, {x}, {y}, {z}\r\n" for g, p, x, y, z in ROWS).encode(),
    "utf-16": "".join(f"{g}\t{p}\t{x}\t{y}\t{z}\r\n" for g, p, x, y, z in ROWS).encode("utf-16"),
    "latin-1, semicolons, decimal commas": (
        "# Prüfer Müller\nGroup;Name;X [mm];Y [mm];Z [mm];Prüfer\n"
        + "".join(commas(f"{g};{p};{x};{y};{z};Jürgen\n") for g, p, x, y, z in ROWS)
    ).encode("latin-1"),
    "tabs, decimal commas": (
        "".join(commas(f"{g}\t{p}\t{x}\t{y}\t{z}\n") for g, p, x, y, z in ROWS)
    ).encode(),
    "blanks": "".join(f"{g}  {p}   {x} {y}  {z} \n" for g, p, x, y, z in ROWS).encode(),
    "blanks, decimal commas": "".join(
        commas(f"{g} {p} {x} {y} {z}\n") for g, p, x, y, z in ROWS
    ).encode(),
    "point first, group last": "".join(f"{p},{x},{y},{z},{g}\n" for g, p, x, y, z in ROWS).encode(),
    "one name": "".join(f"{g}_{p},{x},{y},{z}\n" for g, p, x, y, z in ROWS).encode(),
    "group is the marker": "".join(f"{p},{g},{x},{y},{z}\n" for g, p, x, y, z in ROWS).encode(),
    "quoted names": "".join(f'"A, b";{g};{p};{x};{y};{z}\n' for g, p, x, y, z in ROWS).encode(),
}


def written(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def joint_file(folder: Path, poses: tuple[str, ...] = ("P1", "P2", "P3")) -> Path:
    rows = "".join(f"{pose},{10 * k}.5,-0.25\n" for k, pose in enumerate(poses))
    return written(folder, "joints.csv", f"pose,A1_deg,A2_deg\n{rows}")


@pytest.mark.parametrize("style", STYLES)
def test_every_style_gives_the_same_table(tmp_path: Path, style: str) -> None:
    points = read_points(written(tmp_path, "points.txt", STYLES[style]), None if "[mm]" in
                         STYLES[style].decode("latin-1") else "mm")  # fmt: skip
    joined = join([points], read_joints(joint_file(tmp_path)))
    assert [tuple(row[:2]) + tuple(row[-3:]) for row in joined.rows] == ROWS
    assert joined.markers == {"m1": 3, "m2": 3, "m3": 3}
    assert joined.columns == ("pose", "marker", "A1_deg", "A2_deg", "x_mm", "y_mm", "z_mm")


def test_random_lists_survive_with_every_digit(tmp_path: Path) -> None:
    rng = random.Random(0)
    numbers = [
        [
            rng.choice("+- ").strip() + f"{rng.uniform(0, 5000):.{rng.randint(1, 12)}f}"
            for _ in "xyz"
        ]
        for _ in range(200)
    ]
    for mark, decimal in ((";", ","), ("\t", ","), (",", "."), (" ", ".")):
        text = "".join(
            mark.join([f"p{k}", "m1", *(n.replace(".", decimal) for n in row)]) + "\n"
            for k, row in enumerate(numbers)
        )
        found = read_points(written(tmp_path, "p.txt", text), "mm")
        assert [list(point.values) for point in found.points] == numbers


@pytest.mark.parametrize(
    ("head", "unit", "x"),
    [
        ("// Units: Meters\n", "m", "1234.5678"),
        ("# Einheit = mm\n", "mm", "1.2345678"),
        ("// X [in], Y [in], Z [in]\n", "in", "31.35802212"),
        ("Point,X_m,Y_m,Z_m\n", "m", "1234.5678"),
        ("Point Name,X (inch),Y (inch),Z (inch)\n", "in", "31.35802212"),
    ],
)
def test_unit_is_read_where_it_stands(tmp_path: Path, head: str, unit: str, x: str) -> None:
    path = written(tmp_path, "p.csv", f"{head}P1_m1,1.2345678,0,0\n")
    found = read_points(path)
    assert (found.unit, found.points[0].values[0]) == (unit, x)
    with pytest.raises(InputError, match=f"states {unit}, --unit says"):
        read_points(path, "in" if unit != "in" else "mm")


def test_uncertainties_become_one_standard_deviation(tmp_path: Path) -> None:
    text = (
        "Point,X [m],Y [m],Z [m],Ux [m],Uy [m],Uz [m],RMS\nP1_m1,1,2,3,0.00001,0.00002,0.00002,9\n"
    )
    found = read_points(written(tmp_path, "p.csv", text))
    assert float(found.points[0].sigma) == pytest.approx(0.01 * 3**0.5, rel=1e-5)  # mm
    assert found.ignored == ("RMS",)
    named = read_points(
        written(tmp_path, "q.csv", "P1_m1 1 2 3 0.01 0.02 0.02\n"), "mm",
        ["point", "x", "y", "z", "ux", "uy", "uz"],
    )  # fmt: skip
    assert float(named.points[0].sigma) == pytest.approx(0.03 / 3**0.5, rel=1e-5)


def test_time_of_a_pose_is_that_of_its_first_point(tmp_path: Path) -> None:
    text = "Group,Point,X [mm],Y [mm],Z [mm],Time stamp\n" + "".join(
        f"P{k},m{j},1,2,3,2024-05-06 10:{k:02d}:{j:02d}\n" for k in (1, 2) for j in (1, 2)
    )
    points = read_points(written(tmp_path, "p.csv", text))
    joined = join([points], read_joints(joint_file(tmp_path, ("P1", "P2"))))
    assert joined.columns[-1] == "time_s"
    assert [row[-1] for row in joined.rows] == ["0", "0", "60", "60"]


@pytest.mark.parametrize("times", [("1.5", "nan"), ("1.5", ""), ("noon", "noon")])
def test_times_that_cannot_be_used_are_left_out_and_said(
    tmp_path: Path, times: tuple[str, str]
) -> None:
    text = "Point,X [mm],Y [mm],Z [mm],Time\nP1_m1,1,2,3,{}\nP2_m1,1,2,3,{}\n".format(*times)
    points = read_points(written(tmp_path, "p.csv", text))
    joined = join([points], read_joints(joint_file(tmp_path, ("P1", "P2"))))
    assert "time_s" not in joined.columns
    assert "left out" in joined.notes[0]


def test_poses_by_order_and_by_rounds(tmp_path: Path) -> None:
    joints = read_joints(written(tmp_path, "j.csv", "A1 [deg];E1 [mm]\n1,5;700,25\n2,5;800,5\n"))
    assert joints.joints == ("A1_deg", "E1_mm")
    rounds = "1, 1.5, 2.5, 3.5\n2, 1.5, 2.5, 4.5\n" * 2
    points = read_points(written(tmp_path, "p.txt", rounds), "mm")
    joined = join([points], joints, names="{marker}", by_order=True)
    assert [row[:4] for row in joined.rows] == [
        ["p0000", "1", "1.5", "700.25"], ["p0000", "2", "1.5", "700.25"],
        ["p0001", "1", "2.5", "800.5"], ["p0001", "2", "2.5", "800.5"],
    ]  # fmt: skip
    broken = read_points(written(tmp_path, "b.txt", rounds.replace("2, ", "1, ", 1)), "mm")
    with pytest.raises(InputError, match="line 2: marker '1' breaks the round"):
        join([broken], joints, names="{marker}", by_order=True)


def test_one_marker_and_one_file_for_each(tmp_path: Path) -> None:
    joints = read_joints(joint_file(tmp_path))
    single = "".join(f"P{k}, {k}.5, 2.5, 3.5\n" for k in (1, 2, 3))
    lists = [read_points(written(tmp_path, f"m{j}.txt", single), "mm") for j in (1, 2)]
    joined = join(lists, joints)
    assert (joined.pattern, joined.markers) == ("{marker}/{pose}", {"m1": 3, "m2": 3})
    alone = join(lists[:1], joints, marker="m9")
    assert (alone.pattern, alone.markers) == ("{pose}", {"m9": 3})


def test_what_has_no_counterpart_is_refused_or_named(tmp_path: Path) -> None:
    text = "".join(f"{g}_{p},{x},{y},{z}\n" for g, p, x, y, z in ROWS) + "NEST,1.5,2.5,3.5\n"
    points = read_points(written(tmp_path, "p.txt", text), "mm")
    joints = read_joints(joint_file(tmp_path, ("P2", "P3", "P4")))
    with pytest.raises(InputError, match="line 10: 'NEST' names no pose and marker"):
        join([points], joints)
    joined = join([points], joints, partial=True)
    assert (joined.poses, joined.without_points) == (("P2", "P3"), ("P4",))
    assert (joined.without_joints, joined.strays) == ({"P1": 3}, ("NEST",))
    assert len(joined.rows) == 6


def test_a_point_measured_twice_is_refused_with_both_lines(tmp_path: Path) -> None:
    lists = [
        read_points(written(tmp_path, name, "P1_m1,1,2,3.5\nP2_m1,1,2,3.5\n"), "mm")
        for name in ("a.txt", "b.txt")
    ]
    joints = read_joints(joint_file(tmp_path, ("P1", "P2")))
    with pytest.raises(InputError, match=r"b.txt: line 1: .*'m1' in line 1 of .*a.txt already"):
        join(lists, joints)


@pytest.mark.parametrize(
    "line", ["=" * 60_000 + "x", "A1 " + "1" * 60_000 + "x", "x{" + " " * 60_000]
)
def test_hostile_lines_take_no_time(tmp_path: Path, line: str) -> None:
    """Minutes, where an expression tries every way to part a line."""
    path, begun = written(tmp_path, "long.txt", f"{line}\n{line}\n"), time.process_time()
    for read in (read_points, read_joints):
        with pytest.raises(InputError):
            read(path)
    assert time.process_time() - begun < 2.0


def test_kuka_axis_list(tmp_path: Path) -> None:
    text = "DECL E6AXIS P1={A1 10.5,A2 -90.25,E1 700.0}\nP2 {A1 1.0, A2 2.0, E1 3.0}\n"
    text += "GLOBAL AXIS P3 : A1 1, A2 -9e1, E1 3\n"
    path = written(tmp_path, "axes.txt", text)
    with pytest.raises(InputError, match="'E1' has no unit"):
        read_joints(path)
    found = read_joints(path, unit="mm")
    assert found.joints == ("A1_deg", "A2_deg", "E1_mm")
    assert [(row.pose, row.values) for row in found.rows] == [
        ("P1", ("10.5", "-90.25", "700.0")),
        ("P2", ("1.0", "2.0", "3.0")),
        ("P3", ("1", "-9e1", "3")),
    ]


def test_joints_carry_the_rest_of_the_contract(tmp_path: Path) -> None:
    text = (
        "Name;J1;J2;fz_N;temperature_degC;station;session;approach_J1;J2_Nm\n"
        "P1;1,5;2,5;-10,5;21,25;S 1;Mon;-1;7,5\n"
    )
    found = read_joints(written(tmp_path, "j.csv", text), unit="rad", rename=["q1", "q2"])
    assert found.joints == ("q1_rad", "q2_rad")
    assert found.carried == (
        "fz_N",
        "temperature_degC",
        "station",
        "session",
        "approach_q1",
        "q2_Nm",
    )
    assert found.rows[0].values == ("1.5", "2.5", "-10.5", "21.25", "S 1", "Mon", "-1", "7.5")


POINT_FAULTS = {
    "strange unit": ("Point,X [ft],Y [ft],Z [ft]\nP,1,2,3\n", None, "'ft' is not known"),
    "two units": ("Point,X [mm],Y [m],Z [m]\nP,1,2,3\n", None, "states two units, m and mm"),
    "thousands": ("P1\t1,500\t2,500\t3,500\n", "mm", "line 1: the comma in '1,500' may be"),
    "word": ("P1_m1,1.5,2.5,3.5\nP1_m2,1.5,x,3.5\n", "mm", "line 2: field 3: 'x' is no number"),
    "nan": ("Point,X,Y,Z\nP1_m1,1.5,nan,3.5\n", "mm", "line 2: field 3: 'nan' is no number"),
    "huge": ("Point,X,Y,Z\nP1_m1,1.5,1e300,3.5\n", "mm", "line 2: field 3: '1e300' is no number"),
    "long exponent": ("Point,X,Y,Z\nP,1.5,1e-999999999,3\n", "m", "is no number"),
    "missing": ("Point,X,Y,Z\nP1_m1,1.5,,3.5\n", "mm", "line 2: field 3: a number is missing"),
    "mixed marks": (
        "P1;1,5;2,5;3,5\nP2;1,5;2.5;3,5\n",
        "mm",
        "line 2: field 3: '2.5' is no number with a dec",
    ),
    "many columns": ("P,1.5,2.5,3.5,0.1,0.1,0.1\n", "mm", "7 columns without a header"),
    "all numbers": ("1,2,1.5,2.5,3.5\n", "mm", "order does not show"),
    "no names": ("1.5,2.5,3.5,4.5\n", "mm", "first column holds no names"),
    "no z": ("Point,X,Y\nP,1,2\n", "mm", "no column is the z"),
    "two x": ("Point,X,x,Y,Z\nP,1,1,2,3\n", "mm", "two columns are the x"),
    "half of U": ("Point,X,Y,Z,Ux\nP,1,2,3,0.1\n", "mm", "has not all of Ux, Uy and Uz"),
    "zero U": ("Point,X,Y,Z,Ux,Uy,Uz\nP,1,2,3,0,0,0\n", "mm", "uncertainty is not above zero"),
    "polar": ("// Polar\nP_m,1.5,2.5,3.5\n", "mm", "holds polar coordinates; export Cartesian"),
    "no name": ("Point,X,Y,Z\n,1,2,3\n", "mm", "line 2: the point has no name"),
    "empty": ("// nothing\n\n", "mm", "holds no data"),
    "header only": ("Point,X,Y,Z\n", "mm", "has a header and no rows"),
    "binary": ("P1\0,1,2,3\n", "mm", "line 1: is no line of a text table"),
    "open quote": ('"P1,1.5,2.5,3.5\n', "mm", "line 1: cannot be split"),
    "long line": ("P" * 70_000 + ",1.5,2.5,3.5\n", "mm", "line 1: is no line of a text table"),
}
JOINT_FAULTS = {
    "no header": ("P1,2.5,3.5\n", "names no columns"),
    "pose twice": ("pose,A1_deg\nP1,2\nP2,3\nP1,4\n", "line 4: pose 'P1' stands in line 2"),
    "column twice": ("pose,A1_deg,A1 [deg]\nP1,2,3\n", "'A1_deg' stands twice"),
    "no joints": ("pose,note\nP1,7x\nP2,8\n", "holds no joint|names no columns"),
    "no number": ("pose,A1_deg,fx_N\nP1,2,x\n", "line 2: field 3: 'x' is no number"),
    "no name": ("pose,A1_deg\n,2\n", "line 2: the pose has no name"),
}


@pytest.mark.parametrize("fault", [*POINT_FAULTS, *JOINT_FAULTS])
def test_faults(tmp_path: Path, fault: str) -> None:
    text, *unit, message = POINT_FAULTS.get(fault) or JOINT_FAULTS[fault]
    path = written(tmp_path, "p.txt", text)
    with pytest.raises(InputError, match=message) as raised:
        read_points(path, *unit) if unit else read_joints(path)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("pattern", "name", "read"),
    [
        ("{pose}_{marker}", ("", "", "P_01_m1"), ("P_01", "m1")),
        ("{marker}::{pose}", ("A", "m1", "P1"), ("P1", "m1")),
        ("{pose}::*::{marker}", ("P1", "any", "m1"), ("P1", "m1")),
        ("run *::{marker}-{pose}", ("", "run 3", "m1-P1"), ("P1", "m1")),
        ("{pose}/*{marker}", ("", "", "xm"), ("list", "m")),
        ("{pose}::{marker}", ("", "", "P1"), None),
        ("p{pose}+{marker}", ("", "", "pp1m"), None),
    ],
)
def test_patterns_read_names(
    pattern: str, name: tuple[str, str, str], read: tuple[str, str] | None
) -> None:
    point = MeasuredPoint(Path("list.txt"), 1, *name, ("0", "0", "0"))
    assert name_pattern(pattern).read(point) == read


@pytest.mark.parametrize(
    "pattern", ["", "P1", "*", "{pose}{pose}", "{other}_{pose}", "a::b::c::{pose}"]
)
def test_what_is_no_pattern_is_refused(pattern: str) -> None:
    with pytest.raises(InputError, match="--names"):
        name_pattern(pattern)


def test_names_that_can_be_read_in_two_ways_are_not_guessed(tmp_path: Path) -> None:
    text = "".join(f"{g},{p},{x},{y},{z}\n" for g, p, x, y, z in ROWS)
    points: PointList = read_points(written(tmp_path, "p.txt", text), "mm")
    joints = read_joints(written(tmp_path, "j.csv", "A1_deg\n1\n2\n3\n"))
    with pytest.raises(InputError, match="add a column pose, or give --by-order"):
        join([points], joints)
    with pytest.raises(InputError, match=r"can be read as .* alike; .*--names"):
        join([points], joints, by_order=True)
    assert len(join([points], joints, by_order=True, names="{pose}::{marker}").rows) == 9
