"""Cells and tables of instruments that touch: what they hold, and what is said where it cannot be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calib
from calib.files.write_tables import measurements_csv
from calib.instruments import Distance, KnownDistance, Plane, Socket

URDF = """<robot name="r"><link name="base"/><link name="tip"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="tip"/><origin xyz="0.3 0 0.2"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="0" velocity="1"/></joint></robot>"""
CELL = """schema = 1
[robot]
urdf = "r.urdf"
base = "base"
tip = "tip"
[markers_mm]
ball = [50, 0, 100]
[instruments.left]
kind = "socket"
sigma_mm = 0.3
[instruments.wire]
kind = "distance"
sigma_mm = 0.1
anchor_mm = [100, 0, 0]
offset = true
[instruments.right]
kind = "socket"
sigma_mm = 0.3
[instruments.table]
kind = "plane"
sigma_mm = 0.01
[[known_distances]]
between = ["left", "right"]
mm = 50.0
sigma_mm = 0.05
[model]
effects = ["joint_offset:j1"]
"""
TABLE = """pose,instrument,marker,j1_deg,d_mm
a,left,ball,10,
b,wire,ball,20,321.5
c,right,ball,30,
d,table,ball,40,
e,table,ball,50,0.25
"""


def written(folder: Path, cell: str = CELL, table: str = TABLE) -> tuple[Path, Path]:
    (folder / "r.urdf").write_text(URDF)
    (folder / "cell.toml").write_text(cell)
    (folder / "m.csv").write_text(table)
    return folder / "cell.toml", folder / "m.csv"


def test_cell_and_table(tmp_path: Path) -> None:
    """Sockets are one instrument at several sites; an empty gauge reads nothing."""
    path, table = written(tmp_path)
    cell = calib.load_cell(path)
    wire, plane, sockets = cell.instruments
    assert isinstance(wire, Distance)
    assert wire.known
    assert wire.anchor is not None
    np.testing.assert_allclose(wire.anchor, [0.1, 0.0, 0.0])
    assert [u.name for u in wire.unknowns] == ["offset"]
    assert isinstance(plane, Plane)
    assert plane.sigma == pytest.approx(1e-5)
    assert isinstance(sockets, Socket)
    assert sockets.sites == ("left", "right")
    assert cell.known_distances == (KnownDistance(("left", "right"), 0.05, pytest.approx(5e-5)),)
    data = calib.load_measurements(cell, table)
    assert data.poses.site is not None
    assert data.poses.site.tolist() == ["left", "", "right", "", ""]
    assert data.seen.sum(axis=0).tolist() == [1, 2, 2]
    np.testing.assert_allclose(data.readings[[1, 4], [0, 1], 0], [0.3215, 0.00025])
    assert np.count_nonzero(data.readings) == 2
    table.write_text(measurements_csv(cell, data))
    back = calib.load_measurements(cell, table)
    np.testing.assert_array_equal(back.poses.site, data.poses.site)
    np.testing.assert_allclose(back.readings, data.readings, atol=1e-9)


def test_places_are_unknown_though_the_model_has_no_base(tmp_path: Path) -> None:
    path, _ = written(tmp_path)
    ids = calib.parameters(calib.load_cell(path))
    assert [i for i in ids if i.startswith("base:")] == [
        "base:wire.offset",
        *(f"base:table.{c}" for c in ("rx", "ry", "height")),
        *(f"base:{name}.{c}" for name in ("left", "right") for c in "xyz"),
    ]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('between = ["left", "right"]', 'between = ["left", "wire"]', "not two sockets or two"),
        ('between = ["left", "right"]', 'between = ["left", "left"]', "not two sockets or two"),
        ('kind = "plane"', 'kind = "plain"', "instruments.table"),
        ('kind = "plane"', 'kind = "sphere"', "has no known kind; write plane or socket"),
        ("sigma_mm = 0.01", "sigma_mm = 0.01\nreach_mm = 1", "instruments.table.reach_mm"),
    ],
)
def test_faults_of_the_cell(tmp_path: Path, old: str, new: str, said: str) -> None:
    path, _ = written(tmp_path, cell=CELL.replace(old, new, 1))
    with pytest.raises(calib.CalibError, match=said):
        calib.load_cell(path)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("b,wire,ball,20,321.5", "b,wire,ball,20,", "line 3, column d_mm: is empty"),
        ("c,right,ball,30,", "a,right,ball,10,", "touches 'left' too; give each its own pose"),
        ("a,left,", "a,middle,", "'middle' is not in the cell; instruments are wire"),
        ("e,table,ball,50,0.25", "e,table,ball,50,2e8", "farther than 10 km"),
    ],
)
def test_faults_of_the_table(tmp_path: Path, old: str, new: str, said: str) -> None:
    path, table = written(tmp_path, table=TABLE.replace(old, new, 1))
    with pytest.raises(calib.CalibError, match=said):
        calib.load_measurements(calib.load_cell(path), table)


@pytest.mark.long
def test_contacts_of_a_panda(data: Path) -> None:
    """A ball in 16 sockets: 8.4 mm by the nominal arm, a third of one with its geometry."""
    cell = calib.load_cell(data / "panda_sockets_2" / "cell.toml")
    whole = calib.load_measurements(cell, data / "panda_sockets_2" / "measurements.csv")
    found = calib.identify(cell, whole)
    assert found.rms("nominal") == pytest.approx(8.44e-3, rel=0.01)
    assert (found.rms("fitted_all") or 1.0) <= 0.31e-3
    assert len(found.by_instrument) == 16
    kept, held = whole.split(0.3, np.random.default_rng(1))
    assert (calib.identify(cell, kept, heldout=held).rms("heldout") or 1.0) <= 0.40e-3
