"""Everything a user may get wrong ends in one line: what, where, what to do."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

import calib
from calib.errors import CalibError, InputError
from calib.files.tables import load_plan, load_targets
from calib.files.write_tables import measurements_csv
from studies.demo import INPUTS, embedded_cell, embedded_plan, embedded_text, simulated

Edit = Callable[[str], str]


@pytest.fixture(scope="module")
def good_table() -> str:
    cell = embedded_cell()
    data, _, _ = simulated(cell, embedded_plan(cell), 0)
    return measurements_csv(cell, data)


@pytest.fixture
def folder(tmp_path: Path, good_table: str) -> Path:
    for name in INPUTS:
        (tmp_path / name).write_text(embedded_text(name))
    (tmp_path / "measurements.csv").write_text(good_table)
    return tmp_path


def swap(old: str, new: str, count: int = 1) -> Edit:
    def edit(text: str) -> str:
        assert old in text
        return text.replace(old, new, count)

    return edit


def header(old: str, new: str) -> Edit:
    def edit(text: str) -> str:
        first, rest = text.split("\n", 1)
        assert old in first
        return first.replace(old, new, 1) + "\n" + rest

    return edit


def row(number: int, change: Edit) -> Edit:
    def edit(text: str) -> str:
        lines = text.split("\n")
        lines[number - 1] = change(lines[number - 1])
        return "\n".join(lines)

    return edit


def field(number: int, column: str, value: str) -> Edit:
    def edit(text: str) -> str:
        lines = text.split("\n")
        index = lines[0].split(",").index(column)
        fields = lines[number - 1].split(",")
        fields[index] = value
        lines[number - 1] = ",".join(fields)
        return "\n".join(lines)

    return edit


def column_removed(name: str) -> Edit:
    def edit(text: str) -> str:
        lines = [line.split(",") for line in text.strip().split("\n")]
        index = lines[0].index(name)
        return "\n".join(",".join(f for i, f in enumerate(r) if i != index) for r in lines)

    return edit


def only_lines(count: int) -> Edit:
    return lambda text: "\n".join(text.split("\n")[:count])


def effects(*names: str) -> Edit:
    listed = ", ".join(f'"{name}"' for name in names)
    return lambda text: re.sub(r"effects = \[.*\]", f"effects = [{listed}]", text)


TABLE = {
    "joint column missing": (
        column_removed("A3_deg"),
        "line 1: no column for joint A3; add A3_deg",
    ),
    "joint column without unit": (
        header("A3_deg", "A3"),
        "column 'A3' has no unit; name it A3_deg",
    ),
    "unknown joint column": (header("fx_N", "A7_deg"), "column 'A7_deg' names no joint .*A1, A2"),
    "joint in two units": (header("fx_N", "A3_rad"), "joint A3 stands in two units"),
    "point without unit": (header("x_mm", "x"), "column 'x' has no unit; name it x_mm or x_m"),
    "point column missing": (column_removed("z_mm"), "column z_mm is missing"),
    "wrench without unit": (header("fz_N", "fz"), "column 'fz' has no known unit; name it fz_N"),
    "column twice": (header("fx_N", "fy_N"), "line 1: column 'fy_N' stands twice"),
    "pose column missing": (header("pose", "point"), "column 'pose' is missing"),
    "not a number": (field(5, "x_mm", "abc"), "line 5, column x_mm: 'abc' is not a number"),
    "empty field": (field(5, "x_mm", ""), "line 5, column x_mm: is empty; leave the row out"),
    "NaN": (field(7, "A2_deg", "nan"), "line 7, column A2_deg: 'nan' is not a finite number"),
    "infinite": (field(7, "y_mm", "1e999"), "line 7, column y_mm: '1e999' is not a finite"),
    "row twice": (lambda t: t + t.split("\n")[1] + "\n", "line 92, .* has marker 'm1' twice"),
    "unknown marker": (
        field(3, "marker", "m9"),
        "line 3, column marker: 'm9' is not in .*m1, m2, m3",
    ),
    "marker never seen": (
        lambda t: "\n".join(line for line in t.split("\n") if ",m3," not in line),
        "marker m3: is in the cell's .* and never measured; measure it or take it out",
    ),
    "joints differ in one pose": (field(3, "A1_deg", "1.0"), "line 3, column A1_deg: differs"),
    "fields missing": (row(4, lambda r: r.rsplit(",", 1)[0]), "line 4: has 16 fields where .* 17"),
    "too few poses": (only_lines(10), "too few poses: .* measure at least 7 poses"),
    "empty file": (lambda _: "", "is empty; the first line must name the columns"),
    "only a header": (only_lines(1), "has a header and no rows"),
    "point beyond the horizon": (
        field(4, "x_mm", "1e9"),
        "line 4, column x_mm: 1e9 is farther than 10 km; check the reading and its unit",
    ),
    "open quote": (row(4, lambda r: '"' + r), "is no CSV"),
    "binary": (lambda _: "\0\1\2garbage", "line 1: is no line of a CSV table"),
}


def identified(folder: Path) -> None:
    cell = calib.load_cell(folder / "cell.toml")
    calib.identify(cell, calib.load_measurements(cell, folder / "measurements.csv"))


def refused(folder: Path, file: str, edit: Edit, message: str) -> None:
    path = folder / file
    path.write_text(edit(path.read_text()))
    with pytest.raises(CalibError) as caught:
        identified(folder)
    text = str(caught.value)
    assert re.search(message, text), text
    assert "\n" not in text
    if isinstance(caught.value, InputError):
        assert text.startswith(str(folder))


@pytest.mark.parametrize("case", list(TABLE))
def test_measurements(folder: Path, case: str) -> None:
    refused(folder, "measurements.csv", *TABLE[case])


CELL = {
    "malformed TOML": (swap("[robot]", "[robot"), "cell.toml: is not valid TOML: .*line"),
    "negative sigma": (
        swap("0.010", "-0.010"),
        "instrument.sigma_mm: .*greater than 0, found -0.01",
    ),
    "sigma as text": (swap("0.010", '"small"'), "instrument.sigma_mm: .*number, found 'small'"),
    "sigma as a number in quotes": (swap("0.010", '"0.01"'), "instrument.sigma_mm: .*number"),
    "sigma is NaN": (swap("0.010", "nan"), "instrument.sigma_mm: .*finite"),
    "divisor missing": (
        swap("0.010", "{ mpe_mm = 0.03 }"),
        "instrument.sigma_mm.divisor: is missing",
    ),
    "unknown key": (swap("sigma_mm", "sigma_m"), "instrument.sigma_m.*did you mean 'sigma_mm'"),
    "table misspelt": (swap("[instrument]", "[instrumental]"), "did you mean 'instrument'"),
    "table missing": (
        lambda t: re.sub(r"\[instrument\]\n.*\n", "", t),
        "cell.toml: instrument: is missing",
    ),
    "no markers": (
        lambda t: re.sub(r"^m[123] = .*$", "", t, flags=re.M),
        "markers_mm: has no entry; at least one is needed",
    ),
    "marker with two numbers": (
        swap("[279.2, -16.4, -91.9]", "[279.2, -16.4]"),
        "markers_mm.m1.2: is",
    ),
    "limits reversed": (
        swap("[-140.0, -0.01]", "[0.0, -140.0]"),
        "limits_deg.A2: lower limit 0 is above",
    ),
    "limits of no joint": (
        swap("A2 = [-140.0, -0.01]", "B2 = [-1, 1]"),
        "limits_deg.B2: no such joint",
    ),
    "limits outside the URDF's": (
        swap("[-140.0, -0.01]", "[10, 20]"),
        "leaves nothing of the URDF",
    ),
    "negative load": (swap("250.0", "-250.0"), "load.mass_kg: .*greater than or equal to 0"),
    "other schema": (swap("schema = 1", "schema = 2"), "cell.toml: schema: .*should be 1"),
    "unknown effect": (effects("base", "backlsh:A2"), "unknown effect 'backlsh'"),
    "misspelt effect": (effects("joint_complience:A2"), "did you mean 'joint_compliance'"),
    "effect at no place": (effects("joint_compliance:B7"), "has no place 'B7'.*A1, A2, A3"),
    "effect twice": (effects("joint_compliance:A2,A2"), "joint_compliance:A2 stands twice"),
    "group with a place": (effects("geometry:A2"), "'geometry' is a group and takes no places"),
    "effect that cannot act": (
        effects("base", "tool", "joint_compliance:A1"),
        "joint_compliance:A1 cannot act: it moves no marker at any of these poses",
    ),
    "effect of the base at a joint": (
        effects("base", "base_compliance:A2"),
        "base_compliance has no place 'A2'.*places are: base",
    ),
    "link that the tip alone ends": (
        effects("base", "thermal_expansion:A4"),
        "thermal_expansion:A4 cannot act: the next joint has its origin in this one's",
    ),
    "temperature not measured": (
        effects("base", "thermal_expansion:arm"),
        "thermal_expansion:arm cannot act: the poses have no temperature; add column temperature_degC",
    ),
    "time not measured": (
        effects("base", "base_drift"),
        "base_drift:base cannot act: the poses have no time; add column time_s",
    ),
    "load error of a rigid arm": (
        effects("base", "payload"),
        "payload:payload cannot act: nothing in the model is elastic; add joint_compliance",
    ),
    "scale beside free lengths": (
        effects("base", "tool", "geometry", "tracker_scale"),
        "tracker_scale:instrument cannot act: .* and .* more move the markers in the same way",
    ),
    "off-diagonal compliance": (
        effects("joint_compliance:A2*A3"),
        "off-diagonal terms .* are not modelled; name one joint at a time",
    ),
    "off-diagonal compliance by name": (effects("cross_compliance"), "off-diagonal terms"),
    "URDF missing": (
        swap("kr270.urdf", "other.urdf"),
        "other.urdf: cannot be read .*check .robot. urdf",
    ),
    "no such link": (
        swap('tip = "tool0"', 'tip = "tool1"'),
        "has no link 'tool1'; set .robot. tip",
    ),
    "base beyond tip": (
        swap('base = "base_link"', 'base = "link_6"\n#'),
        "chain has no moving joint",
    ),
}


@pytest.mark.parametrize("case", list(CELL))
def test_cell(folder: Path, case: str) -> None:
    refused(folder, "cell.toml", *CELL[case])


BOMB = (
    '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]>'
    "<robot name='&b;'><link name='base_link'/></robot>"
)
A2_ORIGIN = '<origin xyz="0.35 0 0" rpy="0 0 0"/>'

URDF = {
    "not XML": (swap("</robot>", "</robo>"), "line .*: is not well-formed XML"),
    "entity bomb": (lambda _: BOMB, "refused for safety .*remove the DOCTYPE"),
    "not a URDF": (lambda _: "<mujoco/>", "<mujoco>: is not a URDF"),
    "empty": (lambda _: "", "is not well-formed XML"),
    "text in a number": (swap("0.35 0 0", "0.35 zero 0"), "joint A2 origin xyz: .*text in place"),
    "two numbers": (swap("0.35 0 0", "0.35 0"), "joint A2 origin xyz: .*3 finite numbers"),
    "NaN": (swap("0.35 0 0", "0.35 nan 0"), "joint A2 origin xyz: .*3 finite numbers"),
    "axis without length": (swap('xyz="0 0 -1"', 'xyz="0 0 0"'), "joint A1 axis: has no length"),
    "unsupported joint": (
        swap('type="revolute"', 'type="planar"'),
        "A1: type 'planar' is not supp",
    ),
    "mimic": (swap(A2_ORIGIN, A2_ORIGIN + '<mimic joint="A1"/>'), "joint A2: mimics another joint"),
    "limits reversed": (
        swap('lower="-2.548181"', 'lower="2.5"'),
        "A2 limit: lower 2.5 is above upper",
    ),
    "negative mass": (swap('value="232"', 'value="-232"'), "link link_2 mass: is negative"),
    "closed loop": (
        swap(
            "</robot>",
            '<joint name="bar" type="fixed"><parent link="base_link"/><child link="link_3"/></joint>'
            "</robot>",
        ),
        "link 'link_3' already hangs on joint 'A3'",
    ),
    "branch": (
        swap(
            "</robot>",
            '<link name="arm_2"/><joint name="B1" type="revolute"><parent link="link_2"/>'
            '<child link="arm_2"/></joint></robot>',
        ),
        "joint B1: branches off link 'link_2'",
    ),
    "chain interrupted": (
        swap('<child link="link_4"/>', '<child link="link_9"/>'),
        "no chain of joints leads from 'base_link'",
    ),
}


@pytest.mark.parametrize("case", list(URDF))
def test_urdf(folder: Path, case: str) -> None:
    refused(folder, "kr270.urdf", *URDF[case])


def test_effect_without_any_load(folder: Path) -> None:
    """A compliance without link masses or wrench must not silently do nothing."""
    urdf = folder / "kr270.urdf"
    urdf.write_text(re.sub(r'<mass value="\d+"/>', '<mass value="0"/>', urdf.read_text()))
    table = folder / "measurements.csv"
    for name in ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"):
        table.write_text(column_removed(name)(table.read_text()))
    refused(
        folder,
        "cell.toml",
        effects("base", "joint_compliance:A3"),
        "nothing loads the arm; give wr",
    )


def test_missing_files(folder: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.toml: cannot be read .*check the path"):
        calib.load_cell(folder / "nowhere.toml")
    cell = calib.load_cell(folder / "cell.toml")
    with pytest.raises(InputError, match=r"nowhere\.csv: cannot be read"):
        calib.load_measurements(cell, folder / "nowhere.csv")
    with pytest.raises(InputError, match="cannot be read"):
        calib.load_measurements(cell, folder)


def test_a_gigabyte_of_garbage_is_refused_early(folder: Path) -> None:
    """Sparse files: nothing of the gigabyte is read beyond its first line."""
    cell = calib.load_cell(folder / "cell.toml")
    for name, load in (
        ("big.csv", lambda path: calib.load_measurements(cell, path)),
        ("big.toml", calib.load_cell),
    ):
        path = folder / name
        with path.open("wb") as file:
            file.truncate(10**9)
        with pytest.raises(InputError, match=r"larger than 500 MB|too large"):
            load(path)
    wide = folder / "wide.csv"
    wide.write_text("pose,marker," + "x" * 200_000)
    with pytest.raises(InputError, match="line 1: is no line of a CSV table"):
        calib.load_measurements(cell, wide)


WARNINGS = {
    "outside the limits": (
        lambda t: t.replace(",-140,", ",-141.5,"),
        r"line \d+: joint A2 at -141.50 deg is outside its limits \(18 rows in all\)",
    ),
    "other columns": (
        lambda t: "\n".join(
            line + (",operator" if i == 0 else ",x") if line else line
            for i, line in enumerate(t.split("\n"))
        ),
        "ignored columns: operator",
    ),
}


@pytest.mark.parametrize("case", list(WARNINGS))
def test_warnings(folder: Path, case: str) -> None:
    edit, message = WARNINGS[case]
    path = folder / "measurements.csv"
    path.write_text(edit(path.read_text()))
    data = calib.load_measurements(calib.load_cell(folder / "cell.toml"), path)
    assert re.search(message, "\n".join(data.warnings)), data.warnings


def test_angles_that_look_like_radians_are_pointed_out(folder: Path) -> None:
    rows = ["pose,A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg,marker,x_mm,y_mm,z_mm"]
    rows += [
        f"p{i},{0.1 * i},-0.5,{0.2 * i},1.0,-1.0,{0.3 * i},{m},1,2,3"
        for i in range(8)
        for m in ("m1", "m2", "m3")
    ]
    path = folder / "radians.csv"
    path.write_text("\n".join(rows))
    data = calib.load_measurements(calib.load_cell(folder / "cell.toml"), path)
    assert any("looks like radians" in text for text in data.warnings)


def test_plans_and_targets(folder: Path) -> None:
    cell = calib.load_cell(folder / "cell.toml")
    plan = folder / "plan.csv"
    assert len(load_plan(cell, plan)) == 15
    plan.write_text(plan.read_text().replace("p02", "p01"))
    with pytest.raises(InputError, match="line 3, column pose: 'p01' stands twice"):
        load_plan(cell, plan)
    targets = folder / "targets.csv"
    targets.write_text(embedded_text("plan.csv").replace("level", "weight"))
    with pytest.raises(InputError, match="column weight: must be at least zero"):
        load_targets(cell, targets)
