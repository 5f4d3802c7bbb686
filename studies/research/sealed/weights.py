"""The weights of what speaks against a name (:mod:`calib.diagnosis.causes`), fitted anew.

``python -m studies.research.sealed.weights FOLDER ..`` takes sealed cases with their answers. A name is
right where it, or one of its class, is there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np

from calib.arrays import Array
from calib.diagnosis.causes import NameEvidence
from studies.research.bench import Output, bench, table
from studies.research.sealed.judge import is_listed, is_true, name_of
from studies.research.sealed.seal import read_json

_RIDGE = 0.5  # weights of a few rare words stay finite
_SIZES = (0.0, 1.0, 0.2, 0.1, 1.0, 1.0, 1.0)  # of what speaks, by which the ridge holds its weights
_ROUNDS = 50
WORDS = ("sure", "form", "curve", "again", "company", "pliable", "moment")


def sealed_names(folder: Path) -> Iterator[tuple[NameEvidence, bool]]:
    """What speaks against each name that the diagnosis gave, and whether the name is right."""
    for path in sorted((folder / "answers" / "diagnosis").glob("case_*.json")):
        answer, key = read_json(path), read_json(folder / "keys" / path.name)
        located = [p["where"] for p in answer["located"] if p["depends_on"] != "pose"]
        for effect in (*answer["effects"], *answer.get("possible", ())):
            form_p = effect["shape_p_value"]
            evidence = NameEvidence(
                name_of(effect),
                1.0 if form_p is None else form_p,
                effect["shape_share"] or 0.0,
                effect["curve_ratio"],
                effect["chosen_again"],
                company=located.count(effect["where"]) > 1,
            )
            listed = any(is_listed(effect, truth) for truth in key["effects"])
            yield evidence, listed or is_true(effect, key["effects"], key["outside"])


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
    """Fit the weights of what speaks against a name."""
    del seed
    names, oks = zip(*(n for folder in folders for n in sealed_names(folder)), strict=True)
    A, right = np.array([(1.0, *own.against) for own in names]), np.array(oks, dtype=float)
    weights = dict(zip(WORDS, fitted(A, right, _SIZES).tolist(), strict=True))
    return [table({"word": w, "weight": f"{v:.2f}"} for w, v in weights.items())], weights


if __name__ == "__main__":
    main()
