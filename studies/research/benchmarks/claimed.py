"""What the commands say of one simulated day, and what was so."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial.transform import Rotation

import calib
from calib.arrays import Array, Mask
from calib.change import changes, known_of
from calib.compensation.estimate import estimate_of
from calib.threads import one_blas_thread
from calib.uncertainty.budget import accuracy_at_targets
from doe.ahead.enough import enough
from doe.assess import assess
from doe.problem import problem_of
from doe.problem.request import Request
from studies.research.benchmarks.day import Day, Setting, draw_day, write_day

POSES, MARKERS = 60, 3
_SLIP = (10e-6, 100e-6)  # rad, of the third joint
_FIRST, _SECOND = 200e-6, (2e-6, 60e-6)  # rad, of two gears
_TOLERANCE = (0.6, 1.6)  # times what comes


@dataclass(frozen=True)
class Said:
    """One sentence on one day, with figures in m.

    promised, came : what it said and what was so, None of a yes or no; right : whether it came true,
        None of a mean, which no single day proves wrong
    """

    sentence: str
    promised: float | None = None
    came: float | None = None
    right: bool | None = None


@one_blas_thread
def said_in_a_day(arm: str, scatter: float, index: int, seed: int = 0) -> list[Said]:
    """All sentences of one day but those of the diagnosis.

    scatter : of the arm, m
    """
    rng = np.random.default_rng([seed, index, 1])
    setting = Setting(arm, scatter, 1, POSES, MARKERS)
    slip = float(np.exp(rng.uniform(*np.log(_SLIP)))) * (index % 2)
    first = draw_day(setting, index, seed)
    then = draw_day(setting, index, seed, lambda q: q + slip * (np.arange(q.shape[1]) == 2))
    half = np.arange(POSES) < POSES // 2
    with TemporaryDirectory() as name:
        cell, whole, targets = read(Path(name) / "first", first)
        exact = calib.load_measurements(cell, cell.path.parent / "exact.csv")
        _, later, _ = read(Path(name) / "then", then)
    data, after = whole.take(half), later.take(~half)
    found, again = calib.identify(cell, data), calib.identify(cell, after)
    came = rms(found.predict(targets) - first.approached)
    return [
        *_foreseen(cell, data, found, first, targets),
        *_enough(cell, whole, half, came, first, targets),
        *_intervals(found, calib.identify(cell, exact.take(half))),
        _compensated(cell, found, first, targets, rng),
        *_changes(cell, found, again, first, then, rng.uniform(*_TOLERANCE)),
    ]


def read(folder: Path, day: Day) -> tuple[calib.Cell, calib.Measurements, calib.Poses]:
    """Cell, data and targets of a day as its files say them."""
    folder.mkdir()
    write_day(folder, day)
    cell = calib.load_cell(folder / "cell.toml")
    targets, _ = calib.load_targets(cell, folder / "targets.csv")
    return cell, calib.load_measurements(cell, folder / "measurements.csv"), targets


def _foreseen(
    cell: calib.Cell,
    data: calib.Measurements,
    found: calib.Identification,
    day: Day,
    targets: calib.Poses,
) -> Iterator[Said]:
    """By the parameters alone, before and after they are measured."""
    came = rms(found.predict(targets) - day.reached)
    if not day.scatter.std.any():  # before anything is measured the arm is believed to come back
        plan = problem_of(cell, Request(len(data), "task"))
        yield Said("design", assess(plan, data.poses.q).task_rms, came)
    accuracy, off = accuracy_at_targets(cell, found), found.predict(targets) - day.reached
    yield Said("identify", accuracy.rms(accuracy.expected.errors), came)
    distances = np.sqrt((off**2).sum(axis=-1).mean(axis=-1))
    within = distances <= accuracy.expected.expanded
    yield from (Said("budget 95 %", right=bool(right)) for right in within)


def _intervals(found: calib.Identification, exact: calib.Identification) -> Iterator[Said]:
    """Against what exact readings of the same poses give: constants that are dropped are taken up."""
    low, high = found.interval().T
    held = (low <= exact.values) & (exact.values <= high)
    estimated = (found.std > 0.0) & (exact.std >= 0.0)
    yield from (Said("identify 95 %", right=bool(right)) for right in held[estimated])


def _compensated(
    cell: calib.Cell,
    found: calib.Identification,
    day: Day,
    targets: calib.Poses,
    rng: np.random.Generator,
) -> Said:
    """Where the corrected commands take the arm, against the arm of its file as it was placed."""
    commands = calib.compensate(cell, found, targets)
    came = missed_by_commands(commands, found, day, targets, rng)
    return Said("compensate", commands.rms(commands.expected), came)


def missed_by_commands(
    commands: calib.Compensation,
    found: calib.Identification,
    day: Day,
    targets: calib.Poses,
    rng: np.random.Generator,
) -> float:
    """RMS distance, m, of one approach by corrected commands from the placed arm of the file."""
    (base,) = found.bases.values()
    R = Rotation.from_rotvec(base[3:]).as_matrix()
    wanted = day.nominal(targets.q, found.marker_positions, R, base[:3])
    return rms(day.approach(commands.q, rng) - wanted)


def _enough(
    cell: calib.Cell,
    whole: calib.Measurements,
    half: Mask,
    came: float,
    day: Day,
    targets: calib.Poses,
) -> Iterator[Said]:
    answer = enough(cell, whole.take(half), whole.poses)
    now, end = answer.steps[0], answer.steps[-1]
    yield Said("enough now", now.task_rms, came)
    yield Said("enough most", now.task_most, came, came <= now.task_most)
    later = calib.identify(cell, whole).predict(targets)
    yield Said("enough end", end.task_rms, rms(later - day.approached))


def _changes(
    cell: calib.Cell,
    before: calib.Identification,
    after: calib.Identification,
    first: Day,
    then: Day,
    times: float,
) -> Iterator[Said]:
    found = changes(cell, known_of(before), known_of(after), estimate_of(after))
    moved, size = rms(then.reached - first.reached), found.change.rms
    if not moved:
        yield Said("changes alarm", right=not found.difference.changed)
    elif found.difference.changed:
        yield Said("changes size", size.value, moved, size.low <= moved <= size.high)
    else:
        yield Said("changes hidden", size.high, moved, moved <= size.high)
    off = before.predict(found.targets) - then.approached
    worst = float(np.sqrt((off**2).sum(axis=-1).mean(axis=-1)).max())
    judged = changes(
        cell, known_of(before), known_of(after), estimate_of(after), tolerance=times * worst
    ).verdict
    if judged in ("holds", "does_not"):
        yield Said("changes verdict", right=(judged == "holds") == (times > 1.0))


@one_blas_thread
def said_by_diagnosis(arm: str, scatter: float, index: int, seed: int = 0) -> list[Said]:
    """What a diagnosis says where one gear errs plainly and another by little."""
    rng = np.random.default_rng([seed, index, 2])
    little = float(np.exp(rng.uniform(*np.log(_SECOND))))

    def truth(q: Array) -> Array:
        off = np.zeros_like(q)
        off[:, 2], off[:, 4] = _FIRST * np.cos(q[:, 2]), little * np.sin(q[:, 4])
        return np.asarray(q + off)

    day = draw_day(Setting(arm, scatter, 1, POSES, MARKERS), index, seed, truth)
    with TemporaryDirectory() as name:
        cell, data, targets = read(Path(name) / "day", day)
    found = calib.diagnose(cell, data)
    if found.verdict not in ("explained", "ambiguous"):
        return []
    known = calib.compensate(cell, found, targets)
    by_parameters = float(np.sqrt(np.mean(known.spread**2)))
    after = found.after
    came = rms(after.model.predict(after.values, targets) - day.reached)
    promised = float(np.hypot(by_parameters, max(h.left for h in found.hidden)))
    return [Said("diagnose", promised, came, came <= promised)]


def rms(vectors: Array) -> float:
    """3-D root mean square per point."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))
