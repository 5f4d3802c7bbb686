"""One run of the demonstration, and one identification, for all tests that read what they leave."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

import pytest

from tests.fuzz.small_cell import put_small_cell
from tests.helpers import measured_cell
from tests.studies.command_line import ran, run

TARGETS = """A1_rad,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg,weight
0.2,-60,70,20,45,10,1
-0.5,-90,100,0,30,0,2
0.7,-45,60,-40,60,90,1
0,-80,90,0,0,0,1
"""


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
            done = run("demo", folder)
            assert done.exit_code == 0, done.output
            said.write_text(done.output)
    return folder


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's cell, measurements of a robot that the model knows, and what ``identify`` says."""
    folder = measured_cell(tmp_path_factory.mktemp("demo"))
    call = ("identify", folder / "cell.toml", folder / "measurements.csv")
    (folder / "said").write_text(
        ran(*call, "--json", folder / "result.json", "--urdf", folder / "better.urdf")
    )
    (folder / "targets.csv").write_text(TARGETS)
    return folder


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A cell of two joints, a plan, and 15 points at eight poses, the last as the first."""
    put_small_cell(tmp_path)
    return tmp_path
