"""What the README and the pages of the documentation show works as it stands there."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from calib.effects import EFFECTS
from calib.model.build import context_of
from calib.poses import poses_at
from studies.cli import loaded, main
from studies.command.explain import PAGES, page
from studies.demo.embedded import embedded_cell

ROOT = Path(__file__).parent.parent.parent
README = (ROOT / "README.md").read_text()


@pytest.fixture
def beside_the_demo(demo_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(demo_folder, tmp_path / "posecal-demo")
    said = (demo_folder.parent / "said").read_text()
    (tmp_path / "said").write_text(said.replace(str(demo_folder), "posecal-demo"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def blocks(*words: str) -> list[str]:
    """The Python blocks of README and pages that hold these words."""
    texts = "".join((README, *map(page, PAGES)))
    found = re.findall(r"```python\n(.*?)```", texts, flags=re.S)
    return [block for block in found if all(word in block for word in words)]


def test_python_example(beside_the_demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = blocks("load_cell")
    exec(compile(block, "README.md", "exec"), {})
    value, *result, design = capsys.readouterr().out.splitlines()
    assert value.startswith("EstimatedValue(value=-0.0002")
    assert result[0].startswith("kr270 milling cell: The error at held-out poses fell from")
    assert (beside_the_demo / "page.html").stat().st_size > 1e5
    efficiency, _, shape = design.partition(" ")
    assert 0.9 < float(efficiency) <= 1.0
    assert shape == "(15, 6)"


def test_an_effect_of_ones_own() -> None:
    (block,) = blocks("DriveError")
    names: dict[str, Any] = {}
    exec(compile(block, "README.md", "exec"), names)
    context = context_of(embedded_cell(), None)
    effect = names["WarmEncoder"].at(context, "A3")
    assert [p.id for p in effect.parameters] == ["warm_encoder:A3.slope"]
    warm = poses_at(np.zeros((2, 6)), temperature=np.array([20.0, 25.0]))
    np.testing.assert_allclose(effect.shares(warm), [[0.0], [5.0]])


def test_a_criterion_of_ones_own() -> None:
    (block,) = blocks("Trace")
    names: dict[str, Any] = {}
    exec(compile(block, "README.md", "exec"), names)
    criterion = names["Relative"](np.diag([1.0, 2.0]))
    assert criterion.variance(np.diag([1.0, 4.0])) == pytest.approx(1.0 + 4.0 / 4.0)


def test_the_way_of_the_data_names_every_folder() -> None:
    packages = {
        f"{top}/{p.parent.name}"
        for top in ("calib", "doe")
        for p in ROOT.glob(f"{top}/*/__init__.py")
    }
    named = set(re.findall(r"`((?:calib|doe)/\w+)`", README))
    assert packages <= named
    assert all((ROOT / name).exists() for name in named)


def test_every_line_runs(beside_the_demo: Path) -> None:
    """As a reader types them below the set-up, which ``tests.versions`` installs anew."""
    typed = README[README.index("## Your own robot") : README.index("## What it reaches")]
    for line in re.findall(r"^ {4}(\S.*)$", typed, flags=re.M):
        program, *words = shlex.split(line)
        assert program == "posecal"
        done = CliRunner().invoke(main, words)
        assert done.exit_code == 0, f"{line}: {done.output}"
    for made in ("posecal-demo/report.html", "plan.src", "corrected.csv", "report.html"):
        assert (beside_the_demo / made).stat().st_size > 0, made


def test_it_is_set_up_by_one_line() -> None:
    """And tested by another; both can be pasted into a fresh clone."""
    first, *_, last = re.findall(r"^ {4}(\S.*)$", README, flags=re.M)
    assert first.split(" && ")[1:] == [".venv/bin/pip install .", ".venv/bin/posecal demo"]
    assert last.split(" && ")[1:] == [".venv/bin/pip install -e '.[test]'", ".venv/bin/pytest"]


def test_options_in_the_texts_are_those_of_the_commands() -> None:
    for name, option in options_told():
        command = loaded(name)
        known = {own for p in command.params for own in (*p.opts, *p.secondary_opts)}
        assert option in {*known, "--help"}, f"posecal {name} {option}"


def options_told() -> Iterator[tuple[str, str]]:
    """Command and option wherever a text shows both together."""
    for text in (README, *map(page, PAGES)):
        for name, rest in re.findall(r"posecal (\w+)([^`\n]*)", text):
            if name in main.commands:
                for option in re.findall(r"(?<!\S)--[a-z][\w-]*", rest):
                    yield name, option


def test_every_effect_is_named() -> None:
    table = README[README.index("| errors of | effects |") : README.index("Inside the program")]
    assert sorted(re.findall(r"`(\w+)`", table)) == sorted(EFFECTS)


def test_every_command_and_only_pages_that_are_there() -> None:
    assert set(main.commands) <= set(re.findall(r"posecal ([\w-]+)", README))
    named = re.findall(r"posecal explain ([\w-]+)", README)
    assert set(named) - set(EFFECTS) <= set(PAGES)


def test_it_is_short() -> None:
    assert len(README.splitlines()) <= 150
