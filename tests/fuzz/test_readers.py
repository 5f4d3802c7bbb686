"""The readers keep the rule on neighbours of good inputs; the fuzzer goes on from there."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests.fuzz.reader import broken_rule, neighbour, prepared
from tests.fuzz.readers import READERS

pytestmark = pytest.mark.long

_TRIED = {"whole": 4, "estimate": 60, "mjcf": 60}


@pytest.mark.parametrize("name", list(READERS))
def test_good_inputs_and_their_neighbours(name: str, tmp_path: Path) -> None:
    reader, folder, rng = READERS[name], prepared(tmp_path), random.Random(name)
    for seed in reader.seeds:
        reader.read(folder, seed.encode())
    for _ in range(_TRIED.get(name, 200)):
        content = neighbour(reader, rng.choice(reader.seeds), rng)
        error = broken_rule(reader, folder, content.encode("utf-8", "surrogatepass"))
        assert error is None, content[:2000]
