"""A fault of our own code is a traceback: it is never said to lie in the user's file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from studies.cli import main
from tests.fuzz.small_cell import small_results


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
    result = tmp_path / "good.json"
    result.write_text(json.dumps(small_results()[name]))
    monkeypatch.setattr(function, fault)
    done = CliRunner().invoke(main, ["report", str(result), "-o", str(tmp_path / "page.html")])
    assert type(done.exception) is (ValueError if fault is misshapen else AttributeError)
    assert "good.json" not in done.output
    assert not (tmp_path / "page.html").exists()
