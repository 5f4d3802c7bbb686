"""``posecal explain``: every page is shown, and what is made from tables holds what they hold."""

from __future__ import annotations

import re
from importlib.resources import files

import pytest

from calib.effects import EFFECTS
from calib.files.columns import OTHERS, WRENCH
from calib.instruments import KINDS
from doe.criteria import CRITERIA, UNASKED
from studies.command.explain import PAGES, page
from studies.research.docs_tables import cell_keys, made_anew
from tests.studies.command_line import run
from tests.studies.reading import length, sentences, texts


def said(*arguments: str) -> str:
    done = run("explain", *arguments)
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


def test_all_pages_are_listed() -> None:
    listed = said()
    for name in PAGES:
        assert f"{name} {page(name).splitlines()[0].removeprefix('# ')}" in listed
    on_disk = {f.name for f in (files("studies") / "docs").iterdir()}
    assert on_disk == {f"{name}.md" for name in PAGES}


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_shown_whole_and_its_tables_are_those_of_the_code(name: str) -> None:
    text = page(name)
    assert made_anew(text) == text, "run python -m studies.research.docs_tables"
    words = set(re.findall(r"\w{4,}", re.sub(r"\*\*|```\w*|<!--.*-->", "", text)))
    shown = said(name)
    squeezed = re.sub(r"\s", "", shown)
    assert all(word in squeezed for word in words)
    assert "\N{HORIZONTAL ELLIPSIS}" not in shown, "nothing is cut off"


@pytest.mark.parametrize("name", [*EFFECTS, *CRITERIA])
def test_every_effect_and_criterion_has_a_page(name: str) -> None:
    shown = said(name)
    assert shown.startswith(f"{name} ")
    assert ("parameters (at a place)" in shown) is (name in EFFECTS)
    assert "``" not in shown
    assert ":class:" not in shown


def test_another_name_is_refused_with_the_closest() -> None:
    done = run("explain", "backlsh")
    assert done.exit_code == 2
    assert "did you mean backlash?" in done.stderr


def rows(name: str) -> list[str]:
    """Rows of all tables of a page without their marks."""
    tables = re.findall(r"^\|[-|]+\|\n((?:\|.*\n?)*)", page(name), flags=re.M)
    lines = [line.replace("\\", "") for t in tables for line in t.splitlines()]
    return [re.sub(r" \| |[`|]", " ", line).strip() for line in lines]


def test_what_an_effect_needs_comes_from_its_class() -> None:
    effects = {line.split()[0]: line for line in rows("effects")}
    assert set(effects) == set(EFFECTS)
    assert "temperature_degC" in effects["thermal_expansion"]
    assert "approach_<joint>" in effects["backlash"]
    assert "a wrench, a payload, or link masses" in effects["joint_compliance"]
    assert {line.split()[0] for line in rows("design")} >= set(CRITERIA) - {UNASKED}


def test_the_cell_says_what_every_key_of_its_schema_means() -> None:
    known = cell_keys()
    assert not [key for key, (_, meanings) in known.items() if not meanings]
    assert len(rows("cell")) == len(known), "each key stands in one table"
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
    table = [line for line in rows("instruments") if line.startswith("distance")]
    assert "d_mm sigma_mm, anchor_mm, offset, reach_mm" in table[0]
    assert {line.split()[0] for line in rows("instruments")} >= set(KINDS)
