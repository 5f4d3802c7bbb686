"""Faces of the packages: what they teach runs, nothing hides a module. Style, types, layers."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import calib
import doe
from tests.helpers import measured_cell

ROOMS = [
    found.name
    for face in (calib, doe)
    for found in pkgutil.walk_packages(face.__path__, f"{face.__name__}.")
    if found.ispkg
]


@pytest.mark.parametrize("name", ["calib", "doe", *ROOMS])
def test_no_name_hides_a_module(name: str) -> None:
    face = importlib.import_module(name)
    for found in pkgutil.iter_modules(face.__path__):
        importlib.import_module(f"{name}.{found.name}")
        assert isinstance(getattr(face, found.name), ModuleType), found.name


@pytest.mark.parametrize("face", [calib, doe], ids=["calib", "doe"])
def test_the_face_has_all_that_it_names(face: ModuleType) -> None:
    assert sorted(face.__all__) == face.__all__
    assert all(inspect.getdoc(getattr(face, name)) for name in face.__all__)


@pytest.mark.long
def test_the_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    measured_cell(tmp_path)
    monkeypatch.chdir(tmp_path)
    met = {}
    for face in (calib, doe):
        code = "\n".join(re.findall(r"^    (.*)$", face.__doc__ or "", flags=re.M))
        exec(compile(code, face.__name__, "exec"), met)
    assert met["commands"].shape == (15, 6)
    assert met["plan"].poses.q.shape == (15, 6)
    assert 0.5 < met["plan"].efficiency <= 1.0
    assert isinstance(met["left"], doe.Enough)


def test_names_are_found_when_they_are_asked_for() -> None:
    """None is imported before, nor what it stands on."""
    assert all(getattr(calib, name).__module__.startswith("calib.") for name in calib.__all__)
    assert set(calib.__all__) <= set(dir(calib))
    with pytest.raises(AttributeError, match="nothing"):
        _ = calib.nothing
    code = "import sys, calib; print(sorted({'numpy', 'scipy', 'pydantic'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# -- Style, types and layers

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
