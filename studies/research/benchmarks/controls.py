"""Shuffled controls, and arms that once were diagnosed wrongly: how often what is said is right.

    python -m studies.research.benchmarks.controls [--seeds 5] [--only settling] .. [--workers 2]
        [--json FILE]

Scenes and truth are those of the sealed cases (``studies.research.withheld``), with a hold-out. Causes
are sized by noncentrality where nothing is said of their size.

- ``backlash``, ``drift``, ``heat``: named, in its class. The same, ``shuffled``: moves, times and
  temperatures are permuted over the stays at joints, so that no effect of these may be named and no
  place may depend on them.
- ``settling``: a joint is read before it is at rest and lags by a share of the move: ``unknown`` at
  that joint by ``motion``, or named ``settling`` there. Never backlash.
- ``scara``: Z follows J4 by 30 um/rad and its screw is 500 ppm long, Z measured at its two limits
  only, at 15 configurations: both are named.
- ``six harmonics``: at six joints; all are named, and ``explained`` is not said before.
- ``hung load``, ``payload``: 6 % heavier than believed, compliances free: ``payload`` is in a class.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

import click
import numpy as np

import calib
from calib.files.write import json_text, write_files
from calib.threads import one_blas_thread
from studies.command.deliver import console_for
from studies.command.options import one_line_faults
from studies.diagnose.make import findings
from studies.research.benchmarks.day import SCARA
from studies.research.withheld.actions import Action, State
from studies.research.withheld.case_files import write_case
from studies.research.withheld.causes import Cause
from studies.research.withheld.draw import EASY, Case, draw_scene
from studies.research.withheld.robots import ARMS, HEAVY, Arm
from studies.research.withheld.scene import Scene
from studies.research.withheld.visible import Acting, Projector, at_rest
from studies.tables import plain_table

NONCENTRALITY = 1000.0
_OF_COLUMNS = (
    "backlash", "friction_windup", "settling", "base_drift", "tracker_drift", "thermal_expansion",
    "warm_up", "step",
)  # fmt: skip
_COLUMNS = ("approach", "motion", "time", "temperature")

Answer = dict[str, Any]
Right = Callable[[Answer], bool]


class Sized(Acting, Protocol):
    """A cause that can be made larger."""

    def sized(self, factor: float) -> Sized:
        """The same, so many times as large."""


@dataclass(frozen=True)
class Lag:
    """A joint that is read while it still has a share of its last move to go."""

    joint: int
    share: float = 1e-4

    def sized(self, factor: float) -> Lag:
        """The same, so many times as large."""
        return replace(self, share=self.share * factor)

    def add_to(self, action: Action, scene: Scene, state: State) -> None:  # noqa: ARG002
        """Dq = -share * move; readings of one stay share the move that led there."""
        q, visit = scene.session.q[:, self.joint], scene.session.visit
        places = q[np.unique(visit, return_index=True)[1]]
        action.joint[:, self.joint] -= self.share * np.diff(places, prepend=places[0])[visit]


def sized(scene: Scene, cause: Sized, noncentrality: float = NONCENTRALITY) -> Sized:
    """A cause of a certain noncentrality in the readings that are fitted, to first order."""
    mechanism = scene.mechanism()
    still = at_rest(scene, mechanism, ())
    seen = np.ones(still.readings.shape[:2], dtype=bool) & ~scene.session.held[:, None]
    moved = at_rest(scene, mechanism, [cause]).readings - still.readings
    rest = Projector(scene, still, seen).left(moved)
    return cause.sized(float(np.sqrt(noncentrality / (rest @ rest))))


def measured(rng: np.random.Generator, scene: Scene, *causes: Acting) -> Case:
    """What the instrument reads of them."""
    state = at_rest(scene, scene.mechanism(), causes)
    noise = scene.noise.coloured(rng.normal(size=state.readings.shape), state.readings)
    return Case(
        family="control",
        conditions=EASY,
        scene=scene,
        causes=(),
        noncentrality=(),
        beside=(),
        together=0.0,
        state=state,
        clean=state.readings,
        noisy=state.readings + noise,
        seen=np.ones(state.readings.shape[:2], dtype=bool),
    )


def shuffled(rng: np.random.Generator, case: Case) -> Case:
    """The same readings with moves, times and temperatures of other stays."""
    session = case.scene.session
    stays = rng.permutation(len(session) // 2)
    order = (2 * stays[:, None] + np.arange(2)).ravel()
    session = replace(
        session,
        time=session.time[order],
        temperature=session.temperature[order],
        approach=session.approach[order],
    )
    return replace(case, scene=replace(case.scene, session=session))


def names(answer: Answer) -> set[str]:
    """Every effect that is named, and what it says it cannot be told from."""
    effects = answer["effects"]
    listed = [e for effect in effects for e in (effect, *(effect.get("class") or []))]
    return {f"{e['effect']}:{e['where']}" for e in listed}


def of_no_column(answer: Answer) -> bool:
    """Nothing is said of moves, time or temperature."""
    places = [p["depends_on"].partition(":")[0] for p in answer["located"]]
    named = [effect["effect"] for effect in answer["effects"]]
    return not (set(named) & set(_OF_COLUMNS) or set(places) & set(_COLUMNS))


def _scene(rng: np.random.Generator, arm: Arm, **conditions: Any) -> Scene:
    return draw_scene(rng, arm, replace(EASY, **conditions))


def of_columns(rng: np.random.Generator, effect: str, shuffle: bool) -> tuple[Case, Right]:
    """One effect of moves, time or temperature, as it was measured or with these permuted."""
    scene = _scene(rng, ARMS[int(rng.integers(len(ARMS)))])
    where, values = {
        "backlash": (str(rng.choice(scene.arm.names[1:])), {"half_width": 1e-4}),
        "base_drift": ("base", {"x": 2e-5, "y": -1e-5, "z": 1e-5, "rx": 2e-5, "ry": 0.0, "rz": 2e-5}),
        "thermal_expansion": ("arm", {"growth": 1e-5}),
    }[effect]  # fmt: skip
    case = measured(rng, scene, sized(scene, Cause(effect, where, values)))
    if shuffle:
        return shuffled(rng, case), of_no_column
    return case, lambda answer: f"{effect}:{where}" in names(answer)


def settling(rng: np.random.Generator) -> tuple[Case, Right]:
    """One joint lags."""
    scene = _scene(rng, ARMS[int(rng.integers(len(ARMS)))])
    turning = [k for k, joint in enumerate(scene.arm.joints) if not joint.slides]
    joint = int(rng.choice(turning[:-1]))
    where = scene.arm.names[joint]

    def right(answer: Answer) -> bool:
        place, named = answer["located"][:1], names(answer)
        lags = [(p["where"], p["depends_on"]) for p in place] == [(where, f"motion:{where}")]
        unnamed = answer["verdict"] == "unknown" and not named and lags
        return unnamed or [f"{e['effect']}:{e['where']}" for e in answer["effects"]] == [
            f"settling:{where}"
        ]

    return measured(rng, scene, sized(scene, Lag(joint))), right


def scara(rng: np.random.Generator) -> tuple[Case, Right]:
    """A coupling and a long screw on an axis that was measured at two places."""
    scene = _scene(rng, SCARA, missing="approach", weighs=False, configurations=15)
    z = SCARA.names.index("Z")
    q = scene.session.q.copy()
    _, config = np.unique(q, axis=0, return_inverse=True)
    config = config.ravel()
    q[:, z] = rng.permutation(np.resize(SCARA.limits[z], config.max() + 1))[config]
    scene = replace(scene, session=replace(scene.session, q=q))
    coupling = Cause("joint_coupling", "Z", {"from_J4": 30e-6})
    screw = Cause("transmission_scale", "Z", {"scale": 500e-6})
    true = {"joint_coupling:Z", "transmission_scale:Z"}
    return measured(rng, scene, coupling, screw), lambda answer: true <= names(answer)


def six_harmonics(rng: np.random.Generator) -> tuple[Case, Right]:
    """Every joint of an arm errs once or twice a turn."""
    scene = _scene(rng, HEAVY)
    causes = []
    for where in HEAVY.names:
        order, phase = int(rng.integers(1, 3)), rng.uniform(0.0, 2.0 * np.pi)
        values = {f"cos_{order}": 1e-4 * np.cos(phase), f"sin_{order}": 1e-4 * np.sin(phase)}
        causes.append(sized(scene, Cause("transmission_harmonic", where, values)))
    true = {f"transmission_harmonic:{where}" for where in HEAVY.names}
    return measured(rng, scene, *causes), lambda answer: true <= names(answer)


def too_heavy(rng: np.random.Generator, hung: bool) -> tuple[Case, Right]:
    """What hangs at the tool, or is carried always, weighs 6 % more than believed."""
    scene = _scene(rng, HEAVY, payload=not hung)
    values = {"scale": 0.06} if hung else {"mass": 0.06 * scene.payload}
    case = measured(rng, scene, Cause("payload", "payload", values))
    return case, lambda answer: "payload:payload" in names(answer)


CONTROLS: dict[str, Callable[[np.random.Generator], tuple[Case, Right]]] = {
    "backlash": lambda rng: of_columns(rng, "backlash", False),
    "backlash, shuffled": lambda rng: of_columns(rng, "backlash", True),
    "drift": lambda rng: of_columns(rng, "base_drift", False),
    "drift, shuffled": lambda rng: of_columns(rng, "base_drift", True),
    "heat": lambda rng: of_columns(rng, "thermal_expansion", False),
    "heat, shuffled": lambda rng: of_columns(rng, "thermal_expansion", True),
    "settling": settling,
    "scara": scara,
    "six harmonics": six_harmonics,
    "hung load": lambda rng: too_heavy(rng, True),
    "payload": lambda rng: too_heavy(rng, False),
}


@one_blas_thread
def one_control(name: str, seed: int) -> Answer:
    """The diagnosis of one case: whether it is right, and the fields of ``diagnose --json``."""
    kind = name.partition(",")[0]  # a shuffled case has the readings of the other
    case, right = CONTROLS[name](np.random.default_rng([seed, list(CONTROLS).index(kind)]))
    with TemporaryDirectory() as made:
        folder = Path(made) / "case"
        write_case(folder, case)
        cell = calib.load_cell(folder / "cell.toml")
        data, heldout = (
            calib.load_measurements(cell, folder / table)
            for table in ("measurements.csv", "heldout.csv")
        )
        answer = findings(calib.diagnose(cell, data, heldout=heldout)).model_dump(
            mode="json", by_alias=True
        )
    return {"case": name, "seed": seed, "right": right(answer), **answer}


def said(answer: Answer) -> str:
    """An answer in some words."""
    named = [f"{e['effect']}:{e['where']}" for e in answer["effects"]]
    taken = {e["where"] for e in answer["effects"]}
    places = [
        f"{p['where']} by {p['depends_on']}" for p in answer["located"] if p["where"] not in taken
    ]
    return " ".join([answer["verdict"], *named, *(["at", ", ".join(places)] if places else [])])


@click.command()
@click.option("--seeds", type=click.IntRange(min=1), default=5, show_default=True)
@click.option("--only", multiple=True, default=tuple(CONTROLS), type=click.Choice(tuple(CONTROLS)))
@click.option("--workers", type=click.IntRange(min=1), default=1, show_default=True)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="All diagnoses.")
@one_line_faults
def main(seeds: int, only: tuple[str, ...], workers: int, json_path: Path | None) -> None:
    """Diagnose the controls and print how often the answer was right."""
    tasks = [(name, seed) for name in only for seed in range(seeds)]
    with ProcessPoolExecutor(workers) as pool:
        answers = list(pool.map(one_control, *zip(*tasks, strict=True)))
    table = plain_table(("case", "left"), ("right", "right"), ("said, how often", "left"))
    for name in only:
        own = [answer for answer in answers if answer["case"] == name]
        words = Counter(map(said, own)).most_common()
        right = sum(answer["right"] for answer in own)
        for index, (text, count) in enumerate(words):
            head = (name, f"{right} of {len(own)}") if index == 0 else ("", "")
            table.add_row(*head, f"{count}  {text}")
    console_for(None).print(table)
    if json_path is not None:
        write_files({json_path: json_text({"answers": answers})})


if __name__ == "__main__":
    main()
