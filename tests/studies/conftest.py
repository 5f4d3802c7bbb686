"""The demonstration, run once for all who read it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from shutil import copytree

import pytest
from click.testing import CliRunner

from studies.cli import main


@dataclass(frozen=True)
class Demonstration:
    """What ``posecal demo`` wrote, not to be changed, and what it said."""

    folder: Path
    output: str

    def copied(self, folder: Path) -> Path:
        """The same files, to change."""
        return copytree(self.folder, folder)


@pytest.fixture(scope="session")
def demonstration(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    folder = tmp_path_factory.mktemp("demonstration") / "posecal-demo"
    done = CliRunner().invoke(main, ["demo", str(folder)])
    assert done.exit_code == 0, done.output
    return Demonstration(folder, done.output)


@pytest.fixture
def demo(demonstration: Demonstration) -> Path:
    """Its folder, not to be changed."""
    return demonstration.folder
