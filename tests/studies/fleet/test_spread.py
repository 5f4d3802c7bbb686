"""Who stands out, against fleets of which the truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest

from studies.fleet.one import Cause, Done, Values
from studies.fleet.spread import latest, off, shared, trend_p

NAMES = tuple((f"geometry:A{k}.x", "um") for k in range(12))


def fleet(rng: np.random.Generator, robots: int, std: float = 0.3) -> list[Done]:
    """Robots of one type that differ as robots do, each known as well as another."""
    return [
        Done(
            f"r{i}", "m.csv", "arm", status="converged",
            rms_mm={"nominal": float(np.exp(0.3 * rng.normal())), "fitted": 0.02, "heldout": None},
            sigma_mm=float(0.01 * np.exp(0.1 * rng.normal())),
            values=Values(NAMES, rng.normal(size=12) * np.arange(1, 13), np.full(12, std)),
        )
        for i in range(robots)
    ]  # fmt: skip


@pytest.mark.parametrize("robots", [6, 9, 40])
def test_alarms_are_as_rare_as_is_said(robots: int) -> None:
    """In one fleet of twenty at most; 200 fleets tell 5 % from more than 9 %."""
    rng = np.random.default_rng(robots)
    assert sum(bool(off(fleet(rng, robots))) for _ in range(200)) <= 18


def test_who_is_off_is_found_in_what_it_is_off(rng: np.random.Generator) -> None:
    robots = fleet(rng, 20)
    own = robots[7]
    assert own.values is not None
    own.values.value[3] += 60.0  # of a spread of 4
    own.rms_mm["nominal"] = 9.0
    found = {(row.robot, row.what) for row in off(robots)}
    assert found == {("r7", "geometry:A3.x"), ("r7", "nominal RMS")}


def test_a_value_that_is_hardly_known_is_not_off(rng: np.random.Generator) -> None:
    robots = fleet(rng, 20)
    own = robots[7].values
    assert own is not None
    own.value[3] += 60.0
    own.std[3] = 50.0
    assert not off(robots)


def test_models_of_other_parameters_are_not_compared(rng: np.random.Generator) -> None:
    robots = fleet(rng, 10)
    for k, own in enumerate(robots):
        assert own.values is not None
        own.values = Values((*NAMES[:-1], (f"other{k}", "um")), own.values.value, own.values.std)
        own.values.value[k] += 1e4
    assert not [row for row in off(robots) if row.what.startswith("geometry")]


def test_too_few_to_say_and_the_last_table_of_each(rng: np.random.Generator) -> None:
    robots = fleet(rng, 5)
    robots[0].rms_mm["nominal"] = 1e3
    assert not off(robots)
    again = Done("r0", "n.csv", "arm", status="converged")
    failed = Done("r0", "o.csv", "arm", fault="line 3: what is this")
    assert latest([*robots, again, failed])[0] is again


def test_causes_are_counted_by_robot() -> None:
    lag, sag = Cause("backlash", "A3", ("backlash:A3", "sag:A3")), Cause("sag", "A3", ("sag:A3",))
    robots = [Done(f"r{i}", "", verdict="explained", causes=(lag,)) for i in range(6)]
    robots += [Done("s", "", verdict="explained", causes=(sag,)), Done("t", "", verdict="no_gap")]
    robots += [Done("u", "", status="converged")]  # nobody asked
    first, second = shared(robots)
    assert (first.effect, first.robots, first.possible) == ("backlash", 6, 6)
    assert (second.effect, second.robots, second.possible) == ("sag", 1, 7)
    true = binomtest(6, 8).proportion_ci(0.95, "exact")
    assert first.ci95 == pytest.approx((true.low, true.high))


def test_a_steady_rise() -> None:
    assert trend_p([1.0, 2.0, 3.0]) is None
    assert trend_p([1.0, 2.0, 3.0, 4.0, 5.0]) == pytest.approx(2 / 120)  # two orders of 5!
    assert trend_p([2.0, 2.0, 2.0, 2.0]) is None
