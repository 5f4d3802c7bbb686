"""One run of the demonstration for all tests that read what it leaves."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

import pytest
from click.testing import CliRunner

from studies.cli import main


@pytest.fixture(scope="session")
def demo_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of ``posecal demo``, not to be changed; what it printed stands in ``said``.

    It takes a minute: the first process of a run to ask makes it, the others wait for that one.
    """
    base = tmp_path_factory.getbasetemp()
    whole = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "whole"
    whole.mkdir(exist_ok=True)
    folder, said = whole / "posecal-demo", whole / "said"
    with (whole / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not said.exists():
            done = CliRunner().invoke(main, ["demo", str(folder)])
            assert done.exit_code == 0, done.output
            said.write_text(done.output)
    return folder
