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
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial.transform import Rotation

import calib
from calib.arrays import Array
from calib.cell.targets import targets_of
from calib.prediction.budget import accuracy_at_targets, combined
from calib.prediction.estimate import estimate_of
from studies.research.bench import Output, Row, bench, each, rms, several, table
from studies.research.truth.day import Day, Floor, Setting, draw_day, write_day
from studies.research.truth.mechanism import Action, State

_SETTING = Setting("6R", 30e-6, 2, 40, 3)
_FORCE = (20.0, 150.0)  # N, at the tip
_SOFT = 1.5e-5, 0.5  # rad/(N m), in the middle, and spread of its logarithm: drives of small arms
_DRIFT = 12e-6  # m/h and rad/h, of each coordinate of the base
_LATER, _WARMER = 5.0, 10.0  # h, K
_METALS = (11e-6, 24e-6)  # m/(m K): steel and aluminium
_PLAY = (20e-6, 120e-6)  # rad, each way


@dataclass(frozen=True)
class Beyond:
    """What no reading shows, and the columns that say so.

    act : of the arm at rest at the targets, what acts on it; floor : under the base
    play : ndarray, shape (n,), rad, of each joint to either side
    read, asked : columns of the readings and of the targets, with one value each
    """

    act: Callable[[Day, State], Action] | None = None
    floor: Floor | None = None
    play: Array | float = 0.0
    read: tuple[tuple[str, float], ...] = ()
    asked: tuple[tuple[str, float], ...] = ()


def _load(rng: np.random.Generator) -> Beyond:
    """A force downwards at the tip, of which each drive gives way a little."""
    force = float(rng.uniform(*_FORCE))
    soft = _SOFT[0] * rng.lognormal(0.0, _SOFT[1], 6)

    def act(day: Day, state: State) -> Action:
        action = _nothing(day, len(state.o))
        action.load[:, -1, 2] = -force
        action.joint[:] = soft * state.torque
        return action

    return Beyond(act, asked=(("fz_N", -force),))


def _hour(rng: np.random.Generator) -> Beyond:
    rate = rng.normal(size=6) * _DRIFT
    return Beyond(floor=Floor(lambda h: h[:, None] * rate, 1.0, _LATER))


def _heat(rng: np.random.Generator) -> Beyond:
    """Links grow along themselves; the readings are at the temperature of the robot's file."""
    growth = float(rng.uniform(*_METALS)) * _WARMER

    def act(day: Day, state: State) -> Action:
        action = _nothing(day, len(state.o))
        origins = [(j.xyz, j.rpy) for j in day.arm.joints] + [(day.arm.tip_xyz, day.arm.tip_rpy)]
        for frame, (xyz, rpy) in enumerate(origins, 1):
            turned = Rotation.from_euler("xyz", rpy).inv().apply(xyz)
            action.twist[:, frame, :3] = growth * turned
        return action

    read, asked = (("temperature_degC", t) for t in (20.0, 20.0 + _WARMER))
    return Beyond(act, read=(read,), asked=(asked,))


def _side(rng: np.random.Generator) -> Beyond:
    play = rng.uniform(*_PLAY, 6)
    names = [joint.name for joint in draw_day(_SETTING, 0, 0).arm.joints]
    read, asked = (tuple((f"approach_{j}", s) for j in names) for s in (1.0, -1.0))
    return Beyond(play=play, read=read, asked=asked)


KINDS = {"load": _load, "hour": _hour, "heat": _heat, "side": _side}


def promised(kind: str, index: int, seed: int) -> Row:
    """One day: expected and true RMS at the targets, mm, and the share within the expanded figure."""
    beyond = KINDS[kind](np.random.default_rng([seed, index, list(KINDS).index(kind)]))
    day = draw_day(_SETTING, index, seed, lambda q: q + beyond.play, beyond.floor)
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_day(folder, day)
        _add_columns(folder / "measurements.csv", beyond.read)
        _add_columns(folder / "targets.csv", beyond.asked)
        cell = calib.load_cell(folder / "cell.toml")
        data = calib.load_measurements(cell, folder / "measurements.csv")
        targets, weights = targets_of(cell)
    found, after = calib.identify(cell, data), cell.design.targets_after or 0.0
    whole = combined(accuracy_at_targets(cell, found, estimate_of(found, after)).parts, weights)
    missed = found.predict(targets) - _there(day, beyond, np.random.default_rng([seed, index, 9]))
    error = np.sqrt((missed**2).sum(axis=-1).mean(axis=-1))
    return {
        "kind": kind,
        "expected": rms(whole.errors) * 1e3,
        "true": rms(error) * 1e3,
        "within": float((error <= whole.expanded).mean()),
    }


def _there(day: Day, beyond: Beyond, rng: np.random.Generator) -> Array:
    """Where one approach of the targets takes the markers, shape (T, M, 3), m."""
    count = len(day.targets)
    approach = day.scatter.drawn(rng, np.arange(count))
    moved = 0.0 if beyond.floor is None else beyond.floor.then(count)

    def act(state: State) -> Action:
        action = beyond.act(day, state) if beyond.act else _nothing(day, count)
        approach.add_to(action, None, None)
        action.twist[:, 0] += moved
        return action

    return day.mechanism.rest(day.targets - beyond.play, act, (day.R, day.p)).readings


def _nothing(day: Day, count: int) -> Action:
    return Action.none(day.arm, count, len(day.markers))


def _add_columns(path: Path, columns: tuple[tuple[str, float], ...]) -> None:
    """Write further columns of one value each."""
    head, *rows = path.read_text(encoding="utf-8").splitlines()
    for name, value in columns:
        head, rows = f"{head},{name}", [f"{row},{value:g}" for row in rows]
    text = "\n".join([head, *rows, ""])
    path.write_text(text, encoding="utf-8")


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
