"""``posecal diagnose --plan-only`` as a user sees it."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from calib import Cell, Poses
from doe.forecast.foresee import foresee
from studies.demo.embedded import __file__ as demo_file
from studies.results.base import envelope
from studies.results.plan import PlanResult
from tests.studies.command_line import run as posecal

DEMO = Path(demo_file).parent


run = partial(posecal, "diagnose")


@pytest.mark.long
def test_a_plan_is_judged_before_anything_is_measured(tmp_path: Path) -> None:
    out = tmp_path / "plan.json"
    done = run(DEMO / "cell.toml", DEMO / "plan.csv", "--plan-only", "--json", out)
    assert done.exit_code == 0, done.output
    assert max(map(len, done.output.splitlines()[:-1])) <= 110
    fields = json.loads(out.read_text(), parse_constant=pytest.fail)
    assert fields["command"] == "diagnose"
    assert fields["plan_only"] is True
    assert fields["readings"] == 30
    entries = {(e["effect"], e["where"]): e for e in fields["could_not_see"]}
    assert entries["tracker_scale", "instrument"]["minimum_detectable"] is None
    assert "geometry" in entries["tracker_scale", "instrument"]["reason"]
    backlash = entries["backlash", "A2"]
    assert backlash["unit"] == "urad"
    assert backlash["reason"] is None
    assert 1.0 < backlash["minimum_detectable"] < 100.0
    assert any("time_s" in e["reason"] for e in fields["not_asked"])
    for pair in fields["look_alikes"]:
        own = entries[pair["effect"], pair["where"]]
        times = pair["told_apart_times"]
        assert times is None or times > 1.0
        assert pair["probability_at_minimum"] < fields["sure"]
        if times is not None:
            expected = times * own["minimum_detectable"]
            assert pair["told_apart_from"] == pytest.approx(expected)


def test_measurements_are_read_without_their_points(data: Path) -> None:
    folder = data / "examples" / "one_effect"
    done = run(folder / "cell.toml", folder / "measurements.csv", "--plan-only")
    assert done.exit_code == 0, done.output
    assert "base_drift:base = tracker_drift:instrument" in done.output


@pytest.mark.long
def test_what_no_parameter_shows_alone_is_hidden(kr270: Cell, table_two: Poses) -> None:
    """A rigid model: of the tip's own frame beside the markers nothing but rounding is left."""
    effects = ("base", "tool", "stiffness_vs_angle:A2", "joint_compliance:A3,A4")
    found = foresee(replace(kr270, effects=effects), table_two)
    entries = PlanResult.of(found, kr270, envelope("cell", [])).could_not_see
    assert all((e.minimum_detectable is None) == bool(e.reason) for e in entries)
    tip = next(e for e in entries if e.key == "link_geometry:tool0")
    assert tip.reason is not None
    assert tip.reason.endswith("the markers in the same way")
