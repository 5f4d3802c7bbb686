"""The weights of what speaks against a name (:mod:`calib.diagnosis.causes`), fitted anew.

    python -m studies.research.benchmarks.weights FOLDER ..

FOLDER are sealed cases with their answers. A name is right where it, or one of its class, is there.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import click
import numpy as np

from calib.arrays import Array
from calib.diagnosis.causes import NameEvidence
from studies.research.bench import Output, Row, bench, table
from studies.research.withheld.judge import is_listed, is_true, name_of

_RIDGE = 0.5  # weights of a few rare words stay finite
_SIZES = (0.0, 1.0, 0.2, 0.1, 1.0, 1.0, 1.0)  # of what speaks, by which the ridge holds its weights
_ROUNDS = 50
_BINS = (0.0, 0.5, 0.8, 0.9, 1.0)
WORDS = ("sure", "form", "curve", "again", "company", "pliable", "moment")

Named = tuple[NameEvidence, bool]
"""What speaks for and against a name, and whether it is right."""


def sealed_names(folder: Path) -> Iterator[Named]:
    """The names of all sealed cases that the diagnosis answered."""
    for path in sorted((folder / "answers" / "diagnosis").glob("case_*.json")):
        answer = json.loads(path.read_text(encoding="utf-8"))
        key = json.loads((folder / "keys" / path.name).read_text(encoding="utf-8"))
        places = [(p["where"], p["depends_on"]) for p in answer["located"]]
        for effect in (*answer["effects"], *answer.get("possible", ())):
            listed = any(is_listed(effect, truth) for truth in key["effects"])
            right = listed or is_true(effect, key["effects"], key["outside"])
            yield _evidence(effect, places), right


def _evidence(effect: Row, places: Sequence[tuple[str, str]]) -> NameEvidence:
    here = [by for where, by in places if where == effect["where"] and by != "pose"]
    form_p = effect["shape_p_value"]
    return NameEvidence(
        name_of(effect),
        1.0 if form_p is None else form_p,
        effect["curve_ratio"],
        effect["chosen_again"],
        company=len(here) > 1,
    )


def fitted(A: Array, right: Array, sizes: Sequence[float]) -> Array:
    """Weights (k,) of a logistic model by maximum likelihood with a weak normal prior.

    A : ndarray, shape (n, k); right : ndarray, shape (n,), zero or one
    sizes : of the columns, by which their weights are held; zero where one is free
    """
    weights, prior = np.zeros(A.shape[1]), np.diag(_RIDGE * np.square(sizes))
    for _ in range(_ROUNDS):
        p = chance(A, weights)
        slope = A.T @ (right - p) - prior @ weights
        curved = A.T @ (A * (p * (1.0 - p))[:, None])
        weights = weights + np.linalg.solve(curved + prior, slope)
    return weights


def chance(A: Array, weights: Array) -> Array:
    """Probability of each name, shape (n,)."""
    return np.asarray(1.0 / (1.0 + np.exp(-A @ weights)))


@bench(click.argument("folders", nargs=-1, type=click.Path(path_type=Path, exists=True)))
def main(folders: tuple[Path, ...], seed: int) -> Output:
    """Fit the weights, and count how often names with such a probability are right."""
    del seed
    names, oks = zip(*(n for folder in folders for n in sealed_names(folder)), strict=True)
    A, right = np.array([(1.0, *own.against) for own in names]), np.array(oks, dtype=float)
    weights = fitted(A, right, _SIZES)
    told = dict(zip(WORDS, weights.tolist(), strict=True))
    words = [{"word": word, "weight": f"{weight:.2f}"} for word, weight in told.items()]
    p, bins = chance(A, weights), []
    for low, high in pairwise(_BINS):
        own = right[(p > low) & (p <= high)]
        share = f"{100 * own.mean():.0f}" if len(own) else None
        bins.append({"probability": f"{low:g} to {high:g}", "names": len(own), "right [%]": share})
    return [table(words), table(bins)], {"weights": told, "bins": bins}


if __name__ == "__main__":
    main()
