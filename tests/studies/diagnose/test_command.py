"""``posecal diagnose`` with the files that it writes beside the JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import Result

from tests.helpers import measured_cell
from tests.studies.command_line import run


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
    assert sorted(p.name for p in figures.iterdir()) == [
        f"{name}.{end}" for name in ("spectra", "waterfall") for end in ("csv", "png", "svg")
    ]
    assert f"{better}: the model as it was" in done.output.replace("\n", "")
    assert str(demo.resolve()) not in better.read_text()


@pytest.fixture(scope="module")
def one_effect(data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """The published case with an effect, and the folder of what was written."""
    folder, out = data / "examples" / "one_effect", tmp_path_factory.mktemp("one_effect")
    done = run(
        "diagnose", folder / "cell.toml", folder / "measurements.csv",
        "--holdout", folder / "heldout.csv",
        "--json", out / "found.json", "--cell-out", out / "better.toml",
    )  # fmt: skip
    return done, out


@pytest.mark.long
def test_a_published_case_with_an_effect(one_effect: tuple[Result, Path]) -> None:
    done, folder = one_effect
    assert done.exit_code == 0, done.output
    fields = json.loads((folder / "found.json").read_text(), parse_constant=pytest.fail)
    assert fields["verdict"] == "explained"
    (effect,) = fields["effects"]
    assert (effect["effect"], effect["where"]) == ("backlash", "a5")
    (p,) = effect["parameters"]
    assert abs(p["value"] - 120.0) < 3.0 * p["std"]
    assert fields["located"][0]["depends_on"] == "approach:a5"
    assert fields["gap"]["heldout_after_mm"] < 1.1 * fields["gap"]["floor_mm"]


@pytest.mark.long
def test_a_published_case_without_one(data: Path, tmp_path: Path) -> None:
    folder, out = data / "examples" / "no_effect", tmp_path / "found.json"
    done = run(
        "diagnose", folder / "cell.toml", folder / "measurements.csv",
        "--holdout", folder / "heldout.csv", "--json", out,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    fields = json.loads(out.read_text(), parse_constant=pytest.fail)
    assert fields["verdict"] == "no_gap"


@pytest.mark.long
def test_the_next_run_starts_from_the_better_model(
    data: Path, one_effect: tuple[Result, Path]
) -> None:
    first, written = one_effect
    better = written / "better.toml"
    assert "Cause found: backlash:a5" in first.output
    assert '"backlash:a5"' in better.read_text()
    second = run("diagnose", better, data / "examples" / "one_effect" / "measurements.csv")
    assert second.exit_code == 0, second.output
    assert "No unmodelled error found: the residuals are noise" in second.output
