"""Conclusions against a truth of their own: days are as large as asked, and are counted right."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

pytest.importorskip("mujoco")

from studies.research.benchmarks.conclusions import foreign, parts
from studies.research.benchmarks.conclusions.__main__ import main, one_day
from studies.research.benchmarks.conclusions.days import (
    Day,
    TrueCause,
    arm_of,
    named,
    random_poses,
    tuned,
)
from studies.research.benchmarks.conclusions.judged import calibration, judged, outcome, rates
from studies.research.benchmarks.conclusions.parts import DRAWS
from studies.research.withheld.visible import at_rest


@pytest.fixture(autouse=True)
def any_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    """The default plan takes ten seconds to find."""
    arm = arm_of("ur_on_track")
    q = random_poses(np.random.default_rng(1), arm, parts.POSES)
    monkeypatch.setattr(parts, "plan", lambda: q)


def a_day(part: str, index: int) -> Day:
    return DRAWS[part](np.random.default_rng([7, index]), index)


@pytest.mark.parametrize("index", range(8))
def test_quiet_arms_scatter_as_asked(index: int) -> None:
    """The tip, seen through a marker put at its origin, over the instrument's standard deviation."""
    day = parts.draw_nothing(np.random.default_rng(index), index)
    assert not day.causes
    assert day.scene.scatter is not None
    assert bool(day.scene.scatter.joints.any()) == (index % 2 == 0)
    scene = replace(day.scene, markers=np.zeros((1, 3)))
    mechanism, rng = scene.mechanism(), np.random.default_rng(0)
    still = at_rest(scene, mechanism, ()).points
    drawn = [scene.scatter.drawn(rng, scene.session.visit) for _ in range(20)]
    moved = np.array([at_rest(scene, mechanism, [wander]).points - still for wander in drawn])
    assert np.sqrt(np.mean(moved**2)) == pytest.approx(day.ratio * parts.QUIET_SIGMA, rel=0.08)


def test_formulas() -> None:
    moves = np.array([0.5, -0.01, -0.6, 0.02, 0.0, 0.4])
    assert foreign.play_with_dead_band(moves, 0.05).tolist() == [1, 1, -1, -1, -1, 1]
    far = np.abs(moves) > 0.1
    np.testing.assert_allclose(
        foreign.smooth_hysteresis(moves, 0.05)[far], np.sign(moves)[far], atol=1e-5
    )
    q = np.linspace(-np.pi, np.pi, 2001)[:-1]
    wheel = foreign.eccentric(q, 0.3, 0.5, 0.9)
    assert 2 * np.mean(wheel * np.sin(q - 0.3)) == pytest.approx(1.0, rel=0.005)
    assert 2 * np.mean(wheel * np.sin(2 * q - 0.9)) == pytest.approx(0.5, rel=0.1)
    assert abs(np.mean(wheel)) < 1e-12
    third = np.hypot(*(2 * np.mean(wheel * f(3 * q)) for f in (np.cos, np.sin)))
    assert 1e-3 < third < 5e-3  # what no harmonic of the catalogue has
    torque = np.linspace(-50.0, 50.0, 11)
    np.testing.assert_allclose(foreign.hardening(torque, 0.3)[[0, 5, -1]], [-35.0, 0.0, 35.0])
    time = np.arange(0.0, 40000.0, 10.0)
    lag = foreign.lagging(20.0 + 1e-3 * time, time, 1200.0)
    np.testing.assert_allclose(20.0 + 1e-3 * time[-1] - lag[-1], 1.2, rtol=0.01)
    assert foreign.two_constants(time, 600.0, 1800.0, 0.4)[0] == 1.0
    assert foreign.smooth_step(time, 20000.0, 60.0)[[0, 2000, -1]].tolist() == [0.0, 0.5, 1.0]
    ripple = foreign.fading_ripple(q, 100.0, 0.0, 0.0)
    assert 1.2 < ripple.max() < 1.34


def effect(name: str, *others: str, probability: float = 0.95, **parameters: float) -> Any:
    """As the findings have it."""
    members = [dict(zip(("effect", "where"), n.split(":"), strict=True)) for n in (name, *others)]
    return {
        **members[0],
        "probability": probability,
        "class": [{**m, "probability": probability} for m in members],
        "parameters": [
            {"name": n, "value": v, "std": 1.0, "unit": "1/turn"} for n, v in parameters.items()
        ],
    }


def cause(*names: Any) -> TrueCause:
    return TrueCause("made", "A1", lambda scene, _: scene.nothing(), names)


def test_outcomes_by_hand() -> None:
    backlash = cause(*named("A1", "backlash", "friction_windup"))
    assert outcome(effect("backlash:A1"), [backlash]) == "right"
    assert outcome(effect("friction_windup:A1"), [backlash]) == "right"
    assert outcome(effect("backlash:A2"), [backlash]) == "wrong"
    assert outcome(effect("settling:A1", "backlash:A1"), [backlash]) == "in_class"
    (ripple,) = named("A1", "gear_ripple")
    fine = cause(tuned(ripple, "cycles", 200.0, "1/turn", 1.0))
    assert outcome(effect("gear_ripple:A1", cycles=199.5), [fine]) == "right"
    assert outcome(effect("gear_ripple:A1", cycles=180.0), [fine]) == "wrong"
    assert outcome(effect("backlash:A1"), [fine, backlash]) == "right"
    assert outcome(effect("backlash:A1"), []) == "wrong"


def said(*effects: Any, verdict: str = "explained") -> dict[str, Any]:
    return {"verdict": verdict, "effects": effects, "located": [], "seconds": 1.0}


def test_a_family_and_a_single() -> None:
    """Two of three visible members are enough; a pair needs the single one beside."""
    day = a_day("hard", foreign.HARD_KINDS.index("backlashes_gear"))
    family = [cause(*named(f"A{k}", "backlash")) for k in range(1, 5)]
    beside = cause(*named("A9", "transmission_harmonic"))
    sizes = (100.0, 100.0, 100.0, 5.0, 100.0)
    day = replace(day, causes=(*family, beside), noncentrality=sizes, family=4)
    found = [effect("backlash:A1"), effect("backlash:A2"), effect("step:base")]
    row = judged(day, said(*found))
    assert row["family"] == {"named": 2, "visible": 3, "found": True}
    assert (row["wrong"], row["found"]) == (1, [True, True, False, False, False])
    both = judged(day, said(*found, effect("transmission_harmonic:A9")))
    counted = {figure: hits for _, figure, hits, _ in rates("hard", [both])}
    assert counted == {
        "in class": 0, "family": 1, "pair": 1, "wrong named": 1, "wrong at .9": 1, "explained": 1,
    }  # fmt: skip
    assert {f: h for _, f, h, _ in rates("hard", [row])}["pair"] == 0


def test_probability_of_two_names_is_one() -> None:
    """A step of base or instrument at .48 each is a step of one of them at .96."""
    day = a_day("nothing", 1)
    row = judged(day, said(effect("step:base", "step:instrument", probability=0.48)))
    assert row["effects"][0]["entry"] == pytest.approx(0.96)
    alone = judged(day, said(effect("backlash:A1", "settling:A1", probability=0.48)))
    assert alone["effects"][0]["entry"] == pytest.approx(0.48)
    counted = {label: own for label, *own in calibration([row, alone])}
    assert counted["0.9 to 1"] == counted["0 to 0.5"] == [0, 0, 1]


@pytest.mark.long
@pytest.mark.parametrize("part", DRAWS)
def test_one_day_is_asked_and_judged(part: str) -> None:
    row = one_day(part, 0, 0)
    assert row["error"] is None
    assert row["verdict"] in ("no_gap", "explained", "ambiguous", "unknown")
    assert len(row["found"]) == len(row["truth"]) == len(row["noncentrality"])
    json.dumps(row, allow_nan=False)


def test_command(tmp_path: Path) -> None:
    path = tmp_path / "days.json"
    done = CliRunner().invoke(main, ["foreign", "--days", "1", "--json", str(path)])
    assert done.exit_code == 0, done.output
    assert max(map(len, done.output.splitlines())) <= 120
    (row,) = json.loads(path.read_text())["days"]
    assert (row["part"], row["day"], row["kind"]) == ("foreign", 0, "hysteresis")
    assert all({"standing", "class_size", "size_in_std"} <= set(e) for e in row["effects"])
