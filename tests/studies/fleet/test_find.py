"""Which table belongs to which cell, and where its results stand."""

from __future__ import annotations

from pathlib import Path

from studies.fleet.tables import Job, find

POINTS = "pose,marker,j1_deg,x_mm,y_mm,z_mm\n"


def files(folder: Path, *names: str) -> Path:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        robot = path.suffix == ".toml" and "plain" not in name
        path.write_text("[robot]\n" if robot else POINTS if "plan" not in name else "pose,j1_deg\n")
    return folder


def told(jobs: list[Job]) -> list[tuple[str, str, str | None]]:
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
