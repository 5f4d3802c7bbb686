"""Every kind of result in words, on a terminal and on a page; names are text, numbers have a rule."""

from __future__ import annotations

import re
from typing import Any

import pytest
from jinja2 import UndefinedError

from studies import render
from studies.kinds import result_type
from studies.results.base import NotAsked, Result
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
FIGURES = ("identified", "diagnosed", "designed", "compared")
SCRIPT = "</script><script>alert(1)</script><img src=x onerror=alert(2)> *a* _b_ `c` [d](e) | f"


def made(name: str) -> Result:
    return result_type(KINDS[name]).model_validate(small_results()[name])


def spoken(value: Any) -> Any:
    """Texts with a script behind them, wherever a user writes them."""
    own = ("pose", "marker", "name", "reason", "cell", "targets", "instrument")
    if isinstance(value, dict):
        return {
            k: v + SCRIPT if k in own and isinstance(v, str) else spoken(v)
            for k, v in value.items()
        }
    return [spoken(part) for part in value] if isinstance(value, list) else value


@pytest.mark.parametrize("page", [False, True], ids=["terminal", "page"])
@pytest.mark.parametrize("name", KINDS)
def test_every_kind_is_said(name: str, page: bool, capsys: pytest.CaptureFixture[str]) -> None:
    drawn: list[str] = []

    def draw(_: Any, figure: str, caption: str) -> str:
        assert caption.endswith(".")
        drawn.append(figure)
        return f"<figure>{figure}</figure>"

    text = render.markdown(made(name), page=page, draw=draw if page else None)
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


@pytest.mark.parametrize("name", KINDS)
def test_texts_of_results_are_no_markup(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    result = result_type(KINDS[name]).model_validate(spoken(small_results()[name]))
    text = render.markdown(result, page=True)
    html = render.html(text)
    assert "alert(1)" in html
    assert not re.search(r"<(script|img|em|a )", html)
    assert "<code>c</code>" not in html
    render.print_markdown(render.markdown(result))
    assert SCRIPT.split()[0] in capsys.readouterr().out


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
