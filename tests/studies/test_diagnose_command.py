"""``posecal diagnose`` with the files that it writes beside the JSON."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from studies.cli import main
from tests.helpers import measured_cell


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return measured_cell(tmp_path_factory.mktemp("demo"))


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


@pytest.mark.parametrize("name", ["cell.toml", "kr270.urdf", "measurements.csv"])
def test_no_input_is_written_over(demo: Path, name: str) -> None:
    before = (demo / name).read_bytes()
    done = run("diagnose", demo / "cell.toml", demo / "measurements.csv", "--cell-out", demo / name)
    assert done.exit_code == 2
    assert len(done.output.strip().splitlines()) == 1
    assert "is already an input or another output" in done.output
    assert (demo / name).read_bytes() == before


def test_the_next_run_starts_from_the_better_model(data: Path, tmp_path: Path) -> None:
    folder, better = data / "examples" / "one_effect", tmp_path / "better.toml"
    table = folder / "measurements.csv"
    first = run("diagnose", folder / "cell.toml", table, "--cell-out", better)
    assert "explained by backlash:a5" in first.output
    assert '"backlash:a5"' in better.read_text()
    second = run("diagnose", better, table)
    assert second.exit_code == 0, second.output
    assert "no gap beyond noise" in second.output
