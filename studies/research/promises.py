"""What is promised at targets under conditions that no reading had, against what comes.

    python -m studies.research.promises [--days 40] [--only load] .. [--json FILE]

The truth is MuJoCo's (``truth.day``): geometric errors, a base anywhere, guessed markers, an
instrument of 0.01 mm, an arm of the size of a UR5 that scatters by 0.03 mm, 40 poses approached twice.
On top comes what no reading shows. The targets carry a load, and each drive yields; they come five
hours later, and the base drifts; they are 10 K warmer, and links grow as aluminium or steel do; joints
come to them from the other side, and each has play.

"within" counts targets whose error keeps within the expanded figure; "expected over true" compares the
RMS over the targets of a day.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

import calib
from calib.arrays import Array
from calib.cell.targets import targets_of
from calib.prediction.budget import accuracy_at_targets, combined
from calib.prediction.estimate import estimate_of
from studies.research.bench import Output, Row, bench, each, rms, several, table
from studies.research.days import read
from studies.research.truth.day import ARMS, Columns, Floor, Setting, draw_day, standing
from studies.research.truth.formulas import segment
from studies.research.truth.mechanism import Action, State

_SETTING = Setting("6R", 30e-6, 2, 40, 3)
_ARM = ARMS[_SETTING.arm]
_FORCE = (20.0, 150.0)  # N, at the tip
_SOFT = 1.5e-5, 0.5  # rad/(N m), in the middle, and spread of its logarithm: drives of small arms
_DRIFT = 12e-6  # m/h and rad/h, of each coordinate of the base
_LATER, _WARMER = 5.0, 10.0  # h, K
_METALS = (11e-6, 24e-6)  # m/(m K): steel and aluminium
_PLAY = (20e-6, 120e-6)  # rad, each way


@dataclass(frozen=True)
class Beyond:
    """What no reading shows, and the columns that say so.

    act : writes what acts on the arm at the targets; floor : under the base
    play : ndarray, shape (n,), rad, of each joint to either side
    rows, asked : columns of the readings and of the targets
    """

    act: Callable[[Action, State], None] = lambda *_: None
    floor: Floor | None = None
    play: Array | float = 0.0
    rows: Columns = ()
    asked: Columns = ()


def _load(rng: np.random.Generator) -> Beyond:
    """A force downwards at the tip, of which each drive gives way a little."""
    force = float(rng.uniform(*_FORCE))
    soft = _SOFT[0] * rng.lognormal(0.0, _SOFT[1], 6)

    def act(action: Action, state: State) -> None:
        action.load[:, -1, 2] = -force
        action.joint[:] = soft * state.torque

    return Beyond(act, asked=(("fz_N", -force),))


def _hour(rng: np.random.Generator) -> Beyond:
    rate = rng.normal(size=6) * _DRIFT
    return Beyond(floor=Floor(lambda h: h[:, None] * rate, 1.0, _LATER))


def _heat(rng: np.random.Generator) -> Beyond:
    """Links grow along themselves; the readings are at the temperature of the robot's file."""
    growth = float(rng.uniform(*_METALS)) * _WARMER

    def act(action: Action, _: State) -> None:
        for frame in range(1, _ARM.dof + 2):
            action.twist[:, frame, :3] = growth * segment(_ARM, frame)

    rows, asked = ((("temperature_degC", t),) for t in (20.0, 20.0 + _WARMER))
    return Beyond(act, rows=rows, asked=asked)


def _side(rng: np.random.Generator) -> Beyond:
    play = rng.uniform(*_PLAY, 6)
    rows, asked = (tuple((f"approach_{j}", s) for j in _ARM.names) for s in (1.0, -1.0))
    return Beyond(play=play, rows=rows, asked=asked)


KINDS = {"load": _load, "hour": _hour, "heat": _heat, "side": _side}


def promised(kind: str, index: int, seed: int) -> Row:
    """One day: expected and true RMS at the targets, mm, and the share within the expanded figure."""
    beyond = KINDS[kind](np.random.default_rng([seed, index, list(KINDS).index(kind)]))
    day = draw_day(_SETTING, index, seed, lambda q: q + beyond.play, beyond.floor)
    own, rng = read(day, beyond.rows, beyond.asked), np.random.default_rng([seed, index, 9])
    found, after = calib.identify(own.cell, own.data), own.cell.design.targets_after or 0.0
    targets, weights = targets_of(own.cell)
    parts = accuracy_at_targets(own.cell, found, estimate_of(found, after)).parts
    whole = combined(parts, weights)
    gone = None if day.floor is None else day.floor.then(len(day.targets))
    q = day.targets - beyond.play  # where joints stand that come from the other side
    there = standing(day.mechanism, q, day.R, day.p, day.scatter, rng, gone, beyond.act).readings
    error = np.sqrt(((found.predict(targets) - there) ** 2).sum(axis=-1).mean(axis=-1))
    return {
        "kind": kind,
        "expected": rms(whole.errors) * 1e3,
        "true": rms(error) * 1e3,
        "within": float((error <= whole.expanded).mean()),
    }


def _rows(found: list[Row]) -> Iterator[Row]:
    for kind in dict.fromkeys(row["kind"] for row in found):
        own = [row for row in found if row["kind"] == kind]
        ratio = np.array([row["expected"] / row["true"] for row in own])
        within = np.array([row["within"] for row in own])
        yield {
            "targets differ in": kind,
            "days": len(own),
            "expected over true, median": f"{np.median(ratio):.2f}",
            "quartiles": " to ".join(f"{v:.2f}" for v in np.quantile(ratio, (0.25, 0.75))),
            "within the expanded figure [%]": f"{100.0 * within.mean():.1f}",
        }


@bench(several("--only", tuple(KINDS)), days=40, days_help="Of each kind.", workers=True)
def main(days: int, only: tuple[str, ...], seed: int, workers: int) -> Output:
    """Promises under conditions that were never measured."""
    tasks = [(kind, index) for kind in only for index in range(days)]
    found = each(promised, tasks, workers, seed=seed)
    return [table(_rows(found))], {"seed": seed, "days": found}


if __name__ == "__main__":
    main()
