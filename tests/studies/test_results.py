"""Results of every kind: read again, said on terminal and page, faults placed; no text is markup."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from jinja2 import UndefinedError

from calib.errors import InputError
from studies import render
from studies.kinds import result_type
from studies.report import Reported, page_of
from studies.results.base import NotAsked
from studies.results.read import json_schema, read
from tests.fuzz.small_cell import KINDS, small_results
from tests.studies.command_line import check_harmless, checked, result, run

FIGURES = ("identified", "diagnosed", "designed", "compared")
PLACES = ("pose", "marker", "name", "reason", "cell", "targets", "instrument")

SCRIPT = (
    "</script><script>alert(1)</script><!--\"'><img src=x onerror=alert(2)> *a* _b_ `c` [d](e) | f"
)


def written(folder: Path, name: str, fields: Any = None) -> Path:
    """The file of a result, as its command wrote it or with other fields."""
    path = folder / f"{name}.json"
    path.write_text(json.dumps(small_results()[name] if fields is None else fields))
    return path


@pytest.mark.parametrize("name", KINDS)
def test_what_is_written_is_read_again_and_keeps_its_schema(name: str, tmp_path: Path) -> None:
    kind, fields = KINDS[name], small_results()[name]
    record = read(written(tmp_path, name, {**fields, "colour": "red"}))  # unknown keys are ignored
    assert record.kind == kind
    assert json.loads(record.to_json()) == fields
    checked(fields, kind)
    with pytest.raises(jsonschema.ValidationError):
        checked({**fields, "inputs": 3}, kind)
    assert json.loads(run("schema", kind).output) == json_schema(kind)


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
    fields = at = json.loads(json.dumps(small_results()[name]))
    for key in place[:-1]:
        at = at[key]
    if value is ...:
        del at[place[-1]]
    else:
        at[place[-1]] = value
    path = written(tmp_path, "result", fields)
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        read(path)
    done = run("report", path, "-o", tmp_path / "page.html")
    assert (done.exit_code, done.stderr) == (2, f"posecal: {caught.value}\n")
    assert str(path) in done.stderr


@pytest.mark.parametrize("page", [False, True], ids=["terminal", "page"])
@pytest.mark.parametrize("name", KINDS)
def test_every_kind_is_said(name: str, page: bool, capsys: pytest.CaptureFixture[str]) -> None:
    drawn: list[str] = []

    def draw(_: Any, figure: str, caption: str) -> str:
        assert caption.endswith(".")
        drawn.append(figure)
        return f"<figure>{figure}</figure>"

    result = result_type(KINDS[name]).model_validate(small_results()[name])
    text = render.markdown(result, page=page, draw=draw if page else None)
    answer, advice, body = render.parts(text)
    assert answer.startswith("**")
    assert len(answer.splitlines()[0]) < 200
    assert advice.rstrip().endswith(".")
    assert not re.search(r"\b(nan|inf|None|True|False)\b", text)
    assert bool(drawn) is (page and name in FIGURES)
    assert page or "<details>" not in body
    if page:
        html = render.html(text)
        assert html.count("<details>") == html.count("</details>")
        assert html.count("<table>") == html.count('class="wide"') > 1
        assert "|:--" not in html, "every table is one"
    else:
        render.print_markdown(text)
        lines = capsys.readouterr().out.splitlines()
        assert max(map(len, lines)) <= 100
        assert not re.search(r"\\[_*\[]|\*\*|<details", "\n".join(lines)), "no markup is left"


def hostile(value: Any) -> Any:
    """Texts with a script behind them, wherever a user writes them."""
    if isinstance(value, dict):
        return {
            k: v + SCRIPT if k in PLACES and isinstance(v, str) else hostile(v)
            for k, v in value.items()
        }
    return [hostile(part) for part in value] if isinstance(value, list) else value


@pytest.mark.parametrize("name", KINDS)
def test_texts_of_results_are_no_markup(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a template, on a terminal, and on the page of a report."""
    fields = hostile(small_results()[name])
    result = result_type(KINDS[name]).model_validate(fields)
    html = render.html(render.markdown(result, page=True))
    assert "alert(1)" in html
    assert not re.search(r"<(script|img|em|a )", html)
    assert "<code>c</code>" not in html
    render.print_markdown(render.markdown(result))
    assert SCRIPT.split()[0] in capsys.readouterr().out
    page = page_of([Reported.read(written(tmp_path, name, fields))], None, {}).html
    assert "alert(1)" in page
    check_harmless(page)


def test_a_number_without_a_rule_and_an_unknown_name_are_faults_of_ours() -> None:
    template = render.environment().from_string
    assert template("{{ x|short }} {{ y }} {{ n }}").render(x=0.0123456, y="a_b", n=None) == (
        r"0.0123 a\_b -"
    )
    with pytest.raises(TypeError, match="without a rule"):
        template("{{ x }}").render(x=0.1)
    with pytest.raises(UndefinedError):
        template("{{ r.gaol_mm }}").render(r={})


def test_a_narrow_terminal_cuts_no_name(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(render, "_WIDTH", 50)
    name = "a_very_long_name_of_a_joint_that_somebody_gave_to_it"
    render.print_markdown(f"| joint | value |\n|:--|--:|\n| {name} | 1.0 |\n")
    lines = capsys.readouterr().out.splitlines()
    assert name in "".join(line.split("  ")[0].strip() for line in lines)


def test_what_could_not_be_asked_is_gathered_by_its_reason() -> None:
    reason = "cannot act: no temperature; add a column"
    asked = [
        NotAsked(effect=f"thermal_expansion:A{i}", reason=f"thermal_expansion:A{i} {reason}")
        for i in range(6)
    ]
    asked.append(NotAsked(effect="warm_up:A1", reason=f"warm_up:A1 {reason}"))
    assert render.by_reason(asked) == [
        ("no temperature; add a column", "thermal_expansion, warm_up:A1")
    ]


def misspelt(*_: Any, **__: Any) -> Any:
    raise AttributeError("'EnoughResult' object has no attribute 'gaol_mm'")


def misshapen(*_: Any, **__: Any) -> Any:
    raise ValueError("operands could not be broadcast together with shapes (3,) (4,)")


@pytest.mark.parametrize(
    ("name", "function", "fault"),
    [
        ("enough", "studies.results.enough.EnoughResult.error", property(misspelt)),
        ("identified", "studies.render.markdown", misspelt),
        ("identified", "studies.figures.errors_by_pose", misshapen),
        ("sight", "studies.results.plan.PlanResult.at_joints", misshapen),
    ],
)
def test_a_page_does_not_blame_the_file(
    name: str, function: str, fault: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = written(tmp_path, "good", small_results()[name])
    monkeypatch.setattr(function, fault)
    done = run("report", result, "-o", tmp_path / "page.html")
    assert type(done.exception) is (ValueError if fault is misshapen else AttributeError)
    assert "good.json" not in done.output
    assert not (tmp_path / "page.html").exists()


def test_poses_to_come_are_found_without_a_plan(small: Path) -> None:
    call = ("enough", small / "cell.toml", small / "data.csv")
    fields, said = result(small / "out.json", *call, kind="enough")
    assert fields["order"] == []
    assert "planned poses" not in said
    assert f"RMS now, from {fields['now']['readings']} readings." in said


@pytest.mark.parametrize(
    "call",
    ["design {} --candidates 40", "compare {} {}/plan.csv", "enough {} {}/data.csv",
     "diagnose {} {}/plan.csv --plan-only"],
)  # fmt: skip
def test_what_the_cell_reports_is_in_the_result(call: str, small: Path, tmp_path: Path) -> None:
    cell = small / "reported.toml"
    cell.write_text((small / "cell.toml").read_text() + '[report]\noperator = "second shift"\n')
    fields, _ = result(tmp_path / "out.json", *call.format(cell, small).split())
    assert fields["about"] == {"operator": "second shift"}
