"""How often sentences come true that the commands say to a user, over simulated days.

    python -m studies.research.benchmarks.claims [--days 20] [--only day] [--arm 6R] .. [--json FILE]

The truth is MuJoCo's (``benchmarks.day``); posecal sees files. A day of 60 poses has geometric errors,
a base anywhere, guessed markers, an instrument of 0.01 mm, and an arm that scatters by nothing or by
0.01 mm. Its first half is one day to the commands, its second half the next. On odd days the zero of
the third joint slips in between, by 10 to 100 urad.

What comes at 200 targets is where one fresh approach of each takes the arm, against the model. An
"alarm" is a change seen where there was none; a verdict of ``changes`` counts where it says one, with
a tolerance of 0.6 to 1.6 times what truly comes.

diagnosis: the gear of the third joint errs by 200 urad once a turn, that of the fifth by 2 to 60 urad.
"could hide" counts where nothing is said to be left: whether what comes is within what was named
there, beside the parameters' uncertainty.

intervals: those of parameters alone, by the arm's scatter. The constants that the model drops are
absorbed by those it keeps; their truth is what ``identify`` finds from exact readings of these poses.

lacking: the model lacks something: the base warms for an hour of readings and the targets come an hour
later (as the cell says, or untold); or a joint errs once a turn, or thirty to 120 times, or gives way
under weights that the cell does not know. "you may stop" is right where it is not said, or comes true
at the targets' time; "posecal diagnose" is counted as advice. On odd days each pose is approached
twice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import calib
from calib.arrays import Array, Mask
from calib.cell.targets import targets_of
from calib.change import FALSE_ALARM, changes, known_of, verdict
from calib.prediction.budget import accuracy_at_targets
from calib.prediction.estimate import estimate_of
from doe.assess import assess
from doe.forecast.enough import enough
from doe.problem import problem_of
from doe.request import Request
from studies.render import markdown
from studies.research.bench import Output, Row, bench, each, rms_3d, several, table
from studies.research.benchmarks.day import ARMS, Day, Floor, Setting, draw_day, write_day
from studies.research.withheld.figures import wilson
from studies.research.withheld.truth import Mechanism
from studies.results.base import envelope
from studies.results.compensate import CompensateResult
from studies.results.enough import EnoughResult

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
    came = rms_3d(found.predict(targets) - first.approached)
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
    came = rms_3d(found.predict(targets) - day.reached)
    if not day.scatter.std.any():  # before anything is measured the arm is believed to come back
        plan = problem_of(cell, Request(len(data), "task"))
        yield Said("design", assess(plan, data.poses.q).task_rms, came)
    accuracy = accuracy_at_targets(cell, found)
    yield Said("identify", accuracy.rms(accuracy.expected.errors), came)


def _intervals(found: calib.Identification, exact: calib.Identification) -> Iterator[Said]:
    """Against what exact readings of the same poses give: constants that are dropped are taken up."""
    low, high = found.interval().T
    held = (low <= exact.values) & (exact.values <= high)
    estimated = (found.std > 0.0) & (exact.std >= 0.0)
    yield from (Said("identify 95 %", right=bool(right)) for right in held[estimated])


def said_of_intervals(arm: str, scatter: float, index: int, seed: int = 0) -> list[Said]:
    """The 95 % intervals of one day by the arm's scatter; odd days approach each pose twice."""
    day = draw_day(Setting(arm, scatter, 1 + index % 2, POSES, MARKERS), index, seed)
    with TemporaryDirectory() as name:
        cell, data, _ = read(Path(name) / "day", day)
        exact = calib.load_measurements(cell, cell.path.parent / "exact.csv")
    held = _intervals(calib.identify(cell, data), calib.identify(cell, exact))
    return [replace(said, sentence=f"intervals {scatter * 1e3:g} mm") for said in held]


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
    return rms_3d(day.approach(commands.q, rng) - wanted)


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
    yield Said("enough end", end.task_rms, rms_3d(later - day.approached))


def _changes(
    cell: calib.Cell,
    before: calib.Identification,
    after: calib.Identification,
    first: Day,
    then: Day,
    times: float,
) -> Iterator[Said]:
    found = changes(cell, known_of(before), known_of(after), estimate_of(after))
    moved, size = rms_3d(then.reached - first.reached), found.there
    seen = found.difference.p_value < FALSE_ALARM
    if not moved:
        yield Said("changes alarm", right=not seen)
    elif seen:
        yield Said("changes size", size.value, moved, size.low <= moved <= size.high)
    else:
        yield Said("changes hidden", size.high, moved, moved <= size.high)
    off = before.predict(targets_of(cell)[0]) - then.approached
    worst = float(np.sqrt((off**2).sum(axis=-1).mean(axis=-1)).max())
    judged = verdict(found.kept[1], times * worst)
    if judged in ("holds", "does_not"):
        yield Said("changes verdict", right=(judged == "holds") == (times > 1.0))


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
    by_parameters = float(np.sqrt(np.mean(known.error.parameters**2)))
    after = found.after
    came = rms_3d(after.model.predict(after.values, targets) - day.reached)
    promised = float(np.hypot(by_parameters, max(h.left for h in found.hidden)))
    return [Said("diagnose", promised, came, came <= promised)]


_JOINTS = (1, 2)  # that move the tip farthest
_HARMONIC, _RIPPLE = (60e-6, 300e-6), (40e-6, 200e-6)  # rad
_CYCLES = (30, 120)  # of a ripple, a turn
_SAG = (100e-6, 600e-6)  # rad, that a compliance adds where the joint bears most
_WARMS = (30e-6, 30e-6)  # m and rad, standard deviations of how far the base goes
_TAU = (0.5, 3.0)  # h
_GOAL = 1.001  # times the smallest that is called reached

Truth = Callable[[Array], Array]


def said_where_something_lacks(arm: str, scatter: float, index: int, seed: int = 0) -> list[Said]:
    """The sentences of a day for each thing that its model may lack.

    scatter : of the arm, m. Odd days approach each pose twice, which shows it
    """
    said = []
    for kind, own in KINDS.items():
        rng = np.random.default_rng([seed, index, 3])
        approaches = 1 + index % 2
        setting = Setting(arm, scatter, approaches, POSES // approaches, MARKERS)
        truth, floor = own(rng, arm)
        said += _said(kind, draw_day(setting, index, seed, truth, floor), rng)
    return said


def _said(kind: str, day: Day, rng: np.random.Generator) -> list[Said]:
    with TemporaryDirectory() as name:
        cell, data, targets = read(Path(name) / "day", day)
        answer = enough(cell, data)
        if answer.found is None:
            raise RuntimeError(answer.why)
        now, came = answer.steps[0], rms_3d(answer.found.predict(targets) - day.approached)
        goal = now.task_most * _GOAL
        commands = calib.compensate(cell, answer.found, targets)
        missed = missed_by_commands(commands, answer.found, day, targets, rng)
        reached = enough(cell, data, goal=goal)
        beyond = enough(cell, data, goal=0.5 * came)
        made = envelope(cell.name, [cell.path], 0)
        answers = [EnoughResult.of(e, cell, made) for e in (reached, beyond)]
        corrected = CompensateResult.of(commands, cell, made)
        texts = [" ".join(markdown(own).split()) for own in (*answers, corrected)]
    stops = "you may stop" in texts[0].lower()
    return [
        Said(f"lacking {kind} most", now.task_most, came, came <= now.task_most),
        Said(f"lacking {kind} stop", right=came <= goal if stops else True),
        Said(f"lacking {kind} commands", commands.rms(commands.expected), missed),
        Said(f"lacking {kind} enough asks", right="posecal diagnose" in texts[1]),
        Said(f"lacking {kind} compensate asks", right="posecal diagnose" in texts[2]),
    ]


def _warm_up(rng: np.random.Generator, arm: str, told: bool) -> tuple[Truth, Floor]:  # noqa: ARG001
    far = rng.normal(size=6) * np.repeat(_WARMS, 3)
    tau = float(np.exp(rng.uniform(*np.log(_TAU))))
    return np.copy, Floor(lambda h: far * (1.0 - np.exp(-h / tau))[:, None], told=told)


def _of_joint(rng: np.random.Generator, between: tuple[float, float]) -> tuple[int, float, float]:
    """A joint, how far it errs, and from where."""
    return (
        int(rng.choice(_JOINTS)),
        float(np.exp(rng.uniform(*np.log(between)))),
        float(rng.uniform(0.0, 2.0 * np.pi)),
    )


def _harmonic(rng: np.random.Generator, arm: str) -> tuple[Truth, None]:  # noqa: ARG001
    joint, size, start = _of_joint(rng, _HARMONIC)
    return lambda q: _moved(q, joint, size * np.sin(q[:, joint] + start)), None


def _ripple(rng: np.random.Generator, arm: str) -> tuple[Truth, None]:  # noqa: ARG001
    joint, size, start = _of_joint(rng, _RIPPLE)
    cycles = int(rng.integers(*_CYCLES))
    return lambda q: _moved(q, joint, size * np.sin(cycles * q[:, joint] + start)), None


def _compliance(rng: np.random.Generator, arm: str) -> tuple[Truth, None]:
    """Under the weight of the links, of which the cell knows nothing."""
    joint, size, _ = _of_joint(rng, _SAG)
    own = ARMS[arm]
    heavy = Mechanism(own, np.zeros((own.dof + 2, 6)), np.zeros((1, 3)))
    low, high = own.limits.T
    most = np.abs(heavy.posed(rng.uniform(low, high, (200, own.dof))).torque[:, joint]).max()
    return lambda q: _moved(q, joint, size / most * heavy.posed(q).torque[:, joint]), None


def _moved(q: Array, joint: int, off: Array) -> Array:
    return np.asarray(q + off[:, None] * (np.arange(q.shape[1]) == joint))


KINDS: dict[str, Callable[[np.random.Generator, str], tuple[Truth, Floor | None]]] = {
    "warm-up": lambda rng, arm: _warm_up(rng, arm, told=True),
    "warm-up, time untold": lambda rng, arm: _warm_up(rng, arm, told=False),
    "harmonic": _harmonic,
    "ripple": _ripple,
    "compliance": _compliance,
    "nothing": lambda *_: (np.copy, None),
    "nothing, an hour later": lambda *_: (np.copy, Floor(lambda h: np.zeros((len(h), 6)))),
}


SENTENCES = {
    "design": "expected after measuring",
    "identify 95 %": "95 of 100 intervals hold the true value",
    "identify": "uncertainty at the targets",
    "enough now": "expected now",
    "enough most": "19 times in 20 the error is below",
    "enough end": "expected at the plan's end",
    "compensate": "commands will miss by",
    "changes alarm": "nothing moved, where nothing did",
    "changes hidden": "what may hide in it is at most",
    "changes size": "something moved: .. (95 % interval)",
    "changes verdict": "holds, does not hold within a tolerance",
    "diagnose": "nothing is left; what could hide would leave",
}
_LACKING = {
    "most": "enough: 19 times in 20 the error is below",
    "stop": "enough: you may stop",
    "commands": "compensate: corrected commands are expected to miss by",
    "enough asks": "enough: run posecal diagnose",
    "compensate asks": "compensate: run posecal diagnose",
}
SENTENCES |= {
    f"lacking {kind} {key}": f"{kind}: {said}" for kind in KINDS for key, said in _LACKING.items()
}
_SCATTERS = (0.0, 0.01)  # mm
_FURTHER = (0.0, 0.005, 0.01, 0.03)  # of intervals alone
SENTENCES |= {
    f"intervals {s:g} mm": "95 of 100 intervals hold the true value, by the arm's scatter"
    for s in _FURTHER
}


PARTS: dict[str, Callable[..., list[Said]]] = {
    "day": said_in_a_day,
    "diagnosis": said_by_diagnosis,
    "intervals": said_of_intervals,
    "lacking": said_where_something_lacks,
}


def summaries(found: Sequence[Said]) -> dict[str, dict[str, Any]]:
    """Of each sentence: on how many days, how often right, and what came over what was promised."""
    own = {key: [s for s in found if s.sentence == key] for key in SENTENCES}
    return {key: _summary(said) for key, said in own.items() if said}


def _summary(said: Sequence[Said]) -> dict[str, Any]:
    judged = [s.right for s in said if s.right is not None]
    ratios = [s.came / s.promised for s in said if s.promised and s.came is not None]
    return {
        "days": len(said),
        "right": sum(judged) if judged else None,
        "ci95": wilson(sum(judged), len(judged)) if judged else None,
        "came_over_promised": float(np.sqrt(np.mean(np.square(ratios)))) if ratios else None,
    }


def _told(key: str, own: Row) -> Row:
    right = "" if own["right"] is None else f"{own['right']} of {own['days']}"
    low, high = own["ci95"] or (0.0, 0.0)
    ratio = own["came_over_promised"]
    return {
        "command": " ".join(key.split()[: 2 if key.startswith("intervals") else 1]),
        "says": SENTENCES[key],
        "days": own["days"],
        "came true": right,
        "95 % [%]": f"{100 * low:.0f} to {100 * high:.0f}" if right else "",
        "came /\npromised": "" if ratio is None else f"{ratio:.2f}",
    }


def said_on(part: str, arm: str, scatter: float, index: int, seed: int) -> list[Said]:
    """All that is said on a day of a part; scatter : of the arm, mm."""
    return PARTS[part](arm, scatter * 1e-3, index, seed=seed)


@bench(
    several("--only", tuple(PARTS)),
    several("--arm", tuple(ARMS), default=("6R", "7R")),
    several("--scatter", _FURTHER, default=_SCATTERS, help="Of the arm, mm."),
    days=20,
    days_help="Of each arm and scatter.",
    workers=True,
)
def main(
    days: int,
    only: tuple[str, ...],
    arm: tuple[str, ...],
    scatter: tuple[float, ...],
    seed: int,
    workers: int,
) -> Output:
    """Simulate days and count which sentences came true."""
    tasks = product(only, arm, scatter, range(days))
    found = [said for day in each(said_on, tasks, workers, seed=seed) for said in day]
    told = summaries(found)
    shown = table(_told(key, own) for key, own in told.items())
    return [shown], {"seed": seed, "summaries": told, "said": [asdict(said) for said in found]}


if __name__ == "__main__":
    main()
