"""What the commands say of one simulated day on which the model lacks something, and what was so."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import calib
from calib.arrays import Array
from calib.threads import one_blas_thread
from doe.ahead.enough import enough
from studies.compensate.record import compensate_record
from studies.compensate.telling import told as told_of_commands
from studies.document import Document
from studies.document.terminal import terminal
from studies.enough.record import enough_record
from studies.enough.telling import told as told_of_poses
from studies.record import envelope
from studies.research.benchmarks.claimed import (
    MARKERS,
    POSES,
    Said,
    missed_by_commands,
    read,
    rms,
)
from studies.research.benchmarks.day import ARMS, Day, Floor, Setting, draw_day
from studies.research.withheld.truth import Mechanism

_JOINTS = (1, 2)  # that move the tip farthest
_HARMONIC, _RIPPLE = (60e-6, 300e-6), (40e-6, 200e-6)  # rad
_CYCLES = (30, 120)  # of a ripple, a turn
_SAG = (100e-6, 600e-6)  # rad, that a compliance adds where the joint bears most
_WARMS = (30e-6, 30e-6)  # m and rad, standard deviations of how far the base goes
_TAU = (0.5, 3.0)  # h
_GOAL = 1.001  # times the smallest that is called reached

Truth = Callable[[Array], Array]


@one_blas_thread
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
        now, came = answer.steps[0], rms(answer.found.predict(targets) - day.approached)
        goal = now.task_most * _GOAL
        commands = calib.compensate(cell, answer.found, targets)
        missed = missed_by_commands(commands, answer.found, day, targets, rng)
        reached = enough(cell, data, goal=goal)
        beyond = enough(cell, data, goal=0.5 * came)
        made = envelope(cell.name, [cell.path], 0)
        texts = [
            _text(told_of_poses(enough_record(e, 0, "targets.csv", made)))
            for e in (reached, beyond)
        ]
        corrected = compensate_record(cell.robot, commands, made)
        texts.append(_text(told_of_commands(corrected)))
    stops = "you may stop" in texts[0].lower()
    return [
        Said(f"lacking {kind} most", now.task_most, came, came <= now.task_most),
        Said(f"lacking {kind} stop", right=came <= goal if stops else True),
        Said(f"lacking {kind} commands", commands.rms(commands.expected), missed),
        Said(f"lacking {kind} enough asks", right="posecal diagnose" in texts[1]),
        Said(f"lacking {kind} compensate asks", right="posecal diagnose" in texts[2]),
    ]


def _text(document: Document) -> str:
    return " ".join(" ".join(map(str, terminal(document))).split())


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
