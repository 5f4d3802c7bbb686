"""What a person reads before any work is done: help, README and pages; it works as it stands."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.shell_completion import BashComplete

from calib.effects import EFFECTS
from calib.files.columns import OTHERS, WRENCH
from calib.instruments import KINDS
from calib.model.build import context_of
from calib.poses import poses_at
from doe.criteria import CRITERIA, UNASKED
from studies.cli import COMMANDS, GROUPS, loaded, main
from studies.command.explain import PAGES, page, text_of
from studies.demo.embedded import embedded_cell
from studies.research.docs_tables import cell_keys, made_anew
from studies.struck import INSTEAD, remedy
from tests.studies.command_line import heard, ran, refused, run

HEAVY = {"cvxpy", "distributed", "jinja2", "matplotlib", "mujoco"}
HEAVY |= {"numpy", "pydantic", "rich", "scipy"}
ASKED = [["--help"], ["--version"], ["nonsense"], *([name, "--help"] for name in main.commands)]


def test_nothing_heavy_is_imported_for_help() -> None:
    """So that it comes at once; `python -m studies.research.speed` measures it.

    One process is asked all: what one word brings stays for those after it.
    """
    code = f"""
import contextlib, io, sys
from studies.cli import run
for words in {ASKED}:
    said = io.StringIO()
    sys.argv = ["posecal", *words]
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            run()
        except SystemExit:
            pass
    brought = {HEAVY} & sys.modules.keys()
    if words in {ASKED[:3]}:
        brought |= {{name for name in sys.modules if name.endswith(".command")}}
    print(*words, bool(said.getvalue()), *brought)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [f"{' '.join(words)} True" for words in ASKED]


def test_help_lists_the_commands_in_three_groups() -> None:
    said = run("--help").output
    places = [said.index(f"\n{title}:\n") for title in GROUPS]
    assert places == sorted(places)
    for name in (name for names in GROUPS.values() for name in names):
        assert re.search(rf"^  {name} +{re.escape(COMMANDS[name])}$", said, flags=re.M)
    listed, _, end = said.rpartition("\n\n")
    assert {*COMMANDS} == {"explain", "schema"}.union(*GROUPS.values())
    for name in ("explain", "schema"):
        assert f"\n  {name} " not in listed
        assert f"posecal {name}" in end


@pytest.mark.parametrize("name", COMMANDS)
def test_every_name_of_the_help_is_a_command_with_an_example(name: str) -> None:
    command = loaded(name)
    assert command.name == name
    assert f"posecal {name}" in (command.help or "").partition("Example")[2]


def test_options_choices_and_files_are_completed(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the command answers the script that a shell evaluates."""

    def completed(words: str) -> str:
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", str(words.count(" ")))
        return BashComplete(main, {}, "posecal", "_POSECAL_COMPLETE").complete()

    assert completed("posecal design --cri") == "plain,--criterion"
    assert "plain,task" in completed("posecal design --criterion ").split()
    for words in ("posecal identify ", "posecal identify --json "):
        assert completed(words).startswith("file,")


def explained(*names: str) -> str:
    return ran("explain", *names)


def test_all_pages_are_listed() -> None:
    listed = explained()
    for name in PAGES:
        assert f"{name} {page(name).splitlines()[0].removeprefix('# ')}" in listed
    on_disk = {f.name for f in (files("studies") / "docs").iterdir()}
    assert on_disk == {f"{name}.md" for name in PAGES}


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_shown_whole_and_its_tables_are_those_of_the_code(name: str) -> None:
    text = page(name)
    assert made_anew(text) == text, "run python -m studies.research.docs_tables"
    words = set(re.findall(r"\w{4,}", re.sub(r"\*\*|```\w*|<!--.*-->", "", text)))
    shown = explained(name)
    squeezed = re.sub(r"\s", "", shown)
    assert all(word in squeezed for word in words)
    assert "\N{HORIZONTAL ELLIPSIS}" not in shown, "nothing is cut off"


@pytest.mark.parametrize("name", [*EFFECTS, *CRITERIA])
def test_every_effect_and_criterion_has_a_page(name: str) -> None:
    shown = explained(name)
    assert shown.startswith(f"{name} ")
    assert ("parameters (at a place)" in shown) is (name in EFFECTS)
    assert "``" not in shown
    assert ":class:" not in shown


def test_another_name_is_refused_with_the_closest() -> None:
    assert "did you mean backlash?" in refused("explain", "backlsh")


def rows_of(name: str) -> list[str]:
    """Rows of all tables of a page without their marks."""
    tables = re.findall(r"^\|[-|]+\|\n((?:\|.*\n?)*)", page(name), flags=re.M)
    lines = [line.replace("\\", "") for t in tables for line in t.splitlines()]
    return [re.sub(r" \| |[`|]", " ", line).strip() for line in lines]


def test_what_an_effect_needs_comes_from_its_class() -> None:
    effects = {line.split()[0]: line for line in rows_of("effects")}
    assert set(effects) == set(EFFECTS)
    assert "temperature_degC" in effects["thermal_expansion"]
    assert "approach_<joint>" in effects["backlash"]
    assert "a wrench, a payload, or link masses" in effects["joint_compliance"]
    assert {line.split()[0] for line in rows_of("design")} >= set(CRITERIA) - {UNASKED}


def test_the_cell_says_what_every_key_of_its_schema_means() -> None:
    known = cell_keys()
    assert not [key for key, (_, meanings) in known.items() if not meanings]
    assert len(rows_of("cell")) == len(known), "each key stands in one table"
    assert dict.fromkeys(["number"]) == known["instrument.sigma_mm.divisor"][0]
    assert list(known["design.obstacle[].type"][0]) == ['"box"', '"sphere"', '"halfspace"']


def test_no_sentence_is_longer_than_thirty_words() -> None:
    read = dict(texts())
    assert {"README", "--help", "cell", "diagnosis"} <= set(read)
    long = [own for text in read.values() for own in sentences(text) if length(own) > 30]
    assert not long


def test_columns_and_keys_of_instruments_are_stated() -> None:
    columns = page("columns")
    for name in (*OTHERS, *WRENCH):
        assert re.search(rf"[`\s]{re.escape(name)}[`\s]", columns), name
    table = [line for line in rows_of("instruments") if line.startswith("distance")]
    assert "d_mm sigma_mm, anchor_mm, offset, on" in table[0]
    assert {line.split()[0] for line in rows_of("instruments")} >= set(KINDS)


_CELL_WORDS = 5  # fewer are a name, not a sentence
_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_CODE = re.compile(r"`[^`]+`")
_LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
_MADE = re.compile(r"^<!-- .* -->$", re.MULTILINE)
_END = re.compile(r"(?<=[.?!])[\"')*]*\s+(?=[\"'(*]*[A-Z0-9\-]|symbol|posecal)")
_WORD = re.compile(r"[A-Za-z0-9][\w'.,/%-]*")


def length(sentence: str) -> int:
    """Words of a sentence.

    >>> length("Run symbol, then read 0.3 mm.")
    6
    """
    return len(_WORD.findall(sentence))


def sentences(markdown: str) -> Iterator[str]:
    r"""Sentences of a text in Markdown.

    >>> list(sentences("# Title\n\nRun `a b`. It takes 0.3 s.\n\n- one\n- two\n\n    code here"))
    ['Run symbol.', 'It takes 0.3 s.', 'one', 'two']
    """
    text = _MADE.sub("", _LINK.sub(r"\1", _CODE.sub("symbol", _FENCE.sub("", markdown))))
    for block in re.split(r"\n[ \t]*\n", text):
        lines = block.strip("\n")
        if not lines.strip() or lines.startswith(("    ", "#", "**Parameters**")):
            continue
        if lines.startswith("|"):
            cells = [cell.strip() for line in lines.splitlines()[2:] for cell in line.split("|")]
            entries = [cell for cell in cells if length(cell) >= _CELL_WORDS]
        else:
            entries = re.split(r"^(?:- |\d+\. )", lines, flags=re.MULTILINE)
        for entry in entries:
            running = " ".join(entry.replace("**", "").split())
            yield from (own for own in _END.split(running) if length(own))


def texts() -> Iterator[tuple[str, str]]:
    """What is read, by name: the README, what ``--help`` says, every page, effects and criteria."""
    yield "README", (ROOT / "README.md").read_text(encoding="utf-8")
    yield "--help", "\n\n".join(help_texts())
    yield "effects and criteria", "\n\n".join(map(text_of, (*EFFECTS, *CRITERIA)))
    yield from ((name, page(name)) for name in PAGES)


def help_texts() -> Iterator[str]:
    """What the commands say of themselves and of their options, without the examples."""
    yield main.help or ""
    for name in COMMANDS:
        command = loaded(name)
        yield re.sub(r"\n\s*\x08.*", "", command.help or "", flags=re.DOTALL)
        options = [p.help for p in command.params if isinstance(p, click.Option) and p.help]
        yield "\n".join(["| text |", "|---|", *(f"| {own} |" for own in options)])


ROOT = Path(__file__).parent.parent.parent
README = (ROOT / "README.md").read_text()


@pytest.fixture
def beside_the_demo(demo_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(demo_folder, tmp_path / "posecal-demo")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def blocks(*words: str) -> list[str]:
    """The Python blocks of README and pages that hold these words."""
    texts = "".join((README, *map(page, PAGES)))
    found = re.findall(r"```python\n(.*?)```", texts, flags=re.S)
    return [block for block in found if all(word in block for word in words)]


def run_block(*words: str) -> dict[str, Any]:
    """The names that the one block with these words leaves."""
    names: dict[str, Any] = {}
    (block,) = blocks(*words)
    exec(compile(block, "README.md", "exec"), names)
    return names


def test_python_example(beside_the_demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_block("load_cell")
    value, *result, design = capsys.readouterr().out.splitlines()
    assert value.startswith("EstimatedValue(value=-0.0002")
    assert result[0].startswith("kr270 milling cell: The error at held-out poses fell from")
    assert (beside_the_demo / "page.html").stat().st_size > 1e5
    efficiency, _, shape = design.partition(" ")
    assert 0.9 < float(efficiency) <= 1.0
    assert shape == "(15, 6)"


def test_an_effect_of_ones_own() -> None:
    context = context_of(embedded_cell(), None)
    effect = run_block("DriveError")["WarmEncoder"].at(context, "A3")
    assert [p.id for p in effect.parameters] == ["warm_encoder:A3.slope"]
    warm = poses_at(np.zeros((2, 6)), temperature=np.array([20.0, 25.0]))
    np.testing.assert_allclose(effect.shares(warm), [[0.0], [5.0]])


def test_a_criterion_of_ones_own() -> None:
    criterion = run_block("Trace")["Relative"](np.diag([1.0, 2.0]))
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
        ran(*words)
    for made in ("posecal-demo/report.html", "plan.src", "corrected.csv", "report.html"):
        assert (beside_the_demo / made).stat().st_size > 0, made


def test_it_is_set_up_by_one_line() -> None:
    """And tested by another; both can be pasted into a fresh clone."""
    first, *_, last = re.findall(r"^ {4}(\S.*)$", README, flags=re.M)
    assert first.split(" && ")[1:] == [".venv/bin/pip install .", ".venv/bin/posecal demo"]
    assert last.split(" && ")[1:] == [".venv/bin/pip install -e '.[test]'", ".venv/bin/pytest"]


def test_options_in_the_texts_are_those_of_the_commands() -> None:
    """Wherever a text shows a command and an option together."""
    told = re.findall(r"posecal (\w+)([^`\n]*)", "\n".join((README, *map(page, PAGES))))
    for name, rest in told:
        for option in re.findall(r"(?<!\S)--[a-z][\w-]*", rest if name in main.commands else ""):
            params = loaded(name).params
            known = {own for p in params for own in (*p.opts, *p.secondary_opts)}
            assert option in {*known, "--help"}, f"posecal {name} {option}"


def test_every_effect_is_named() -> None:
    table = README[README.index("| errors of | effects |") : README.index("Inside the program")]
    assert sorted(re.findall(r"`(\w+)`", table)) == sorted(EFFECTS)


def test_every_command_and_only_pages_that_are_there() -> None:
    assert set(main.commands) <= set(re.findall(r"posecal ([\w-]+)", README))
    named = re.findall(r"posecal explain ([\w-]+)", README)
    assert set(named) - set(EFFECTS) <= set(PAGES)


def test_it_is_short() -> None:
    assert len(README.splitlines()) <= 150


@pytest.mark.parametrize("name", INSTEAD)
def test_what_to_use_is_said(name: str, tmp_path) -> None:
    if name in COMMANDS:
        pytest.skip("still a command")
    call = name if not name.startswith("-") else f"changes {name}"
    said = heard(call, tmp_path)
    assert said.status == 2
    assert len(said.err.splitlines()) == 1
    assert INSTEAD[name] in said.err


def test_another_word_is_left_to_click() -> None:
    assert remedy("No such command 'nowhere'.") is None
