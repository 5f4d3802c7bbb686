"""Style, types and layers are part of the test suite."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
BIN = Path(sys.executable).parent

CHECKS = {
    "ruff check": [BIN / "ruff", "check", "."],
    "ruff format": [BIN / "ruff", "format", "--check", "."],
    "mypy": [BIN / "mypy"],
    "import layers": [BIN / "lint-imports"],
}


@pytest.mark.long
@pytest.mark.parametrize("name", list(CHECKS))
def test_check(name: str) -> None:
    done = subprocess.run(CHECKS[name], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_readme_lines_are_the_ones_that_ci_runs() -> None:
    readme = (ROOT / "README.md").read_text()
    ci = (ROOT / ".ci" / "run").read_text()
    line = next(text for text in readme.splitlines() if text.strip().endswith("bin/pytest"))
    assert "README.md" in ci, "the script takes its line from the README"
    assert "-m ''" in ci, "and leaves no test out"
    assert line.strip().startswith("python3 -m venv .venv && .venv/bin/pip install")
