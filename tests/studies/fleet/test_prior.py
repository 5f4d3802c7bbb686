"""What a plant\'s types know, and robots measured after them: arms of plain numpy with known errors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.studies.command_line import checked, run
from tests.studies.fleet.robots import put, table

MEAN, SPREAD = (1.5e-3, -8e-4), 5e-5  # rad
ROBOTS = 8


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], str]:
    folder = tmp_path_factory.mktemp("types") / "hall"
    rng = np.random.default_rng(1)
    for k in range(ROBOTS):
        offsets = MEAN + SPREAD * rng.normal(size=2)
        put(folder / f"r{k}", table((offsets[0], offsets[1]), k))
    put(folder / "stranger", table((9e-3, MEAN[1]), 90))
    done = run(
        "fleet", folder, "--only", "identify", "--workers", 1, "--prior", folder / "type.json"
    )
    assert done.exit_code == 0, done.output
    return folder, json.loads((folder / "type.json").read_text()), done.output


def after(folder: Path, name: str, offsets: tuple[float, float], poses: int) -> Path:
    """A robot that comes later, whose cell names the type."""
    put(folder.parent / name, table(offsets, 70, poses))
    cell = folder.parent / name / "cell.toml"
    cell.write_text(cell.read_text() + f'[model.prior]\nfile = "../{folder.name}/type.json"\n')
    return cell


def identified(cell: Path) -> tuple[dict[str, Any], str]:
    out = cell.with_name("found.json")
    done = run("identify", cell, cell.with_name("measurements.csv"), "--json", out)
    assert done.exit_code == 0, done.output
    found = json.loads(out.read_text())
    checked(found, "identify")
    return found, done.output


def test_a_type_has_mean_and_spread_and_says_who_is_none_of_it(
    plant: tuple[Path, dict[str, Any], str],
) -> None:
    _, fields, said = plant
    checked(fields, "prior")
    (one,) = fields["types"]
    assert one["type"] == "arm"
    assert one["robots"] == ROBOTS
    assert [own["robot"] for own in one["aside"]] == ["stranger"]
    for parameter, mean in zip(one["parameters"], MEAN, strict=True):
        assert parameter["mean"] == pytest.approx(mean * 1e6, abs=80.0)
        assert 25.0 < parameter["spread"] < 150.0
    assert "Not of the type, so they did not count: stranger" in said


def test_a_robot_of_the_type_is_identified_from_poses_that_do_not_suffice_alone(
    plant: tuple[Path, dict[str, Any], str],
) -> None:
    folder, _, _ = plant
    cell = after(folder, "one", (MEAN[0] + 6e-5, MEAN[1] - 3e-5), 2)
    found, said = identified(cell)
    assert found["of_type"]["of_the_type"]
    assert "This robot is like the 8 robots of arm" in said
    beside = {p["id"]: p for p in found["parameters"]}
    cell.write_text(cell.read_text().partition("[model.prior]")[0])
    alone = run("identify", cell, cell.with_name("measurements.csv"))
    assert alone.exit_code == 2
    assert "too few poses" in alone.stderr
    for joint, true in zip(("j2", "j3"), (MEAN[0] + 6e-5, MEAN[1] - 3e-5), strict=True):
        own = beside[f"joint_offset:{joint}.offset"]
        assert abs(own["value"] - true * 1e6) < 4.0 * own["std"]


def test_a_robot_that_is_not_of_the_type_keeps_its_own_value(
    plant: tuple[Path, dict[str, Any], str],
) -> None:
    folder, _, _ = plant
    found, said = identified(after(folder, "two", (MEAN[0] + 4e-3, MEAN[1]), 8))
    own = {p["id"]: p for p in found["of_type"]["parameters"]}
    moved = own["joint_offset:j2.offset"]
    assert not found["of_type"]["of_the_type"]
    assert moved["released"]
    assert not own["joint_offset:j3.offset"]["released"]
    assert moved["value"] == pytest.approx((MEAN[0] + 4e-3) * 1e6, abs=60.0)
    assert "this robot is not as the 8 of arm are" in said


def test_robots_that_lean_on_a_type_teach_it_nothing(
    plant: tuple[Path, dict[str, Any], str], tmp_path: Path
) -> None:
    folder, _, _ = plant
    put(tmp_path / "hall" / "r", table(MEAN, 5))
    cell = tmp_path / "hall" / "r" / "cell.toml"
    cell.write_text(cell.read_text() + f'[model.prior]\nfile = "{folder / "type.json"}"\n')
    done = run("fleet", tmp_path / "hall", "--only", "identify", "--prior", tmp_path / "new.json")
    assert done.exit_code == 2
    assert "no robot could be identified by itself" in done.stderr
    assert not (tmp_path / "new.json").exists()
