"""The kinds of sealed cases: which families they have, how one is drawn, and as what it is written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from studies.research.sealed import draw, instruments, key


@dataclass(frozen=True)
class Population:
    """Cases of one kind; shares : of its families."""

    shares: Mapping[str, float]
    draw: Callable[[np.random.Generator, str], Any]
    write: Callable[[Path, Any], None] = key.write_case
    key: Callable[[Any, str, int, str], dict[str, Any]] = key.key_of


POPULATIONS = {
    "first": Population(draw.FIRST_SHARES, draw.draw_case),
    "arm_noise": Population(draw.FIRST_SHARES, partial(draw.draw_case, arm_noise=True)),
    "real_arms": Population(draw.REAL_SHARES, draw.draw_real_case),
    "foreign": Population(draw.FOREIGN_SHARES, draw.draw_foreign_case),
    "instruments": Population(
        instruments.SHARES, instruments.draw_sensed, key.write_sensed, key.key_of_sensed
    ),
}
"""The first families; the same with arms that scatter; arms as real ones are; causes by
other formulas; other instruments."""


def families(rng: np.random.Generator, count: int, shares: Mapping[str, float]) -> list[str]:
    """The family of each case: fixed shares in an order that tells nothing."""
    ends = np.round(np.cumsum([0.0, *shares.values()]) * count).astype(int)
    whole = [f for f, (a, b) in zip(shares, pairwise(ends), strict=True) for _ in range(b - a)]
    return [whole[i] for i in rng.permutation(count)]
