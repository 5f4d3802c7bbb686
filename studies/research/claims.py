"""How often sentences come true that the commands say to a user, over simulated days.

    python -m studies.research.claims [--days 20] [--only day] [--arm 6R] .. [--json FILE]

The truth is MuJoCo's (``truth.day``); posecal sees files. A day of 60 poses has geometric errors, a
base anywhere, guessed markers, an instrument of 0.01 mm, and an arm that scatters by nothing or by
0.01 mm.

day: its first half is one day to the commands, its second half the next. On odd days the zero of the
third joint slips in between, by 10 to 100 urad. What comes at 200 targets is where one fresh approach
of each takes the arm, against the model. A verdict of ``changes`` counts where it says one, with a
tolerance of 0.6 to 1.6 times what truly comes.

diagnosis: the gear of the third joint errs by 200 urad once a turn, that of the fifth by 2 to 60 urad.
It counts where nothing is said to be left: whether what comes is within what was named there, beside
the parameters' uncertainty.

intervals: those of parameters alone, by the arm's scatter. The constants that the model drops are
absorbed by those it keeps; their truth is what ``identify`` finds from exact readings of these poses.

lacking: the base warms for an hour of readings and the targets come an hour later (as the cell says, or
untold); or a joint errs once a turn, or thirty to 120 times, or gives way under weights that the cell
does not know. "you may stop" is right where it is not said, or comes true at the targets' time. On odd
days each pose is approached twice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import calib
from calib.arrays import Array
from calib.cell.targets import targets_of
from calib.change import FALSE_ALARM, changes, known_of, verdict
from calib.prediction.budget import accuracy_at_targets
from calib.prediction.estimate import estimate_of
from doe.forecast.enough import enough
from doe.plan import assess
from doe.problem import problem_of
from doe.request import Request
from studies.render import markdown
from studies.research.bench import Output, Row, bench, each, rms, rms_3d, several, table
from studies.research.days import Read, moved, read
from studies.research.rates import Rate
from studies.research.truth.day import ARMS, Floor, Setting, Truth, draw_day
from studies.research.truth.mechanism import Mechanism
from studies.results.base import envelope
from studies.results.enough import EnoughResult

POSES, MARKERS = 60, 3
_SLIP = (10e-6, 100e-6)  # rad, of the third joint
_FIRST, _SECOND = 200e-6, (2e-6, 60e-6)  # rad, of two gears
_TOLERANCE = (0.6, 1.6)  # times what comes
_JOINTS = (1, 2)  # that move the tip farthest
_HARMONIC, _RIPPLE, _CYCLES = (60e-6, 300e-6), (40e-6, 200e-6), (30, 120)  # rad, and times a turn
_SAG = (100e-6, 600e-6)  # rad, that a compliance adds where the joint bears most
_WARMS, _TAU = (30e-6, 30e-6), (0.5, 3.0)  # how far the base goes, m and rad; h
_GOAL = 1.001  # times the smallest that is called reached


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

    @classmethod
    def below(cls, sentence: str, most: float, came: float) -> Said:
        """What comes is to be no larger."""
        return cls(sentence, most, came, came <= most)


def came(own: Read, found: calib.Identification) -> float:
    """How far one approach of each target is from what a result foretells, RMS, m."""
    return rms_3d(found.predict(own.targets) - own.day.approached)


def compensated(own: Read, found: calib.Identification, rng: np.random.Generator) -> Said:
    """Where the corrected commands take the arm, against the arm of its file as it was placed."""
    commands = calib.compensate(own.cell, found, own.targets)
    (base,) = found.bases.values()
    R = Rotation.from_rotvec(base[3:]).as_matrix()
    wanted = own.day.nominal(own.targets.q, found.marker_positions, R, base[:3])
    missed = rms_3d(own.day.approach(commands.q, rng) - wanted)
    return Said("compensate", commands.rms(commands.expected), missed)


# -- a day and its morrow --------------------------------------------------------------------------


def said_in_a_day(arm: str, scatter: float, index: int, seed: int = 0) -> list[Said]:
    """All sentences of one day but those of the diagnosis; scatter : of the arm, m."""
    rng = np.random.default_rng([seed, index, 1])
    setting = Setting(arm, scatter, 1, POSES, MARKERS)
    slip = float(np.exp(rng.uniform(*np.log(_SLIP)))) * (index % 2)
    first = read(draw_day(setting, index, seed))
    then = read(draw_day(setting, index, seed, lambda q: moved(q, 2, slip)))
    half = np.arange(POSES) < POSES // 2
    data, cell = first.data.take(half), first.cell
    found, again = calib.identify(cell, data), calib.identify(cell, then.data.take(~half))
    there, targets = came(first, found), first.targets
    still = rms_3d(found.predict(targets) - first.day.reached)
    accuracy, steps = accuracy_at_targets(cell, found), enough(cell, data, first.data.poses).steps
    whole = calib.identify(cell, first.data)
    before = []
    if not scatter:  # before anything is measured the arm is believed to come back
        plan = problem_of(cell, Request(len(data), "task"))
        before = [Said("design", assess(plan, data.poses.q).task_rms, still)]
    return [
        *before,
        Said("identify", accuracy.rms(accuracy.expected.errors), still),
        Said("enough now", steps[0].task_rms, there),
        Said.below("enough most", steps[0].task_most, there),
        Said("enough end", steps[-1].task_rms, came(first, whole)),
        *_intervals("identify 95 %", found, calib.identify(cell, first.exact.take(half))),
        compensated(first, found, rng),
        *_changes(first, then, found, again, rng.uniform(*_TOLERANCE)),
    ]


def _intervals(
    sentence: str, found: calib.Identification, exact: calib.Identification
) -> Iterator[Said]:
    """Against what exact readings of the same poses give: constants that are dropped are taken up."""
    low, high = found.interval().T
    held = (low <= exact.values) & (exact.values <= high)
    estimated = (found.std > 0.0) & (exact.std >= 0.0)
    yield from (Said(sentence, right=bool(right)) for right in held[estimated])


def _changes(
    first: Read, then: Read, before: calib.Identification, after: calib.Identification, times: float
) -> Iterator[Said]:
    cell = first.cell
    found = changes(cell, known_of(before), known_of(after), estimate_of(after))
    went, size = rms_3d(then.day.reached - first.day.reached), found.there
    seen = found.difference.p_value < FALSE_ALARM
    if not went:
        yield Said("changes alarm", right=not seen)
    elif seen:
        yield Said("changes size", size.value, went, size.low <= went <= size.high)
    else:
        yield Said.below("changes hidden", size.high, went)
    off = before.predict(targets_of(cell)[0]) - then.day.approached
    worst = float(np.sqrt((off**2).sum(axis=-1).mean(axis=-1)).max())
    judged = verdict(found.kept[1], times * worst)
    if judged in ("holds", "does_not"):
        yield Said("changes verdict", right=(judged == "holds") == (times > 1.0))


def said_of_intervals(arm: str, scatter: float, index: int, seed: int = 0) -> list[Said]:
    """The 95 % intervals of one day by the arm's scatter; odd days approach each pose twice."""
    own = read(draw_day(Setting(arm, scatter, 1 + index % 2, POSES, MARKERS), index, seed))
    found, exact = (calib.identify(own.cell, data) for data in (own.data, own.exact))
    return list(_intervals(f"intervals {scatter * 1e3:g} mm", found, exact))


def said_by_diagnosis(arm: str, scatter: float, index: int, seed: int = 0) -> list[Said]:
    """What a diagnosis says where one gear errs plainly and another by little."""
    rng = np.random.default_rng([seed, index, 2])
    little = float(np.exp(rng.uniform(*np.log(_SECOND))))

    def truth(q: Array) -> Array:
        plain = moved(q, 2, _FIRST * np.cos(q[:, 2]))
        return plain + moved(q, 4, little * np.sin(q[:, 4])) - q

    own = read(draw_day(Setting(arm, scatter, 1, POSES, MARKERS), index, seed, truth))
    found = calib.diagnose(own.cell, own.data)
    if found.verdict not in ("explained", "ambiguous"):
        return []
    by_parameters = rms(calib.compensate(own.cell, found, own.targets).error.parameters)
    after = found.after
    there = rms_3d(after.model.predict(after.values, own.targets) - own.day.reached)
    promised = float(np.hypot(by_parameters, max(h.left for h in found.hidden)))
    return [Said.below("diagnose", promised, there)]


# -- what a model may lack -------------------------------------------------------------------------


def said_where_something_lacks(arm: str, scatter: float, index: int, seed: int = 0) -> list[Said]:
    """The sentences of a day for each thing that its model may lack; scatter : of the arm, m."""
    said = []
    for kind, lacking in KINDS.items():
        rng = np.random.default_rng([seed, index, 3])
        approaches = 1 + index % 2
        setting = Setting(arm, scatter, approaches, POSES // approaches, MARKERS)
        truth, floor = lacking(rng, arm)
        said += _said(kind, read(draw_day(setting, index, seed, truth, floor)), rng)
    return said


def _said(kind: str, own: Read, rng: np.random.Generator) -> list[Said]:
    answer = enough(own.cell, own.data)
    if answer.found is None:
        raise RuntimeError(answer.why)
    most, there = answer.steps[0].task_most, came(own, answer.found)
    reached = enough(own.cell, own.data, goal=most * _GOAL)
    text = markdown(EnoughResult.of(reached, own.cell, envelope(own.cell.name, [], 0)))
    stops = "you may stop" in " ".join(text.split()).lower()
    commands = compensated(own, answer.found, rng)
    return [
        Said.below(f"lacking {kind} most", most, there),
        Said(f"lacking {kind} stop", right=there <= most * _GOAL if stops else True),
        replace(commands, sentence=f"lacking {kind} commands"),
    ]


Lacking = tuple[Truth, Floor | None]


def _warm_up(rng: np.random.Generator, told: bool) -> Lacking:
    far = rng.normal(size=6) * np.repeat(_WARMS, 3)
    tau = float(np.exp(rng.uniform(*np.log(_TAU))))
    return np.copy, Floor(lambda h: far * (1.0 - np.exp(-h / tau))[:, None], told=told)


def _of_joint(rng: np.random.Generator, between: tuple[float, float]) -> tuple[int, float, float]:
    """A joint, how far it errs, and from where."""
    joint, size = int(rng.choice(_JOINTS)), float(np.exp(rng.uniform(*np.log(between))))
    return joint, size, float(rng.uniform(0.0, 2.0 * np.pi))


def _wave(rng: np.random.Generator, between: tuple[float, float], ripple: bool) -> Lacking:
    joint, size, start = _of_joint(rng, between)
    cycles = int(rng.integers(*_CYCLES)) if ripple else 1
    return lambda q: moved(q, joint, size * np.sin(cycles * q[:, joint] + start)), None


def _compliance(rng: np.random.Generator, arm: str) -> Lacking:
    """Under the weight of the links, of which the cell knows nothing."""
    joint, size, _ = _of_joint(rng, _SAG)
    own = ARMS[arm]
    heavy = Mechanism(own, np.zeros((own.dof + 2, 6)), np.zeros((1, 3)))
    low, high = own.limits.T
    most = np.abs(heavy.posed(rng.uniform(low, high, (200, own.dof))).torque[:, joint]).max()
    return lambda q: moved(q, joint, size / most * heavy.posed(q).torque[:, joint]), None


KINDS: dict[str, Callable[[np.random.Generator, str], Lacking]] = {
    "warm-up": lambda rng, _: _warm_up(rng, told=True),
    "warm-up, time untold": lambda rng, _: _warm_up(rng, told=False),
    "harmonic": lambda rng, _: _wave(rng, _HARMONIC, ripple=False),
    "ripple": lambda rng, _: _wave(rng, _RIPPLE, ripple=True),
    "compliance": _compliance,
    "nothing": lambda *_: (np.copy, None),
    "nothing, an hour later": lambda *_: (np.copy, Floor(lambda h: np.zeros((len(h), 6)))),
}
_SCATTERS, _FURTHER = (0.0, 0.01), (0.0, 0.005, 0.01, 0.03)  # mm; the latter of intervals alone
_LACKING = {
    "most": "enough: 19 times in 20 the error is below",
    "stop": "enough: you may stop",
    "commands": "compensate: corrected commands are expected to miss by",
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
    **{f"lacking {kind} {key}": f"{kind}: {s}" for kind in KINDS for key, s in _LACKING.items()},
    **{f"intervals {s:g} mm": "95 of 100 intervals hold the true value" for s in _FURTHER},
}
PARTS: dict[str, Callable[..., list[Said]]] = {
    "day": said_in_a_day,
    "diagnosis": said_by_diagnosis,
    "intervals": said_of_intervals,
    "lacking": said_where_something_lacks,
}


def summaries(found: Sequence[Said]) -> dict[str, dict[str, Any]]:
    """Of each sentence: on how many days, how often right, and what came over what was promised."""
    by_sentence = {key: [s for s in found if s.sentence == key] for key in SENTENCES}
    return {key: _summary(said) for key, said in by_sentence.items() if said}


def _summary(said: Sequence[Said]) -> dict[str, Any]:
    judged = [s.right for s in said if s.right is not None]
    ratios = [s.came / s.promised for s in said if s.promised and s.came is not None]
    return {
        "days": len(said),
        "right": sum(judged) if judged else None,
        "ci95": Rate.of("", "", judged).interval,
        "came_over_promised": rms(ratios) if ratios else None,
    }


def _line(key: str, own: Row) -> Row:
    right, ratio = own["right"], own["came_over_promised"]
    return {
        "command": " ".join(key.split()[: 2 if key.startswith("intervals") else 1]),
        "says": SENTENCES[key],
        "days": own["days"],
        "came true": None if right is None else f"{right} of {own['days']}",
        "95 % [%]": own["ci95"] and " to ".join(f"{100 * end:.0f}" for end in own["ci95"]),
        "came /\npromised": ratio,
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
def main(days: int, seed: int, workers: int, **which: tuple[Any, ...]) -> Output:
    """Simulate days and count which sentences came true."""
    tasks = product(which["only"], which["arm"], which["scatter"], range(days))
    found = [said for day in each(said_on, tasks, workers, seed=seed) for said in day]
    told = summaries(found)
    shown = table(_line(key, own) for key, own in told.items())
    return [shown], {"seed": seed, "summaries": told, "said": [asdict(said) for said in found]}


if __name__ == "__main__":
    main()
