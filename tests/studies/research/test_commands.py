"""Sentences that are counted: what a day asks, and how it is summed up."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

pytest.importorskip("mujoco")

from studies.research.claims import SENTENCES, Said, main, summaries
from studies.research.truth.day import ARMS, SIGMA, Setting, draw_day


@pytest.mark.parametrize("index", [0, 1], ids=["joints", "tip"])
@pytest.mark.parametrize("arm", ARMS)
def test_tip_scatters_by_so_much(arm: str, index: int) -> None:
    """The tip from its markers: weights that add up to one and balance them at its origin."""
    day = draw_day(Setting(arm, 30e-6, 1, 40, 6), index, 0)
    assert bool(day.scatter.joints.any()) == (index == 0)
    sums = np.vstack([day.markers.T, np.ones(6)])
    weights = np.linalg.lstsq(sums, [0.0, 0.0, 0.0, 1.0], rcond=None)[0]
    moved = np.einsum("m,tmi->ti", weights, day.approached - day.reached)
    rms = np.sqrt(np.mean(np.sum(moved**2, axis=1)))
    assert rms == pytest.approx(30e-6, rel=0.15)


def test_instrument_and_approaches() -> None:
    """Each pose so often, others between; without scatter the noise of the instrument alone."""
    day = draw_day(Setting("6R", 0.0, 3, 40, 3), 0, 0)
    poses = [name[:4] for name in day.names]
    assert all(poses.count(pose) == 3 for pose in set(poses))
    assert all(a != b for a, b in pairwise(poses))
    assert np.std(day.read - day.exact) == pytest.approx(SIGMA, rel=0.06)
    np.testing.assert_array_equal(day.approached, day.reached)
    loose = draw_day(Setting("6R", 30e-6, 3, 40, 3), 0, 0)
    assert np.std(loose.read - loose.exact) > 1.4 * SIGMA
    again = draw_day(Setting("6R", 30e-6, 3, 40, 3), 0, 0)
    np.testing.assert_array_equal(loose.read, again.read)


def test_summaries_by_hand() -> None:
    told = summaries(
        [
            Said("enough most", 2e-3, 1e-3, right=True),
            Said("enough most", 1e-3, 2e-3, right=False),
            Said("design", 1e-3, 1e-3),
            Said("changes alarm", right=True),
        ]
    )
    assert list(told) == ["design", "enough most", "changes alarm"]
    most = told["enough most"]
    assert (most["days"], most["right"]) == (2, 1)
    assert most["came_over_promised"] == pytest.approx(((0.25 + 4.0) / 2) ** 0.5)
    assert most["ci95"][0] < 0.1 < 0.9 < most["ci95"][1]
    assert (told["design"]["right"], told["design"]["ci95"]) == (None, None)
    assert (told["changes alarm"]["right"], told["changes alarm"]["came_over_promised"]) == (
        1,
        None,
    )


@pytest.mark.long
def test_a_day_and_its_morrow(tmp_path: Path) -> None:
    found = tmp_path / "said.json"
    options = ["--days", "2", "--only", "day", "--arm", "6R", "--scatter", "0"]
    done = CliRunner().invoke(main, [*options, "--json", str(found)], catch_exceptions=False)
    assert done.exit_code == 0
    told = json.loads(found.read_text())["summaries"]
    assert {*told} <= {*SENTENCES}
    for key in ("design", "identify", "enough now", "enough end", "compensate"):
        assert told[key]["days"] == 2
        assert 0.5 < told[key]["came_over_promised"] < 2.0
        assert SENTENCES[key] in " ".join(done.output.split())
    assert told["changes alarm"]["right"] == 1
    assert told["identify 95 %"]["right"] > 0.8 * told["identify 95 %"]["days"]
