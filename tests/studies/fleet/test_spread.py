"""Who stands out, against fleets of which the truth is known; which table belongs to which cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from studies.fleet.make import latest, off, shared, trend_p
from studies.fleet.record import NamedEntry
from studies.fleet.tables import TableJob, TableOutcome, Values, find

NAMES = tuple((f"geometry:A{k}.x", "um") for k in range(12))


def fleet(rng: np.random.Generator, robots: int, std: float = 0.3) -> list[TableOutcome]:
    """Robots of one type that differ as robots do, each known as well as another."""
    return [
        TableOutcome(
            f"r{i}", "m.csv", "arm", status="converged",
            rms_mm={"nominal": float(np.exp(0.3 * rng.normal())), "fitted": 0.02, "heldout": None},
            values=Values(NAMES, rng.normal(size=12) * np.arange(1, 13), np.full(12, std)),
        )
        for i in range(robots)
    ]  # fmt: skip


def figures_of(robot: str, robots: list[TableOutcome]) -> set[str]:
    return {row.what for row in off(robots) if row.robot == robot}


@pytest.mark.parametrize("robots", [6, 20])
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
    assert figures_of("r7", robots) == {"geometry:A3.x", "nominal RMS"}


def test_a_value_that_is_hardly_known_is_not_off(rng: np.random.Generator) -> None:
    robots = fleet(rng, 20)
    own = robots[7].values
    assert own is not None
    own.value[3] += 60.0
    own.std[3] = 50.0
    assert not figures_of("r7", robots)


def test_a_parameter_is_compared_where_models_have_it(rng: np.random.Generator) -> None:
    robots = fleet(rng, 20)
    for k, own in enumerate(robots):
        assert own.values is not None
        other = (f"other{k % 5}", "um")  # four robots have each
        own.values = Values((other, *NAMES[1:]), own.values.value, own.values.std)
        own.values.value[0] += 1e4 * k
    assert robots[3].values is not None
    robots[3].values.value[5] += 90.0
    assert figures_of("r3", robots) == {"geometry:A5.x"}
    assert not [row for row in off(robots) if row.what.startswith("other")]


def test_two_do_not_hide_each_other_and_equal_values_say_nothing(rng: np.random.Generator) -> None:
    robots = fleet(rng, 12)
    for k in (2, 9):
        robots[k].rms_mm["nominal"] = 60.0
    assert all("nominal RMS" in figures_of(robot, robots) for robot in ("r2", "r9"))
    robots[4].rms_mm["fitted"] = 0.021  # all others have 0.02
    assert not figures_of("r4", robots)


def test_too_few_to_say_and_the_last_table_of_each(rng: np.random.Generator) -> None:
    robots = fleet(rng, 5)
    robots[0].rms_mm["nominal"] = 1e3
    assert not off(robots)
    again = TableOutcome("r0", "n.csv", "arm", status="converged")
    failed = TableOutcome("r0", "o.csv", "arm", fault="line 3: what is this")
    assert latest([*robots, again, failed])[0] is again


def test_causes_are_counted_by_robot() -> None:
    lag, sag = (
        NamedEntry(effect="backlash", where="A3", alike=("backlash:A3", "sag:A3")),
        NamedEntry(effect="sag", where="A3", alike=("sag:A3",)),
    )
    robots = [TableOutcome(f"r{i}", "", verdict="explained", causes=(lag,)) for i in range(6)]
    robots += [
        TableOutcome("s", "", verdict="explained", causes=(sag,)),
        TableOutcome("t", "", verdict="no_gap"),
    ]
    robots += [TableOutcome("u", "", status="converged")]  # nobody asked
    first, second = shared(robots)
    assert (first.effect, first.robots, first.possible) == ("backlash", 6, 6)
    assert (second.effect, second.robots, second.possible) == ("sag", 1, 7)


def test_a_steady_rise() -> None:
    assert trend_p([1.0, 2.0, 3.0]) is None
    assert trend_p([1.0, 2.0, 3.0, 4.0, 5.0]) == pytest.approx(2 / 120)  # two orders of 5!
    assert trend_p([2.0, 2.0, 2.0, 2.0]) is None


POINTS = "pose,marker,j1_deg,x_mm,y_mm,z_mm\n"


def files(folder: Path, *names: str) -> Path:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        robot = path.suffix == ".toml" and "plain" not in name
        path.write_text("[robot]\n" if robot else POINTS if "plan" not in name else "pose,j1_deg\n")
    return folder


def told(jobs: list[TableJob]) -> list[tuple[str, str, str | None]]:
    return [(job.robot, job.label, job.day) for job in jobs]


def test_a_table_belongs_to_the_next_cell_above_it(tmp_path: Path) -> None:
    files(
        tmp_path, "a/cell.toml", "a/2026-03-01/m.csv", "a/2026-06-09/m.csv", "a/plan.csv",
        "a/inner/cell.toml", "a/inner/own.csv", "b/c/cell.toml", "b/c/m_20260102.csv", "stray.csv",
        ".hidden/cell.toml", ".hidden/m.csv", "b/plain.toml", "d/cell.toml",
    )  # fmt: skip
    assert told(find(tmp_path)) == [
        ("a", "a/2026-03-01/m.csv", "2026-03-01"),
        ("a", "a/2026-06-09/m.csv", "2026-06-09"),
        ("a/inner", "a/inner/own.csv", None),
        ("b/c", "b/c/m_20260102.csv", "2026-01-02"),
        ("d", "", None),
    ]
    results = [job.result("identify").relative_to(tmp_path).as_posix() for job in find(tmp_path)]
    assert results[0] == "a/2026-03-01/m.identify.json"
    assert len(set(results)) == len(results)


def test_robots_side_by_side_in_one_folder(tmp_path: Path) -> None:
    files(tmp_path, "r1.toml", "r10.toml", "r1.csv", "r1_b.csv", "r10.csv", "check.csv")
    assert told(find(tmp_path, without="check.csv")) == [
        ("r1", "r1.csv", None),
        ("r1", "r1_b.csv", None),
        ("r10", "r10.csv", None),
    ]


def test_two_models_of_one_table(tmp_path: Path) -> None:
    jobs = find(files(tmp_path / "arm", "cell.toml", "better.toml", "data.csv"))
    assert told(jobs) == [("better", "data.csv", None), ("arm", "data.csv", None)]
    assert [job.result("diagnose").name for job in jobs] == [
        "data.better.diagnose.json",
        "data.diagnose.json",
    ]
