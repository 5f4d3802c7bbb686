"""A fault of our own code is a traceback: it is never said to lie in the user's file."""

from __future__ import annotations

import functools
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
from studies.report.page import report_page
from tests.studies.examples import EXAMPLES, SILENT


def _functions(kind: str) -> Iterator[tuple[str, str]]:
    """Everything that tells or draws a record: module, function."""
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
                yield part, name


def _of_modules() -> Iterator[tuple[str, str, str]]:
    """One function of each module of those."""
    for kind in KINDS:
        found = dict(reversed([*_functions(kind)]))
        found |= {module: name for module, name in _functions(kind) if name == "told"}
        yield from ((kind, module, name) for module, name in found.items())


def misspelt(*_: Any, **__: Any) -> Any:
    raise AttributeError("'EnoughRecord' object has no attribute 'gaol_mm'")


def misshapen(*_: Any, **__: Any) -> Any:
    raise ValueError("operands could not be broadcast together with shapes (3,) (4,)")


def _replace(patch: pytest.MonkeyPatch, module: str, name: str, other: Any) -> None:
    """Put another function in place of one wherever it was imported."""
    own = getattr(importlib.import_module(module), name)
    for user in list(sys.modules.values()):
        ours = getattr(user, "__name__", "").startswith("studies.")
        if ours and user.__dict__.get(name) is own:
            patch.setattr(user, name, other)


@pytest.mark.sampled
@pytest.mark.parametrize(("kind", "module", "name"), list(_of_modules()))
def test_a_page_does_not_blame_the_file(
    kind: str, module: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = tmp_path / "good.json"
    draws = module.endswith("pictures")
    _replace(monkeypatch, module, name, misshapen if draws else misspelt)
    for record in EXAMPLES[kind]:
        result.write_text(record.dumps())
        try:
            told = tell(record)
            if draws:
                list(pictures_of(told))
        except (AttributeError, ValueError):
            break
    done = CliRunner().invoke(main, ["report", str(result), "-o", str(tmp_path / "page.html")])
    assert type(done.exception) is (ValueError if draws else AttributeError)
    assert "good.json" not in done.output
    assert "write it anew" not in done.output
    assert not (tmp_path / "page.html").exists()


@pytest.mark.sampled
@pytest.mark.parametrize("kind", KINDS)
def test_the_whole_page_of_every_example(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every column, sentence and figure as the page shows it.

    The examples reach every function that tells or draws, so that a typo put anywhere fails here.
    """
    reached: set[tuple[str, str]] = set()
    for module, name in _functions(kind):
        own = getattr(importlib.import_module(module), name)

        @functools.wraps(own)
        def noted(*args: Any, _own: Any = own, **kwargs: Any) -> Any:
            reached.add((_own.__module__, _own.__name__))
            return _own(*args, **kwargs)

        _replace(monkeypatch, module, name, noted)
    monkeypatch.setattr("studies.document.page.inline_svg", lambda *_: Markup("<svg></svg>"))
    files = []
    for number, record in enumerate(EXAMPLES[kind]):
        files.append(tmp_path / f"{number}.json")
        files[-1].write_text(record.dumps())
    html = re.sub("</?code>", "`", report_page(files, None, {})[0].replace("<wbr>", ""))
    for record in EXAMPLES[kind]:
        assert list(terminal(tell(record))) or kind in SILENT
        for sentence in tell(record).headline:
            assert sentence.text.replace("'", "&#39;") in html
    assert reached >= set(_functions(kind))
