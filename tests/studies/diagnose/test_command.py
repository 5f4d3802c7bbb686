"""``posecal diagnose`` with the files that it writes beside the JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.helpers import measured_cell
from tests.studies.command_line import result, run


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return measured_cell(tmp_path_factory.mktemp("demo"))


@pytest.mark.long
def test_figures_and_cell_are_written_together(demo: Path, tmp_path: Path) -> None:
    better, figures = tmp_path / "better.toml", tmp_path / "figures"
    done = run(
        "diagnose", demo / "cell.toml", demo / "measurements.csv",
        "--cell-out", better, "--figures", figures, "--json", tmp_path / "d.json",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert [p.name for p in figures.iterdir()] == ["causes.svg"]
    assert f"{better}: the model as it was" in done.output.replace("\n", "")
    assert str(demo.resolve()) not in better.read_text()


@pytest.fixture(scope="module")
def one_effect(
    data: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[dict[str, Any], str, Path]:
    """The published case with an effect, and the better cell."""
    better = tmp_path_factory.mktemp("one_effect") / "better.toml"
    call = ("diagnose", *example(data, "one_effect"), "--cell-out", better)
    return *result(better.with_name("found.json"), *call), better


def example(data: Path, name: str) -> tuple[object, ...]:
    """Cell and table of a published case, and its poses held out."""
    folder = data / "examples" / name
    return folder / "cell.toml", folder / "measurements.csv", "--holdout", folder / "heldout.csv"


@pytest.mark.long
def test_a_published_case_with_an_effect(
    one_effect: tuple[dict[str, Any], str, Path],
) -> None:
    fields, _, _ = one_effect
    assert fields["verdict"] == "explained"
    (effect,) = fields["effects"]
    assert (effect["effect"], effect["where"]) == ("backlash", "a5")
    (p,) = effect["parameters"]
    assert abs(p["value"] - 120.0) < 3.0 * p["std"]
    assert fields["located"][0]["depends_on"] == "approach:a5"
    assert fields["gap"]["heldout_after_mm"] < 1.1 * fields["gap"]["floor_mm"]


@pytest.mark.long
def test_a_published_case_without_one(data: Path, tmp_path: Path) -> None:
    fields, _ = result(tmp_path / "found.json", "diagnose", *example(data, "no_effect"))
    assert fields["verdict"] == "no_gap"


@pytest.mark.long
def test_the_next_run_starts_from_the_better_model(
    data: Path, one_effect: tuple[dict[str, Any], str, Path]
) -> None:
    _, said, better = one_effect
    assert "Cause found: backlash:a5" in said
    assert '"backlash:a5"' in better.read_text()
    second = run("diagnose", better, data / "examples" / "one_effect" / "measurements.csv")
    assert second.exit_code == 0, second.output
    assert "No unmodelled error found: the residuals are noise" in second.output
