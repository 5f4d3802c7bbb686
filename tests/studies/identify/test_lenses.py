"""The lens that is found stands in the result with its deviations."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from studies.research.cameras import written
from tests.studies.command_line import run

pytest.importorskip("cv2", exc_type=ImportError)
FREE = "sigma_px = 0.1", 'sigma_px = 0.1\nfree = ["focal", "center", "distortion"]'
EFFECTS = '"geometry"]', '"geometry", "focal", "principal_point", "distortion"]'


@pytest.mark.usefixtures("data")
@pytest.mark.parametrize("asked", [FREE, EFFECTS], ids=["free", "effects"])
def test_a_wrong_lens_is_found(asked: tuple[str, str], tmp_path: Path) -> None:
    cell, table = written(tmp_path, "A", 3)
    lens = (0.006, 0.004, 3.5, -3.0, -0.03, 0.01)
    cell.write_text(cell.read_text().replace(*asked))
    done = run("identify", cell, table, "--json", tmp_path / "i.json")
    assert done.exit_code == 0, done.output
    rows = {row["name"]: row for row in json.loads((tmp_path / "i.json").read_text())["lenses"]}
    true = {
        "fx": 900.0 * (1.0 + lens[0]), "fy": 900.0 * (1.0 + lens[1]), "cx": 640.0 + lens[2],
        "cy": 480.0 + lens[3], "k1": lens[4], "k2": lens[5], "p1": 0.0, "p2": 0.0, "k3": 0.0,
    }  # fmt: skip
    assert list(rows) == list(true)
    for name, value in true.items():
        assert abs(rows[name]["value"] - value) < 4.0 * rows[name]["std"], name
