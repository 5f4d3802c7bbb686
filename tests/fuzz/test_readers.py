"""Neighbours of good files are read, or refused in one plain line; never a traceback or a warning."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.errors import CalibError
from studies.demo.embedded import INPUTS, embedded_text
from tests.fuzz.mutate import mutated
from tests.fuzz.readers import READERS

LONGEST = 1010  # characters of a message
MOST = {"whole": 4, "estimate": 30, "mjcf": 60}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that cells name."""
    folder = tmp_path_factory.mktemp("fuzz")
    for name in INPUTS:
        (folder / name).write_text(embedded_text(name), encoding="utf-8")
    (folder / "targets.csv").write_text(embedded_text("plan.csv"), encoding="utf-8")
    return folder


@pytest.mark.long
@pytest.mark.parametrize("name", READERS)
def test_good_inputs_are_read(name: str, folder: Path) -> None:
    read, seeds = READERS[name]
    for seed in seeds:
        read(folder, seed.encode())


def neighbours_keep_the_rule(name: str, folder: Path, most: int) -> None:
    read, seeds = READERS[name]

    @settings(max_examples=most, suppress_health_check=list(HealthCheck))
    @given(st.integers(0, 2**32), st.sampled_from(seeds))
    def check(draw: int, seed: str) -> None:
        content = mutated(seed, seeds, random.Random(draw)).encode("utf-8", "surrogatepass")
        said = ""
        try:
            read(folder, content)  # warnings are errors in every test
        except CalibError as error:
            said = str(error) or "\n"
        assert said.isprintable()
        assert len(said) <= LONGEST

    check()


@pytest.mark.parametrize("name", [name for name in READERS if name not in MOST])
def test_a_few_neighbours(name: str, folder: Path) -> None:
    neighbours_keep_the_rule(name, folder, 10)


@pytest.mark.long
@pytest.mark.parametrize("name", READERS)
def test_many_neighbours(name: str, folder: Path) -> None:
    neighbours_keep_the_rule(name, folder, MOST.get(name, 50))
