"""Making sealed cases: the same seed gives the same cases, whatever is made beside them."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from studies.research.withheld import draw, foreign, instruments, keys, real_arms
from studies.research.withheld.seal import COMMITMENT, commit_keys, write_json


@dataclass(frozen=True)
class Population:
    """Cases of one kind: shares of its families, how one is drawn, and as what it is written."""

    shares: Mapping[str, float]
    draw: Callable[[np.random.Generator, str], Any]
    write: Callable[[Path, Any], None] = keys.write_case
    key: Callable[[Any, str, int, str], dict[str, Any]] = keys.key_of


POPULATIONS = {
    "first": Population(draw.SHARES, draw.draw_case),
    "arm_noise": Population(draw.SHARES, lambda rng, f: draw.draw_case(rng, f, arm_noise=True)),
    "real_arms": Population(real_arms.SHARES, real_arms.draw_real_case),
    "foreign": Population(foreign.SHARES, foreign.draw_foreign_case),
    "instruments": Population(
        instruments.SHARES,
        instruments.draw_sensed,
        instruments.write_case,
        instruments.key_of,
    ),
}
"""The first families; the same with arms that scatter; arms as real ones are; causes by
other formulas; other instruments."""


def families(rng: np.random.Generator, count: int, shares: Mapping[str, float]) -> list[str]:
    """The family of each case: fixed shares in an order that tells nothing."""
    ends = np.round(np.cumsum([0.0, *shares.values()]) * count).astype(int)
    whole = [f for f, (a, b) in zip(shares, pairwise(ends), strict=True) for _ in range(b - a)]
    return [whole[i] for i in rng.permutation(count)]


def make(
    folder: Path,
    count: int,
    seed: int,
    progress: Callable[[int], None] = lambda _: None,
    *,
    population: str = "first",
) -> None:
    """Write cases, keys, and last the commitment.

    population : of ``POPULATIONS``

    Raises FileExistsError where the folder holds cases already.
    """
    if (folder / COMMITMENT).exists() or (folder / "cases").exists():
        raise FileExistsError(f"{folder}: holds cases already; name a new folder")
    (folder / "keys").mkdir(parents=True)
    own = POPULATIONS[population]
    for index, family in enumerate(
        families(np.random.default_rng([seed, count]), count, own.shares)
    ):
        name = f"case_{index:04d}"
        # Each index has its own stream of random numbers.
        case = own.draw(np.random.default_rng([seed, index]), family)
        own.write(folder / "cases" / name, case)
        # The salt keeps the hash from being found by trying all that could have been drawn.
        key = own.key(case, name, index, secrets.token_hex(16))
        write_json(folder / "keys" / f"{name}.json", key)
        progress(index + 1)
    drawn_by = {} if population == "first" else {population: True}
    write_json(folder / "keys" / "seed.json", {"seed": seed, "count": count, **drawn_by})
    commit_keys(folder)
