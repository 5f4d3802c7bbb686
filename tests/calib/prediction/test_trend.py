"""A base that warms in MuJoCo while it is measured: what comes an hour later was said before."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.studies.command_line import run

pytest.importorskip("mujoco")

import calib
from calib.files.estimate import load_estimate
from calib.prediction.estimate import Estimate, ExpectedError, estimate_of
from doe.forecast.enough import enough
from studies.render import markdown
from studies.research.truth.day import Day, Floor, Setting, draw_day, write_day
from studies.results.base import envelope
from studies.results.enough import EnoughResult

_HERE = Setting("6R", 0.0, 1, 40, 3)
_HOUR = 3600.0


def _warming(index: int, size: float = 1e-4, timed: bool = True) -> Day:
    """As far as m and rad of one standard deviation."""
    rng = np.random.default_rng([index, 5])
    far, tau = rng.normal(size=6) * size, rng.uniform(0.5, 2.0)
    floor = Floor(lambda h: far * (1.0 - np.exp(-h / tau))[:, None], told=timed)
    return draw_day(_HERE, index, 5, floor=floor)


def _known(folder: Path, day: Day) -> tuple[calib.Cell, calib.Measurements, Estimate, float]:
    """Cell, data and estimate, and by how much it misses the targets an hour later, RMS, m."""
    write_day(folder, day)
    cell = calib.load_cell(folder / "cell.toml")
    data = calib.load_measurements(cell, folder / "measurements.csv")
    found = calib.identify(cell, data)
    targets, _ = calib.load_targets(cell, folder / "targets.csv")
    off = found.predict(targets) - day.reached
    return cell, data, estimate_of(found, _HOUR), float(np.sqrt((off**2).sum(axis=-1).mean()))


def test_the_trend_is_carried_on(tmp_path: Path) -> None:
    ratios = []
    for index in range(8):
        cell, _, known, came = _known(tmp_path, _warming(index))
        assert known.trend is not None
        targets, _ = calib.load_targets(cell, tmp_path / "targets.csv")
        said = ExpectedError(known, targets)
        assert (said.model >= said.trend).all()
        ratios.append(came / float(np.sqrt((said.trend**2).mean())))
    assert 0.6 < float(np.sqrt(np.mean(np.square(ratios)))) < 1.2
    assert max(ratios) < 2.0


def test_it_is_handed_on_by_file(tmp_path: Path) -> None:
    cell, _, known, _ = _known(tmp_path, _warming(0))
    out = tmp_path / "result.json"
    done = run("identify", cell.path, tmp_path / "measurements.csv", "--json", out)
    assert done.exit_code == 0, done.output
    targets, _ = calib.load_targets(cell, tmp_path / "targets.csv")
    read, here = (ExpectedError(own, targets).trend for own in (load_estimate(cell, out), known))
    np.testing.assert_allclose(read, here, rtol=1e-6)
    assert "trend of the day" in out.read_text()
    said = calib.compensate(cell, out, targets)
    np.testing.assert_allclose(said.error.trend, here, rtol=0.02)
    assert any("1 h after the last one" in note for note in said.notes)


def test_a_base_that_stands_has_none(tmp_path: Path) -> None:
    found = [_known(tmp_path, _warming(index, size=0.0))[2].trend for index in range(10)]
    assert all(trend is None for trend in found)


def test_nobody_is_told_to_stop_while_it_goes_on(tmp_path: Path) -> None:
    """Unless the cell says when the targets come: then the bound is for that time."""
    for told_when in (False, True):
        cell, data, _, came = _known(tmp_path, _warming(2, timed=told_when))
        answer = enough(cell, data, goal=1e-2)
        made_from = envelope(cell.name, [cell.path], 0)
        said = markdown(EnoughResult.of(answer, cell, made_from)).replace("\\", "")
        assert answer.lacking.trend > 0.0
        assert ("You may stop" in said) == told_when
        assert ("targets_after_h" in said) == (not told_when)
        assert "run `posecal diagnose`" in said.lower()
    assert came <= answer.steps[0].task_most
    assert enough(cell, data, goal=0.9 * came).needed is None
