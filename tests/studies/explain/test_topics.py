"""``posecal explain``: every topic is shown, and what is made from tables holds what they hold."""

from __future__ import annotations

import re
from importlib.resources import files

import pytest

from calib.effects import EFFECTS
from calib.files.columns import OTHERS, WRENCH
from calib.instruments import KINDS
from doe.criteria import CRITERIA, UNASKED
from studies.explain.topics import (
    TABLES,
    keys,
    rows,
    titles,
    topic,
    written,
)
from tests.studies.command_line import run
from tests.studies.explain.reading import length, sentences, texts


def said(*arguments: str) -> str:
    done = run("explain", *arguments)
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


def test_all_topics_are_listed() -> None:
    told = said()
    for name, title in titles().items():
        assert f"{name} {title}" in told
    on_disk = {f.name for f in (files("studies.explain") / "topics").iterdir()}
    assert on_disk == {f"{name}.md" for name in titles()}, "no file that is no topic"


def words_of(text: str) -> set[str]:
    return set(re.findall(r"\w{4,}", re.sub(r"\{.*?\}", "", text)))


@pytest.mark.parametrize("name", written())
def test_a_topic_is_shown_whole(name: str) -> None:
    shown = said(name)
    assert words_of(re.sub(r"\*\*|```\w*", "", written()[name])) <= words_of(shown)
    assert titles()[name] in shown
    assert "\N{HORIZONTAL ELLIPSIS}" not in shown, "nothing is cut off"


@pytest.mark.parametrize("name", [*EFFECTS, *CRITERIA])
def test_every_effect_and_criterion_is_a_topic(name: str) -> None:
    shown = said(name)
    assert shown.startswith(f"{name} ")
    assert ("Parameters" in shown) is (name in EFFECTS)
    assert "``" not in shown
    assert ":class:" not in shown


def test_what_an_effect_needs_comes_from_its_class() -> None:
    effects = {line.split()[0]: line for line in topic_rows("effects")}
    assert set(effects) == set(EFFECTS)
    assert "temperature_degC" in effects["thermal_expansion"]
    assert "approach_<joint>" in effects["backlash"]
    assert "a wrench, a payload, or link masses" in effects["joint_compliance"]
    assert {line.split()[0] for line in topic_rows("criteria")} >= set(CRITERIA) - {UNASKED}


def topic_rows(name: str) -> list[str]:
    """Rows of all tables without their marks."""
    tables = re.findall(r"^\|[-| ]+\|\n((?:\|.*\n?)*)", topic(name), flags=re.M)
    lines = [line.replace("\\", "") for t in tables for line in t.splitlines()]
    return [re.sub(r" \| |[`|]", " ", line).strip() for line in lines]


def test_the_cell_says_what_every_key_of_its_schema_means() -> None:
    known = keys()
    assert not [key for key, own in known.items() if not own.meanings]
    told = [f"{table}:{key}" for table in ("", *TABLES) for key, _, _ in rows(table)]
    assert len(told) == len(set(told)) == len(known), "each key stands in one table"
    assert dict.fromkeys(["number"]) == known["instrument.sigma_mm.divisor"].forms
    assert list(known["design.obstacle[].type"].forms) == ['"box"', '"sphere"', '"halfspace"']
    text = written()["cell"]
    assert all(f"{{cell.{table}}}" in text for table in ("", *TABLES))


def test_at_most_twenty_words_have_to_be_explained() -> None:
    assert len(topic_rows("words")) <= 20


def test_no_sentence_is_longer_than_thirty_words() -> None:
    read = dict(texts())
    assert {"README", "--help", "cell", "diagnosis"} <= set(read)
    long = [own for text in read.values() for own in sentences(text) if length(own) > 30]
    assert not long


def test_columns_and_keys_of_instruments_are_told() -> None:
    columns = written()["columns"]
    for name in (*OTHERS, *WRENCH):
        assert re.search(rf"[`\s]{re.escape(name)}[`\s]", columns), name
    table = [line for line in topic_rows("instruments") if line.startswith("distance")]
    assert "d_mm sigma_mm, anchor_mm, offset, reach_mm" in table[0]


def test_every_kind_of_instrument_that_a_cell_may_have_is_told() -> None:
    kinds = {line.split()[0] for line in topic_rows("instruments")}
    assert kinds >= set(KINDS)
