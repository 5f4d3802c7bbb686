"""The lens that is found stands in the result with its deviations, and in a calibration file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from calib.files.lenses import read_lens
from studies.research.benchmarks.lenses import written
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
    done = run(
        "identify", cell, table, "--json", tmp_path / "i.json", "--calibration", tmp_path / "c.yaml",
        "--calibration", tmp_path / "c.ros.yaml",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "--calibration camera.yaml" in done.output
    rows = {row["name"]: row for row in json.loads((tmp_path / "i.json").read_text())["lenses"]}
    true = {
        "fx": 900.0 * (1.0 + lens[0]), "fy": 900.0 * (1.0 + lens[1]), "cx": 640.0 + lens[2],
        "cy": 480.0 + lens[3], "k1": lens[4], "k2": lens[5], "p1": 0.0, "p2": 0.0, "k3": 0.0,
    }  # fmt: skip
    assert list(rows) == list(true)
    for name, value in true.items():
        assert abs(rows[name]["value"] - value) < 4.0 * rows[name]["std"], name
    in_file = read_lens(tmp_path / "c.yaml").values
    assert read_lens(tmp_path / "c.ros.yaml").form == "ros"
    np.testing.assert_array_equal(read_lens(tmp_path / "c.ros.yaml").values, in_file)
    np.testing.assert_allclose(
        in_file, [row["value"] for row in rows.values()], rtol=1e-9, atol=1e-12
    )
    covariance = read_lens(tmp_path / "c.yaml").covariance
    assert covariance is not None
    np.testing.assert_allclose(
        np.sqrt(np.diag(covariance)), [row["std"] for row in rows.values()], rtol=1e-6
    )
