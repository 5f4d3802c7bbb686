"""One run of the demonstration for all tests that read what it leaves."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from studies.cli import main


@pytest.fixture(scope="session")
def demo_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of ``posecal demo``, not to be changed; what it printed stands in ``said``."""
    folder = tmp_path_factory.mktemp("whole") / "posecal-demo"
    done = CliRunner().invoke(main, ["demo", str(folder)])
    assert done.exit_code == 0, done.output
    (folder.parent / "said").write_text(done.output)
    return folder
