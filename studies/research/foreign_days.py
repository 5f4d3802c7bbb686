"""What ``diagnose`` says of causes by formulas that the catalogue does not have.

    python -m studies.research.foreign_days [--days 20] [--only backlash] .. [--json FILE]

The truth is MuJoCo's (``truth.day``): geometric errors, a base anywhere, guessed markers, an
instrument of 0.01 mm, an arm that scatters by 0.03 mm, 40 poses approached twice in an order of its
own. The cell states that repeatability, or is silent. On top comes one cause: a joint's play, a joint
that slips in the middle of the day, a base that walks, that warms up, that lags behind the turns of the
first joint, a joint that lags by no more than so much, play that grows with the arm's lean; or none.

"named" counts where the first name is the cause at its place and more likely than not; "found" where a
name or a located place is right; "missed" where the day is said to have no gap.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

import calib
from calib.arrays import Array
from studies.research.bench import Output, Row, bench, each, several, table
from studies.research.days import moved, read
from studies.research.truth.day import ARMS, Floor, Setting, draw_day

_SETTING = Setting("6R", 30e-6, 2, 40, 3)
_SIGMA = _SETTING.scatter / np.sqrt(3.0)  # m, of one coordinate of the tip


@dataclass(frozen=True)
class ForeignCause:
    """A cause, and what would be right to say of it.

    truth : joints (N, n) as read, in the order of the day -> where they stand; floor : of the base
    effects : names that are right, none where the catalogue has none; places : that are right
    """

    truth: Callable[[Array], Array]
    floor: Floor | None
    effects: tuple[str, ...]
    places: tuple[str, ...]


def _side(q: Array, k: int) -> Array:
    """Sign of the last move of a joint, shape (N,), that of the next one at the first reading."""
    moves = np.sign(np.diff(q[:, k]))
    return np.concatenate([-moves[:1], moves])


def _moves(q: Array, k: int) -> Array:
    """Last move of a joint, rad, shape (N,), none at the first reading."""
    return np.diff(q[:, k], prepend=q[:1, k])


def _walk(rng: np.random.Generator) -> Floor:
    """A base that goes 3 um and 3 urad on at every reading, nobody knows whither."""
    steps = rng.normal(size=(_SETTING.poses * _SETTING.approaches, 6)) * 12e-6
    path = np.cumsum(steps, axis=0)
    return Floor(lambda h: path[np.minimum(np.arange(len(h)), len(path) - 1)], later=0.0)


def _warms(rng: np.random.Generator) -> Floor:
    twist = rng.normal(size=6) * 150e-6
    return Floor(lambda h: np.expm1(-h / 0.3)[:, None] * twist, later=0.0)


def _causes(rng: np.random.Generator) -> dict[str, ForeignCause]:
    """All causes of a day, each at a joint of its own."""
    k = int(rng.integers(1, 5))
    names = ARMS[_SETTING.arm].names
    base = ("base", "instrument")
    middle = _SETTING.poses * _SETTING.approaches // 2
    play = lambda q: moved(q, k, -150e-6 * _side(q, k))  # noqa: E731
    slip = lambda q: moved(q, k, 900e-6 * (np.arange(len(q)) >= middle))  # noqa: E731
    lean = lambda q: moved(q, k, 250e-6 * np.abs(np.sin(q[:, 1])) * _side(q, k))  # noqa: E731
    lag = lambda q: moved(q, 0, -200e-6 * _moves(q, 0))  # noqa: E731
    stiff = lambda q: moved(q, k, -250e-6 * np.tanh(_moves(q, k) / 0.5))  # noqa: E731
    here = (names[k],)
    return {
        "none": ForeignCause(np.copy, None, (), ()),
        "backlash": ForeignCause(play, None, ("backlash", "friction_windup"), here),
        "slip": ForeignCause(slip, None, ("step",), here),
        "walk": ForeignCause(np.copy, _walk(rng), (), base),
        "warm-up": ForeignCause(np.copy, _warms(rng), ("warm_up",), base),
        "settling": ForeignCause(lag, None, ("settling",), (names[0], "base")),
        "saturated": ForeignCause(stiff, None, (), here),
        "lean": ForeignCause(lean, None, (), here),
    }


KINDS = tuple(_causes(np.random.default_rng(0)))


def said_of(kind: str, stated: bool, index: int, seed: int) -> Row:
    """One day, and what the diagnosis says of it."""
    cause = _causes(np.random.default_rng([seed, index]))[kind]
    day = draw_day(_SETTING, index, seed, cause.truth, cause.floor)
    known = (f"repeatability_mm = {_SIGMA * 1e3:.4g}",) if stated else ()
    own = read(day, known)
    found = calib.diagnose(own.cell, own.data)
    names = [(c.name, c.where) for c in found.causes]
    right = [(effect, place) for effect in cause.effects for place in cause.places]
    places = {place for _, place in names} | {place.where for place in found.located}
    return {
        "kind": kind,
        "stated": stated,
        "verdict": found.verdict,
        "rest": found.rest.kind,
        "said": [f"{c!r}" for c in found.causes],
        "named": bool(names) and names[0] in right,
        "found": bool(places & set(cause.places)),
        "missed": found.verdict == "no_gap",
        "structure": bool(names) or found.rest.kind in ("structure", "too_large"),
    }


def _rows(found: list[Row]) -> Iterator[Row]:
    for kind in dict.fromkeys(row["kind"] for row in found):
        for stated in (False, True):
            own = [row for row in found if (row["kind"], row["stated"]) == (kind, stated)]
            yield {
                "cause": kind,
                "repeatability": "stated" if stated else "not stated",
                "days": len(own),
                "named first": sum(row["named"] for row in own),
                "found": sum(row["found"] for row in own),
                "no gap": sum(row["missed"] for row in own),
                "named or structure": sum(row["structure"] for row in own),
                "verdicts": ", ".join(sorted({row["verdict"] for row in own})),
            }


@bench(several("--only", KINDS), days=20, days_help="Of each cause.", workers=True)
def main(days: int, only: tuple[str, ...], seed: int, workers: int) -> Output:
    """Diagnose days whose causes follow formulas of their own."""
    tasks = [(kind, stated, i) for kind in only for stated in (False, True) for i in range(days)]
    found = each(said_of, tasks, workers, seed=seed)
    return [table(_rows(found))], {"seed": seed, "days": found}


if __name__ == "__main__":
    main()
