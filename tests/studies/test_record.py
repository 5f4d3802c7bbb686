"""Results as records: what is written is read, what is not so is refused with its place in one line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from click.testing import CliRunner

from calib.errors import InputError
from studies.cli import main
from studies.document import pictures_of
from studies.document.terminal import terminal
from studies.kinds import KINDS, record_type, tell
from studies.record import Record
from studies.results import json_schema, read
from tests.studies.examples import EXAMPLES, OLD, SILENT, old_fields


def test_every_kind_has_its_type_its_place_and_its_examples() -> None:
    for kind in KINDS:
        assert all(record.kind == kind for record in EXAMPLES[kind])
        assert all(isinstance(record, record_type(kind)) for record in EXAMPLES[kind])
    assert set(EXAMPLES) == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_written_is_read_again(kind: str, tmp_path: Path) -> None:
    for record in EXAMPLES[kind]:
        (tmp_path / "x.json").write_text(record.dumps())
        assert read(tmp_path / "x.json") == record


@pytest.mark.parametrize("kind", KINDS)
def test_results_of_earlier_versions_keep_every_figure(kind: str) -> None:
    """The JSON has the same keys and values as before there were records, and perhaps more."""
    old, new = old_fields(kind), json.loads(read(OLD / f"{kind}.json").dumps())
    assert _within(old, new)


def _within(old: Any, new: Any) -> bool:
    if isinstance(old, dict):
        return all(key in new and _within(value, new[key]) for key, value in old.items())
    if isinstance(old, list):
        return len(old) == len(new) and all(map(_within, old, new))
    return bool(old == new)


@pytest.mark.parametrize("kind", KINDS)
def test_the_schema_holds_for_what_is_written(kind: str) -> None:
    done = CliRunner().invoke(main, ["schema", kind])
    assert done.exit_code == 0, done.output
    schema = json.loads(done.output)
    assert schema == json_schema(kind)
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    for record in EXAMPLES[kind]:
        validator.validate(json.loads(record.dumps()))
    assert not validator.is_valid({**json.loads(EXAMPLES[kind][0].dumps()), "inputs": 3})


FAULTS = {
    "text": ("compensate", ("rms_mm", "left"), "much", "rms_mm.left: should be a valid number"),
    "below zero": ("compensate", ("rms_mm", "left"), -1.0, "rms_mm.left: should be greater than"),
    "too large": ("compensate", ("rms_mm", "left"), 1e200, "rms_mm.left: is of no plausible size"),
    "in a list": ("compensate", ("targets", 2, "pose"), 7, "targets[2].pose: should be a valid string"),
    "missing": ("enough", ("lacking",), None, "lacking: "),
    "other joints": ("compensate", ("targets", 1, "joints_deg"), {"B7": 1.0}, "the same joints"),
    "no targets": ("compensate", ("targets",), [], "targets: "),
    "more than there are": ("enough", ("poses_to_goal",), 50, "count more poses than order holds"),
    "nameless": ("enough", ("order", 0, "pose"), None, "has no name"),
    "parameters astray": ("enough", ("end", "parameters"), [], "now and end have other parameters"),
    "another version": ("enough", ("schema",), 2, "schema: is not 1"),
    "stranger": ("enough", ("colour",), "red", "colour: is not known"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_wrong_in_a_file_is_one_line_with_its_place(fault: str, tmp_path: Path) -> None:
    kind, place, value, message = FAULTS[fault]
    path = tmp_path / "result.json"
    path.write_text(json.dumps(_with(old_fields(kind), place, value)))
    with pytest.raises(InputError) as caught:
        read(path)
    assert message in str(caught.value)
    done = CliRunner().invoke(main, ["report", str(path), "-o", str(tmp_path / "page.html")])
    assert done.exit_code == 2
    assert done.stderr == f"posecal: {caught.value}\n"
    assert str(path) in done.stderr


def _with(fields: Any, place: tuple[str | int, ...], value: Any) -> Any:
    inner = fields
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    return fields


HERE = "<the place>"
VALUES = (None, "x", -1, 0, 1e29, True, [], {})


@pytest.mark.parametrize(
    "one_in", [pytest.param(64, marks=pytest.mark.part), pytest.param(1, marks=pytest.mark.long)]
)
@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_is_refused_or_told(kind: str, one_in: int, tmp_path: Path) -> None:
    """No value anywhere in a file makes our own code fail: what a record holds can be told."""
    path, read_well = tmp_path / "result.json", 0
    for number, place in enumerate(_places(old_fields(kind))):
        around = json.dumps(_with(old_fields(kind), place, HERE)).split(json.dumps(HERE))
        for value in VALUES[number % one_in :: one_in]:
            path.unlink(missing_ok=True)  # some file systems write out at once what is cut short
            path.write_text(json.dumps(value).join(around))
            record = _read_or_refused(path)
            if record is None:
                continue
            read_well += 1
            assert list(terminal(tell(record))) or kind in SILENT
            if value in (0, 1e29) and _drawn(place):
                assert list(pictures_of(tell(record))) or kind in WORDS_ALONE
    assert read_well > len(old_fields(kind)) / one_in


WORDS_ALONE = {
    "hand-eye",
    "prior",
    "next",
    "init",
    "program",
    "import",
    "report",
    "demo",
}  # kinds without a figure
UNDRAWN = {"estimate", "length_mm", "task_rms_mm", "task_worst_mm", "rms_of_residuals_mm"}


def _drawn(place: tuple[str | int, ...]) -> bool:
    """Whether figures show it, and it is the first of its kind: they take their time."""
    return str(place[-1]).endswith("_mm") and place[0] not in UNDRAWN and 1 not in place


def _read_or_refused(path: Path) -> Record | None:
    try:
        return read(path)
    except InputError:
        return None


def _places(fields: Any, at: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Every entry, of lists the first two."""
    keys = list(fields) if isinstance(fields, dict) else range(min(2, len(fields)))
    for key in keys:
        yield (*at, key)
        if isinstance(fields[key], dict | list):
            yield from _places(fields[key], (*at, key))
