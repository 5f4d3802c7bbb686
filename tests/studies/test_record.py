"""Results as records: what is written is read, what is not so is refused with its place in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from click.testing import CliRunner

from calib.errors import InputError
from studies.cli import main
from studies.results.read import json_schema, read
from tests.fuzz.small_cell import small_results

KINDS = {
    "identified": "identify",
    "diagnosed": "diagnose",
    "sight": "plan",
    "designed": "design",
    "compared": "compare",
    "enough": "enough",
    "compensated": "compensate",
}


@pytest.mark.parametrize("name", KINDS)
def test_what_is_written_is_read_again(name: str, tmp_path: Path) -> None:
    fields = small_results()[name]
    (tmp_path / "x.json").write_text(json.dumps(fields))
    record = read(tmp_path / "x.json")
    assert record.kind == KINDS[name]
    assert json.loads(record.to_json()) == fields


@pytest.mark.parametrize("name", KINDS)
def test_the_schema_holds_for_what_is_written(name: str) -> None:
    kind, fields = KINDS[name], small_results()[name]
    done = CliRunner().invoke(main, ["schema", kind])
    assert done.exit_code == 0, done.output
    schema = json.loads(done.output)
    assert schema == json_schema(kind)
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    validator.validate(fields)
    assert not validator.is_valid({**fields, "inputs": 3})


def test_unknown_keys_are_ignored(tmp_path: Path) -> None:
    fields = small_results()["enough"]
    (tmp_path / "x.json").write_text(json.dumps({**fields, "colour": "red"}))
    assert json.loads(read(tmp_path / "x.json").to_json()) == fields


FAULTS = {
    "text": ("compensated", ("rms_mm", "left"), "much", "rms_mm.left: should be a valid number"),
    "below zero": ("compensated", ("rms_mm", "left"), -1.0, "rms_mm.left: should be greater than"),
    "in a list": ("compensated", ("targets", 1, "pose"), 7, "targets[1].pose: should be a valid"),
    "no targets": ("compensated", ("targets",), [], "targets: "),
    "nothing": ("enough", ("lacking",), None, "lacking: "),
    "missing": ("enough", ("lacking", "scatter_mm"), ..., "lacking.scatter_mm: is missing"),
    "another schema": ("enough", ("schema",), 2, "schema: is not 1"),
    "no number": ("enough", ("goal_mm",), float("nan"), "goal_mm: should be a finite"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_wrong_in_a_file_is_one_line_with_its_place(fault: str, tmp_path: Path) -> None:
    name, place, value, message = FAULTS[fault]
    path = tmp_path / "result.json"
    fields = json.loads(json.dumps(small_results()[name]))
    _put(fields, place, value)
    path.write_text(json.dumps(fields))
    with pytest.raises(InputError) as caught:
        read(path)
    assert message in str(caught.value)
    done = CliRunner().invoke(main, ["report", str(path), "-o", str(tmp_path / "page.html")])
    assert done.exit_code == 2
    assert done.stderr == f"posecal: {caught.value}\n"
    assert str(path) in done.stderr


def _put(fields: Any, place: tuple[str | int, ...], value: Any) -> None:
    """value : Ellipsis to take out."""
    for key in place[:-1]:
        fields = fields[key]
    if value is ...:
        del fields[place[-1]]
    else:
        fields[place[-1]] = value
