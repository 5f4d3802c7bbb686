"""A fault of our own code is a traceback: it is never said to lie in the user's file."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from markupsafe import Markup

from studies.cli import main
from studies.document import pictures_of
from studies.document.terminal import terminal
from studies.kinds import KINDS, record_type, tell
from tests.studies.examples import EXAMPLES, OLD, SILENT


def _functions() -> Iterator[tuple[str, str, str]]:
    """Everything that tells or draws a record: kind, module, function."""
    for kind in KINDS:
        home = record_type(kind).__module__
        room = home.removesuffix(".record")
        parts = [home] if hasattr(importlib.import_module(home), "told") else []
        if not parts:
            known = (f"{room}.{part}" for part in ("telling", "pictures"))
            parts = [part for part in known if importlib.util.find_spec(part) is not None]
        for part in parts:
            module = importlib.import_module(part)
            for name, function in inspect.getmembers(module, inspect.isfunction):
                tells = "Record" in next(iter(function.__annotations__.values()), "")
                if function.__module__ == part and (tells or part != home):
                    yield kind, part, name


def _of_modules() -> Iterator[tuple[str, str, str]]:
    """One function of each module of those."""
    found = {module: (kind, module, name) for kind, module, name in reversed([*_functions()])}
    told = {module: (kind, module, n) for kind, module, n in _functions() if n == "told"}
    yield from {**found, **told}.values()


def misspelt(*_: Any, **__: Any) -> Any:
    raise AttributeError("'EnoughRecord' object has no attribute 'gaol_mm'")


def misshapen(*_: Any, **__: Any) -> Any:
    raise ValueError("operands could not be broadcast together with shapes (3,) (4,)")


def _break(patch: pytest.MonkeyPatch, module: str, name: str, fault: Any) -> None:
    """Put the fault in place of a function wherever it was imported."""
    own = getattr(importlib.import_module(module), name)
    for other in list(sys.modules.values()):
        ours = getattr(other, "__name__", "").startswith("studies.")
        if ours and other.__dict__.get(name) is own:
            patch.setattr(other, name, fault)


@pytest.mark.parametrize(("kind", "module", "name"), list(_functions()))
def test_examples_reach_everything_that_tells(
    kind: str, module: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that a typo put anywhere fails here: each function is taken away in turn."""
    function = getattr(importlib.import_module(module), name)
    drawn = module.endswith("pictures") or function.__annotations__.get("return") == "Picture"
    _break(monkeypatch, module, name, misspelt)
    with pytest.raises(AttributeError, match="gaol_mm"):
        _shown(kind, drawn)


def _shown(kind: str, drawn: bool) -> None:
    for record in EXAMPLES[kind]:
        told = tell(record)
        assert list(terminal(told)) or kind in SILENT
        if drawn:
            assert list(pictures_of(told))


@pytest.mark.parametrize("fault", [misspelt, misshapen])
@pytest.mark.parametrize(("kind", "module", "name"), list(_of_modules()))
def test_a_page_does_not_blame_the_file(
    kind: str, module: str, name: str, fault: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = tmp_path / "good.json"
    _break(monkeypatch, module, name, fault)
    for record in EXAMPLES[kind]:
        result.write_text(record.dumps())
        try:
            told = tell(record)
            if module.endswith("pictures"):
                list(pictures_of(told))
        except (AttributeError, ValueError):
            break
    done = CliRunner().invoke(main, ["report", str(result), "-o", str(tmp_path / "page.html")])
    assert type(done.exception) in (AttributeError, ValueError)
    assert "good.json" not in done.output
    assert "write it anew" not in done.output
    assert not (tmp_path / "page.html").exists()


@pytest.mark.parametrize("kind", KINDS)
def test_the_whole_page_of_every_example(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every column, sentence and figure as the page shows it; drawn to the end once."""
    from studies.report.page import report_page

    report_page([OLD / f"{kind}.json"], None, {})
    monkeypatch.setattr("studies.document.page.inline_svg", lambda *_: Markup("<svg></svg>"))
    files = []
    for number, record in enumerate(EXAMPLES[kind]):
        files.append(tmp_path / f"{number}.json")
        files[-1].write_text(record.dumps())
    html = re.sub("</?code>", "`", report_page(files, None, {})[0].replace("<wbr>", ""))
    for record in EXAMPLES[kind]:
        for sentence in tell(record).headline:
            assert sentence.text.replace("'", "&#39;") in html
