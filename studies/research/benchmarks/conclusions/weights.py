"""The weights of what speaks against a name (:mod:`calib.diagnosis.causes`), fitted anew.

    python -m studies.research.benchmarks.conclusions.weights DAYS.json .. [--sealed FOLDER ..]

DAYS.json are days of the parts foreign, outside and hard, as this benchmark writes them; FOLDER are
sealed cases with their answers. A name is right where it, or one of its class, is there. The weights in
use are those of days of seeds 301 and 303 (foreign and outside, 63 each), 402 (hard, 7 a kind) and 403
(foreign and outside, 108 each), and of sealed cases of seeds 9101 to 9103.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import click
import numpy as np

from calib.arrays import Array
from calib.diagnosis.causes import NameEvidence
from studies.command.deliver import console_for
from studies.command.options import one_line_faults
from studies.document.terminal import plain_table
from studies.research.withheld.judge import is_listed, is_true, name_of

_RIDGE = 0.5  # weights of a few rare words stay finite
_SIZES = (0.0, 1.0, 0.2, 0.1, 1.0, 1.0, 1.0)  # of what speaks, by which the ridge holds its weights
_ROUNDS = 50
_OUTSIDE = 0.5  # of a day whose cause is in no catalogue: half of those drawn have one
_BINS = (0.0, 0.5, 0.8, 0.9, 1.0)
WORDS = ("sure", "form", "curve", "again", "company", "pliable", "moment")

Row = dict[str, Any]
Named = tuple[NameEvidence, bool, float]
"""What speaks for and against a name, whether it is right, and how much it counts."""


def names_of(days: Path) -> Iterator[Named]:
    """The names of all days of a file."""
    for day in json.loads(days.read_text(encoding="utf-8"))["days"]:
        for effect in day["effects"]:
            places = [(where, by) for where, by in day["located"]]
            counts = _OUTSIDE if day["part"] == "outside" else 1.0
            yield _evidence(effect, places), effect["outcome"] != "wrong", counts


def sealed_names(folder: Path) -> Iterator[Named]:
    """The names of all sealed cases that the diagnosis answered."""
    for path in sorted((folder / "answers" / "diagnosis").glob("case_*.json")):
        answer = json.loads(path.read_text(encoding="utf-8"))
        key = json.loads((folder / "keys" / path.name).read_text(encoding="utf-8"))
        for effect in answer["effects"]:
            places = [(p["where"], p["depends_on"]) for p in answer["located"]]
            listed = any(is_listed(effect, truth) for truth in key["effects"])
            right = listed or is_true(effect, key["effects"], key["outside"])
            yield _evidence(effect, places), right, 1.0


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


def columns(found: Sequence[NameEvidence]) -> Array:
    """What speaks against each name, shape (n, 7), the first column one."""
    return np.array([(1.0, *own.against) for own in found])


def fitted(A: Array, right: Array, counts: Array, sizes: Sequence[float]) -> Array:
    """Weights (k,) of a logistic model by maximum likelihood with a weak normal prior.

    A : ndarray, shape (n, k); right : ndarray, shape (n,), zero or one; counts : ndarray, shape (n,)
    sizes : of the columns, by which their weights are held; zero where one is free
    """
    weights, prior = np.zeros(A.shape[1]), np.diag(_RIDGE * np.square(sizes))
    for _ in range(_ROUNDS):
        p = chance(A, weights)
        slope = A.T @ (counts * (right - p)) - prior @ weights
        curved = A.T @ (A * (counts * p * (1.0 - p))[:, None])
        weights = weights + np.linalg.solve(curved + prior, slope)
    return weights


def chance(A: Array, weights: Array) -> Array:
    """Probability of each name, shape (n,)."""
    return np.asarray(1.0 / (1.0 + np.exp(-A @ weights)))


@click.command()
@click.argument("days", nargs=-1, type=click.Path(path_type=Path, exists=True))
@click.option("--sealed", multiple=True, type=click.Path(path_type=Path, exists=True))
@one_line_faults
def main(days: tuple[Path, ...], sealed: tuple[Path, ...]) -> None:
    """Fit the weights, and count how often names with such a probability are right."""
    found = [n for path in days for n in names_of(path)]
    found += [n for folder in sealed for n in sealed_names(folder)]
    names, oks, counts = zip(*found, strict=True)
    A, right = columns(names), np.array(oks, dtype=float)
    weights, console = fitted(A, right, np.array(counts), _SIZES), console_for(None)
    table = plain_table(("word", "left"), ("weight", "right"))
    for word, weight in zip(WORDS, weights, strict=True):
        table.add_row(word, f"{weight:.2f}")
    console.print(table)
    p = chance(A, weights)
    bins = plain_table(("probability", "left"), ("names", "right"), ("right [%]", "right"))
    for low, high in pairwise(_BINS):
        own = right[(p > low) & (p <= high)]
        bins.add_row(
            f"{low:g} to {high:g}", str(len(own)), f"{100 * own.mean():.0f}" if len(own) else "-"
        )
    console.print(bins)


if __name__ == "__main__":
    main()
