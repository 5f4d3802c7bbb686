"""What remains beside the causes, on days of an arm in MuJoCo that lacks nothing but repeatability."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calib
from studies.research.truth.day import Setting, draw_day, write_day

pytest.importorskip("mujoco")


# Scatter (3-D, m), approaches and lines more for the cell; the verdict, what remains and of whom.
DAYS = {
    "as such arms have it": (3e-5, 1, "", ("no_gap", "scatter", "undecided", "assumed")),
    "told by second approaches": (3e-5, 2, "", ("no_gap", "scatter", "arm", "measured")),
    "more than any arm's": (3e-4, 1, "", ("unknown", "too_large", "model", "assumed")),
    "more than the cell says": (
        1e-4,
        1,
        "repeatability_mm = 0.005\nrepeatability_urad = 5",
        ("unknown", "too_large", "model", "stated"),
    ),
    "none": (0.0, 1, "", ("no_gap", "none", None, None)),
}


@pytest.mark.parametrize(("scatter", "approaches", "robot", "told"), DAYS.values(), ids=DAYS)
def test_what_remains_is_told_with_whose_it_is(
    tmp_path: Path, scatter: float, approaches: int, robot: str, told: tuple[str | None, ...]
) -> None:
    day = draw_day(Setting("6R", scatter, approaches, 40 // approaches, 3), 1, 5)
    write_day(tmp_path, day)
    text = (tmp_path / "cell.toml").read_text()
    (tmp_path / "cell.toml").write_text(text.replace("[robot]", f"[robot]\n{robot}"))
    cell = calib.load_cell(tmp_path / "cell.toml")
    found = calib.diagnose(cell, calib.load_measurements(cell, tmp_path / "measurements.csv"))
    rest = found.rest
    assert (found.verdict, rest.kind) == told[:2]
    if rest.kind == "none":
        assert rest.size == 0.0
        return
    assert (rest.of, rest.source) == told[2:]
    if rest.kind == "too_large":
        assert found.located[-1].depends_on == "pose"
    elif approaches == 1:
        assert not found.located
        assert rest.size == pytest.approx(3e-5 / np.sqrt(3.0), rel=0.4)
