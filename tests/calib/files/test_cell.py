"""What a cell says of the arm's repeatability and of causes that the robot cannot have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Poses
from calib.cell import Load, Repeatability
from calib.cell.planned import Pace
from calib.diagnosis.candidates import candidates
from calib.errors import InputError
from calib.model.build import build
from studies.demo.embedded import embedded_text
from tests.helpers import all_seen
from tests.studies.command_line import paper_cell


def cell_with(folder: Path, robot: str = "", more: str = "") -> Cell:
    """The embedded cell with lines added to [robot], and tables at the end."""
    path = paper_cell(folder)
    text = path.read_text().replace('tip = "tool0"\n', f'tip = "tool0"\n{robot}')
    path.write_text(f"{text}\n{more}")
    return calib.load_cell(path)


def excluding(folder: Path, *names: str) -> Cell:
    return cell_with(folder, more=f"[diagnosis]\nexclude = {[*names]!r}\n")


def asked(cell: Cell, poses: Poses) -> tuple[set[str], dict[str, str]]:
    """Causes by name that are candidates, and what is not, with the reason."""
    points = np.ones((len(poses), len(cell.markers), 3))
    data = all_seen(poses, points)
    found, missing = candidates(cell, build(cell, poses).model, data)
    return {c.key for c in found if c.named}, {n.effect: n.reason for n in missing}


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("", None),
        ("repeatability_mm = 0.03\nrepeatability_urad = 100\n", Repeatability(3e-5, 1e-4)),
        ("repeatability_mm = 0.03\n", Repeatability(3e-5, 0.0)),
        ("repeatability_urad = 100\n", Repeatability(0.0, 1e-4)),
        ("repeatability_mm = 0\n", Repeatability(0.0, 0.0)),
    ],
    ids=["to be estimated", "both", "no rotation", "no translation", "none"],
)
def test_repeatability(tmp_path: Path, lines: str, expected: Repeatability | None) -> None:
    found = cell_with(tmp_path, lines).repeatability
    if expected is None or found is None:
        assert found is expected
        return
    assert found.translation == pytest.approx(expected.translation, rel=1e-12)
    assert found.rotation == pytest.approx(expected.rotation, rel=1e-12)


def test_excluded_causes_one_by_one(tmp_path: Path) -> None:
    assert cell_with(tmp_path).excluded == ()
    cell = excluding(tmp_path, "gravity_compensator", "backlash:A3, A4")
    assert cell.excluded == ("gravity_compensator", "backlash:A3", "backlash:A4")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        (
            "backlsh:A3",
            r"unknown effect 'backlsh' in \[diagnosis\] exclude; did you mean 'backlash'",
        ),
        ("base_compliance:bse", r"no place 'bse' in \[diagnosis\] exclude; did you mean 'base'"),
        ("backlash:elbow", r"no place 'elbow' in \[diagnosis\] exclude; places are: A1, A2"),
        ("geometry", r"'geometry' in \[diagnosis\] exclude is no cause"),
    ],
)
def test_unknown_names_in_one_line(tmp_path: Path, name: str, text: str) -> None:
    with pytest.raises(InputError, match=text) as caught:
        excluding(tmp_path, name)
    assert caught.value.where == "diagnosis.exclude"
    assert "\n" not in str(caught.value)


def test_excluded_causes_are_not_asked(tmp_path: Path, table_two: Poses) -> None:
    everything, _ = asked(cell_with(tmp_path), table_two)
    names = ("gravity_compensator", "joint_coupling:A3")
    left, reasons = asked(excluding(tmp_path, *names), table_two)
    gone = everything - left
    assert gone == {f"gravity_compensator:A{k}" for k in range(1, 7)} | {"joint_coupling:A3"}
    assert {reasons[cause] for cause in gone} == {"excluded by the cell"}


def test_geometry_at_places_leaves_its_parts_elsewhere_in_the_contest(
    tmp_path: Path, table_two: Poses
) -> None:
    cell = replace(cell_with(tmp_path), effects=("base", "tool", "geometry:A2,A4,tool0"))
    here, _ = asked(cell, table_two)
    for kind, ends in (("joint_offset", ()), ("link_geometry", ("tool0",))):
        places = {key.partition(":")[2] for key in here if key.startswith(f"{kind}:")}
        assert places == {*cell.robot.joints, *ends} - {"A2", "A4", "tool0"}


def test_a_table_of_the_cell_is_what_its_constructor_makes(tmp_path: Path) -> None:
    """Keys have units, fields are in SI."""
    cell = cell_with(
        tmp_path,
        more="[timing]\nspeed_percent = 20\nload_change_min = 3\n[payload]\ncom_mm = [1, 2, 3]\n",
    )
    assert cell.load == Load(250.0, (0.3, 0.0, 0.15), cell.load.max_tilt if cell.load else 0.0)
    assert cell.pace == Pace(speed=0.2, load=180.0)
    assert cell.payload.com == pytest.approx((1e-3, 2e-3, 3e-3), rel=1e-15)


@pytest.mark.parametrize(
    ("value", "place"),
    [
        ('focal_px = "long"', "focal_px"),
        ("intrinsics_std = { distortion = true }", "intrinsics_std"),
    ],
)
def test_the_place_is_keys_alone_whatever_forms_a_value_may_have(
    tmp_path: Path, value: str, place: str
) -> None:
    path = paper_cell(tmp_path)
    camera = "[boards.b]\non = 'tip'\nsquares = [9, 6]\npitch_mm = 30\n[instruments.cam]\n"
    camera += "kind = 'camera'\nfocal_px = 1200\ncenter_px = [640, 480]\nsigma_px = 0.1\n"
    camera = camera.replace("focal_px = 1200", value) if place == "focal_px" else camera + value
    path.write_text(path.read_text().replace("[instrument]\nsigma_mm = 0.010", camera + "\n"))
    with pytest.raises(InputError) as caught:
        calib.load_cell(path)
    assert str(caught.value.where).startswith(f"instruments.cam.{place}")
    assert "[" not in str(caught.value.where)


def test_speeds_of_the_urdf_and_of_the_cell(tmp_path: Path) -> None:
    urdf = embedded_text("kr270.urdf").replace('velocity="0"', 'velocity="1.5"', 2)
    (tmp_path / "kr270.urdf").write_text(urdf)
    more = (
        "\n[robot.speed_deg_s]\nA2 = 90\nA6 = 180\n[robot.acceleration_deg_s2]\nA1 = 360\n"
        "[timing]\nspeed_percent = 25\nread_s = 4\n"
    )
    (tmp_path / "cell.toml").write_text(embedded_text("cell.toml") + more)
    cell = calib.load_cell(tmp_path / "cell.toml")
    speeds = [1.5, np.pi / 2, np.nan, np.nan, np.nan, np.pi]
    np.testing.assert_allclose(cell.robot.speeds, speeds)
    np.testing.assert_allclose(cell.robot.accelerations, [2 * np.pi, *5 * [np.nan]])
    assert (cell.pace.speed, cell.pace.reading, cell.pace.settle) == (0.25, 4.0, 2.0)


def test_no_speed_is_known_by_default(tmp_path: Path) -> None:
    for name in ("kr270.urdf", "cell.toml"):
        (tmp_path / name).write_text(embedded_text(name))
    assert np.isnan(calib.load_cell(tmp_path / "cell.toml").robot.speeds).all()
