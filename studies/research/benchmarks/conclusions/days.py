"""A day: what is true, what was read, the files, and what the diagnosis says of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import calib
from studies.diagnose.make import findings
from studies.research.benchmarks.conclusions.sizing import NoSuchDay
from studies.research.benchmarks.conclusions.true_causes import TrueCause
from studies.research.withheld.case_files import write_case
from studies.research.withheld.draw import EASY, Case
from studies.research.withheld.scene import Scene
from studies.research.withheld.truth import Mechanism
from studies.research.withheld.visible import at_rest

Row = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Day:
    """One day.

    kind : what it is counted as
    causes : of size; noncentrality : of each, beside the others
    family : how many of the causes, the first ones, are one kind at all joints
    ratio : scatter of the arm over noise of the instrument, of one coordinate of the tip
    """

    kind: str
    scene: Scene
    mechanism: Mechanism
    causes: tuple[TrueCause, ...] = ()
    noncentrality: tuple[float, ...] = ()
    family: int = 0
    ratio: float = 0.0
    more: Row = field(default_factory=dict)


def by_turns(
    kinds: Sequence[str], make: Callable[[np.random.Generator, str, bool], Day]
) -> Callable[[np.random.Generator, int], Day]:
    """A draw by number: the kinds take turns, and two days of three the arm scatters.

    make : draws one of a kind, or raises NoSuchDay
    """

    def draw(rng: np.random.Generator, index: int) -> Day:
        kind, scatters = kinds[index % len(kinds)], index // len(kinds) % 3 > 0
        while True:
            try:
                return make(rng, kind, scatters)
            except NoSuchDay:
                continue

    return draw


def read(rng: np.random.Generator, day: Day) -> Case:
    """The day as it is measured: the arm scatters, the instrument errs.

    Raises NoSuchDay where the arm is too soft for its loads.
    """
    scene = day.scene
    wander = [] if scene.scatter is None else [scene.scatter.drawn(rng, scene.session.visit)]
    try:
        state = at_rest(scene, day.mechanism, [*day.causes, *wander])
    except RuntimeError:
        raise NoSuchDay from None
    noise = rng.normal(size=state.readings.shape) * scene.noise.sigma
    return Case(
        family=day.kind,
        conditions=EASY,
        scene=scene,
        causes=(),
        noncentrality=day.noncentrality,
        beside=day.noncentrality,
        together=sum(day.noncentrality),
        state=state,
        clean=state.readings,
        noisy=state.readings + noise,
        seen=np.ones(state.readings.shape[:2], dtype=bool),
    )


def said_of(case: Case) -> Row:
    """The findings as JSON, and the seconds; where the program breaks, how."""
    with TemporaryDirectory() as name:
        folder = Path(name) / "day"
        write_case(folder, case)
        cell = calib.load_cell(folder / "cell.toml")
        data = calib.load_measurements(cell, folder / "measurements.csv")
        begun = time.perf_counter()
        try:
            found = findings(calib.diagnose(cell, data)).model_dump(mode="json", by_alias=True)
        except Exception as error:  # a traceback is a conclusion too, and a wrong one
            found = {"verdict": "failed", "error": f"{type(error).__name__}: {error}"}
    return {**found, "seconds": round(time.perf_counter() - begun, 2)}
