"""Making sealed cases: the same seed gives the same cases, whatever is made beside them."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from pathlib import Path

import numpy as np

from studies.withheld.case_files import write_case
from studies.withheld.draw import Case, draw_case, families
from studies.withheld.keys import key_of
from studies.withheld.seal import COMMITMENT, commit_keys, write_json


def make(
    folder: Path, count: int, seed: int, progress: Callable[[int], None] = lambda _: None
) -> None:
    """Write cases, keys, and last the commitment.

    Raises FileExistsError where the folder holds cases already.
    """
    if (folder / COMMITMENT).exists() or (folder / "cases").exists():
        raise FileExistsError(f"{folder}: holds cases already; name a new folder")
    (folder / "keys").mkdir(parents=True)
    for index, case in enumerate(Cases(count, seed)):
        name = f"case_{index:04d}"
        write_case(folder / "cases" / name, case)
        # The salt keeps the hash from being found by trying all that could have been drawn.
        write_json(folder / "keys" / f"{name}.json", key_of(case, name, index, secrets.token_hex(16)))
        progress(index + 1)
    write_json(folder / "keys" / "seed.json", {"seed": seed, "count": count})
    commit_keys(folder)


class Cases:
    """Cases by index; each has its own stream of random numbers."""

    def __init__(self, count: int, seed: int) -> None:
        self._families = families(np.random.default_rng([seed, count]), count)
        self._seed = seed

    def __len__(self) -> int:
        return len(self._families)

    def __getitem__(self, index: int) -> Case:
        family = self._families[index]  # IndexError ends iteration
        return draw_case(np.random.default_rng([self._seed, len(self), index]), family)
