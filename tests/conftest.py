"""Shared fixtures: the embedded cell, and the real data where they are present."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

# Small matrices: threads of the linear algebra cost more than they give, most on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from calib import Cell, Poses
from studies.demo.embedded import embedded_cell, embedded_plan

# How long an example takes says nothing where tests run beside each other.
settings.register_profile("posecal", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("posecal")

ROOT = Path(__file__).parent.parent
# What takes long to make, so that every test with it is long.
LONG = {"browser", "demo_folder", "python_day"}
SAMPLED = 8


@pytest.hookimpl(tryfirst=True)  # before those not asked for are left out
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as long what takes a long fixture, and of sampled cases all but one in eight.

    What reads the demonstration comes first, so that one process makes it and none waits for it.
    """
    cases: Counter[str] = Counter()
    items.sort(key=lambda item: "demo_folder" not in getattr(item, "fixturenames", ()))
    for item in items:
        if LONG & set(getattr(item, "fixturenames", ())):
            item.add_marker("long")
        if item.get_closest_marker("sampled"):
            test = item.nodeid.partition("[")[0]
            if cases[test] % SAMPLED:
                item.add_marker("long")
            cases[test] += 1


def data_folder() -> Path:
    """Where the real measurements lie; they are never part of the repository."""
    return Path(os.environ.get("POSECAL_DATA", ROOT.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def data() -> Path:
    if not data_folder().is_dir():
        pytest.skip("real measurements are absent (POSECAL_DATA)")
    return data_folder()


@pytest.fixture
def rng() -> np.random.Generator:
    """Draws that are the same in whatever order the tests run."""
    return np.random.default_rng(1)


@pytest.fixture(scope="session")
def kr270() -> Cell:
    return embedded_cell()


@pytest.fixture(scope="session")
def table_two(kr270: Cell) -> Poses:
    return embedded_plan(kr270)


@pytest.fixture(scope="session")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of good files, not to be changed, of which bad ones are copies with an edit."""
    from tests.bad_inputs.run import prepare

    folder = tmp_path_factory.mktemp("good") / "good"
    prepare(folder)
    return folder
