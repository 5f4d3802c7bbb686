"""Sentences that are counted: what a day asks, and how it is summed up."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

pytest.importorskip("mujoco")

from studies.research.benchmarks.claims import SENTENCES, Said, main, summaries


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
