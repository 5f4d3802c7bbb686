"""Cases as real arms are: they scatter, ripple, settle and warm up, from several causes at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from studies.research.withheld.causes import (
    RATIO,
    Cause,
    all_places,
    cause_at,
    direction,
    draw_beyond,
    draw_real,
)
from studies.research.withheld.draw import (
    HELD_OUT,
    NONCENTRALITY,
    Case,
    Conditions,
    Draft,
    Draw,
    NoSuchCase,
    scene_of_session,
    sized,
)
from studies.research.withheld.judge import VISIBLE
from studies.research.withheld.robots import Arm, Array, draw_arm
from studies.research.withheld.scene import Scene
from studies.research.withheld.session import READINGS, draw_day
from studies.research.withheld.truth import Mechanism
from studies.research.withheld.visible import (
    at_rest,
    beside_others,
    excess,
    projected,
    tangents,
)

_VISITS = (0.45, 0.35, 0.20)  # shares of ``READINGS``
_POSES = {"once": (60, 150), "free and loaded": (40, 75), "thrice": (40, 50)}
_ONE_MARKER = (40, 80)


@dataclass(frozen=True)
class RealConditions(Conditions):
    """Those of the first families, and what real days add.

    visit : of ``READINGS``; one_marker : a single reflector
    background : fine gear ripples at all joints, each too small to be seen
    torques : the file shows measured joint torques; ratios_said : the cell gives the gear ratios
    grid : one joint stands at equal steps only
    """

    visit: str
    one_marker: bool
    background: bool
    torques: bool
    ratios_said: bool
    grid: bool


def draw_conditions(rng: np.random.Generator) -> RealConditions:
    """Each condition by itself, in fixed shares."""
    visit = str(rng.choice(list(READINGS), p=_VISITS))
    one_marker = rng.random() < 0.12
    low, high = _ONE_MARKER if one_marker and visit == "once" else _POSES[visit]
    missing = (None, "time", "temperature", "approach")[
        int(rng.choice(4, p=[0.7, 0.2, 0.05, 0.05]))
    ]
    return RealConditions(
        wrong_sigma=rng.random() < 0.10,
        outliers=rng.random() < 0.10,
        hidden=not one_marker and rng.random() < 0.15,
        configurations=int(rng.integers(low, high + 1)),
        known_geometry=rng.random() < 0.05,
        weighs=rng.random() > 0.10,
        payload=rng.random() < 0.35,
        missing=missing,
        range_noise=(None, "said", "unsaid")[int(rng.choice(3, p=[0.9, 0.05, 0.05]))],
        visit=visit,
        one_marker=one_marker,
        background=rng.random() < 0.5,
        torques=rng.random() < 0.3,
        ratios_said=rng.random() < 0.3,
        grid=rng.random() < 0.08,
    )


def draw_real_scene(rng: np.random.Generator, arm: Arm, conditions: RealConditions) -> Scene:
    """The arm's true parameters, the user's model of it, and the day; nothing scatters yet."""
    day = draw_day(
        rng,
        arm,
        conditions.visit,
        conditions.configurations,
        HELD_OUT,
        timed=conditions.missing != "time",
        known_start=conditions.missing != "approach",
        grid=conditions.grid,
    )
    scene = scene_of_session(rng, arm, conditions, day)
    if conditions.one_marker:
        scene = replace(scene, markers=scene.markers[:1], guesses=scene.guesses[:1])
    ratios = {j.name: int(rng.integers(*RATIO, endpoint=True)) for j in arm.joints if not j.slides}
    scene = replace(scene, ratios=ratios, ratios_said=conditions.ratios_said)
    return replace(scene, measured=_measured(rng, scene)) if conditions.torques else scene


def _measured(rng: np.random.Generator, scene: Scene) -> Array:
    """Torques as the drives show them, rounded as in the file: load, weight, friction, offset, noise.

    The links weigh here even where the user does not know it.
    """
    heavy = replace(scene, weighs=True)
    whole = Mechanism(scene.arm, scene.geometry, scene.markers)
    torque = at_rest(heavy, whole, ()).torque
    scale = np.maximum(np.sqrt(np.mean(torque**2, axis=0)), 1e-3)
    friction = rng.uniform(0.1, 0.4, scene.arm.dof) * scale * scene.session.approach
    offset = rng.normal(size=scene.arm.dof) * 0.1 * scale
    noise = rng.normal(size=torque.shape) * 0.03 * scale
    return np.asarray(np.round(torque + friction + offset + noise, 4) + 0.0)


SHARES = {"null": 0.20, "single": 0.34, "mixture": 0.20, "whole": 0.12, "outside": 0.14}
SCATTER = (0.3, 3.0)
"""3-D RMS of the arm's own scatter at the markers over the instrument's, even in the logarithm."""
MIXED = (3, 8)
WHOLE = ("backlash", "gear_ripple", "transmission_harmonic", "joint_compliance")
_BACKGROUND = (1.0, 20.0)  # noncentrality of each ripple of a background
_TOGETHER = (100.0, 6000.0)  # of a whole arm's family
# Of what size, SI, nothing is that anyone would believe: the length of all such parameters together.
_BELIEVED = {
    "gear_ripple": ({"cos_1", "sin_1", "cos_2", "sin_2"}, 300e-6),
    "warm_up": ({"offset", "rx", "ry", "rz"}, 1e-3),
    "step": ({"offset", "rx", "ry", "rz"}, 3e-3),
    "settling": ({"per_move", "per_speed"}, 2e-3),
    "backlash": ({"half_width"}, 1e-3),
    "thermal_expansion": ({"growth"}, 60e-6),
    "transmission_harmonic": ({"cos_1", "sin_1", "cos_2", "sin_2"}, 2e-3),
}
_TRIES = 8


def draw_real_case(rng: np.random.Generator, family: str) -> Case:
    """A case of one family."""
    while True:
        arm = draw_arm(rng)
        conditions = draw_conditions(rng)
        scene = draw_real_scene(rng, arm, conditions)
        if family == "whole":
            scene = replace(scene, compliance=scene.compliance * 0.0, modelled=(), knots={})
        try:
            return filled(rng, family, conditions, scene, _CAUSES)
        except NoSuchCase:
            continue


def plausible(
    draft: Draft, draw: Draw, within: tuple[float, float] = NONCENTRALITY, outside: bool = False
) -> Cause:
    """A cause of drawn noncentrality; others are tried where one cannot have it."""
    for _ in range(_TRIES):
        try:
            cause = sized(draft, draw, within, outside)
        except NoSuchCase:
            continue
        if not _too_rough(cause):
            return cause
    raise NoSuchCase


def filled(
    rng: np.random.Generator,
    family: str,
    conditions: RealConditions,
    scene: Scene,
    drawn_by: Mapping[str, Callable[[Draft], list[Cause]]],
) -> Case:
    """A scene with the causes of a family. Raises NoSuchCase."""
    try:
        draft = Draft(rng, conditions, scene, (SCATTER, 1.0))
        causes = drawn_by[family](draft)
        background = _background(draft, causes) if conditions.background else []
        return _case(draft, family, causes, background)
    except RuntimeError:  # too soft for its loads
        raise NoSuchCase from None


def _mixture(draft: Draft) -> list[Cause]:
    """Three to eight causes, each of a size of its own, no two of one kind at one place."""
    count, found = int(draft.rng.integers(*MIXED, endpoint=True)), dict[tuple[str, str], Cause]()
    for _ in range(4 * count):
        if len(found) == count:
            return list(found.values())
        cause = plausible(draft, draw_real)
        found.setdefault((cause.effect, cause.where), cause)
    raise NoSuchCase


def _whole(draft: Draft) -> list[Cause]:
    """The same kind at every joint, of one spread over the joints."""
    scene, rng = draft.scene, draft.rng
    found = all_places(scene)
    kind = str(rng.choice([kind for kind in WHOLE if len(found.get(kind, [])) > 2]))
    return sized_together(draft, [_member(rng, scene, kind, where) for where in found[kind]])


def sized_together(draft: Draft, drawn: Sequence[Cause]) -> list[Cause]:
    """Causes scaled alike until all together have a drawn noncentrality. Raises NoSuchCase."""
    scene, rng = draft.scene, draft.rng
    low, high = np.log(_TOGETHER)
    wanted = float(np.exp(rng.uniform(low, high)))
    for _ in range(3):
        rest = draft.rest(*drawn)
        factor = float(np.sqrt(wanted / max(float(rest @ rest), 1e-12)))
        drawn = [cause.sized(factor) for cause in drawn]
    moved = at_rest(scene, draft.mechanism, drawn).readings - draft.still.readings
    if np.sqrt(np.mean(np.sum(moved**2, axis=-1))) > scene.arm.largest or any(
        map(_too_rough, drawn)
    ):
        raise NoSuchCase
    return list(drawn)


def _member(rng: np.random.Generator, scene: Scene, kind: str, where: str) -> Cause:
    if kind == "gear_ripple":
        return cause_at(rng, scene, kind, where).sized(float(rng.lognormal(0.0, 0.4)))
    if kind == "backlash":
        return Cause(kind, where, {"half_width": 1e-4 * float(rng.normal())})
    if kind == "joint_compliance":
        typical = next(j.compliance for j in scene.arm.joints if j.name == where)
        return Cause(kind, where, {"compliance": typical * float(rng.lognormal(0.0, 0.5))})
    return Cause(kind, where, direction(rng, ("cos_1", "sin_1", "cos_2", "sin_2")))


_CAUSES: dict[str, Callable[[Draft], list[Cause]]] = {
    "null": lambda _: [],
    "single": lambda draft: [plausible(draft, draw_real)],
    "mixture": _mixture,
    "whole": _whole,
    "outside": lambda draft: [plausible(draft, draw_beyond, outside=True)],
}


def _background(draft: Draft, causes: list[Cause]) -> list[Cause]:
    """Fine ripples at the joints that have none of their own."""
    own = {c.where for c in causes if c.effect == "gear_ripple"}
    joints = [name for name in draft.scene.ratios if name not in own]
    return [plausible(draft, partial(_ripple_at, where=joint), _BACKGROUND) for joint in joints]


def _ripple_at(rng: np.random.Generator, scene: Scene, where: str) -> Cause:
    return cause_at(rng, scene, "gear_ripple", where)


def _too_rough(cause: Cause) -> bool:
    names, most = _BELIEVED.get(cause.effect, (set[str](), np.inf))
    own = [value * cause.size for name, value in cause.values.items() if name in names]
    return float(np.linalg.norm(own)) > most


def _case(draft: Draft, family: str, causes: list[Cause], background: list[Cause]) -> Case:
    everything = [*causes, *background]
    rests = [draft.rest(cause) for cause in everything]
    moves = [tangents(draft.scene, draft.mechanism, draft.still, cause) for cause in causes]
    spans = [projected(draft.projector, columns) for columns in moves]
    spans += [rest[:, None] for rest in rests[len(causes) :]]
    beside = beside_others(rests, spans)
    missed = _excess(draft, everything, moves, beside)
    return draft.case(family, causes, rests, beside, background, missed)


def _excess(
    draft: Draft, everything: list[Cause], moves: list[Array], beside: tuple[float, ...]
) -> float:
    """Of a fit that has the visible causes and no others."""
    seen = [b > VISIBLE for b, _ in zip(beside, moves, strict=False)]
    none = np.zeros((*draft.still.readings.shape, 0))
    columns = np.concatenate(
        [none, *(own for own, big in zip(moves, seen, strict=True) if big)], axis=-1
    )
    big = [cause for cause, visible in zip(everything, seen, strict=False) if visible]
    faint = [cause for cause in everything if cause not in big]
    unseen = at_rest(draft.scene, draft.mechanism, faint).readings - draft.still.readings
    return excess(draft.scene, draft.still, draft.projector, draft.seen, columns, unseen)
