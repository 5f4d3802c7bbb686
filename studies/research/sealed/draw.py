"""Drawing a case: the scene, the causes of its family, and their sizes by noncentrality."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from studies.research.sealed.visible import Projector, beside_others, given, tangents
from studies.research.truth import foreign
from studies.research.truth.arms import ARMS, Array, Mask, draw_arm
from studies.research.truth.causes import (
    Cause,
    Draw,
    Unsuitable,
    absurd,
    cause_at,
    draw_beyond,
    draw_cause,
    draw_outside,
    draw_real,
    too_rough,
    with_wrong_shape,
)
from studies.research.truth.conditions import Conditions, draw_conditions, draw_real_conditions
from studies.research.truth.effects import HARMONICS, direction, places
from studies.research.truth.mechanism import State
from studies.research.truth.scene import Scene, at_rest, draw_scene, with_scatter

FIRST_SHARES = {"null": 0.25, "single": 0.35, "pair": 0.13, "shape": 0.13, "outside": 0.14}
REAL_SHARES = {"null": 0.20, "single": 0.34, "mixture": 0.20, "whole": 0.12, "outside": 0.14}
FOREIGN_SHARES = {"single": 0.5, "whole": 0.25, "mixture": 0.25}
NONCENTRALITY = (20.0, 3000.0)
_TOGETHER = (100.0, 6000.0)  # of a whole arm's family
_BACKGROUND = (1.0, 20.0)  # of each ripple of a background
# 3-D RMS of the arm's scatter at the markers over the instrument's, even in the logarithm, and share of
# the arms that scatter in their joints.
_ARM_NOISE, _REAL_NOISE = ((1.0, 3.0), 0.5), ((0.3, 3.0), 1.0)
MIXED = (3, 8)  # causes
WHOLE = ("backlash", "gear_ripple", "transmission_harmonic", "joint_compliance")
_FOREIGN_POSES, _FOREIGN_ONE_MARKER = (28, 60), 0.2
_SIZE_ROUNDS, _TRIES = 4, 8
Scattering = tuple[tuple[float, float], float]
"""Ratio to the instrument's noise, and share of arms that scatter in their joints."""


@dataclass(frozen=True, eq=False)
class Case:
    """A scene, its causes, and what the instrument reads.

    noncentrality, beside : of each cause alone, and with the other ones taken out
    clean, noisy : ndarray, shape (N, M, 3), m, instrument frame, without and with noise and scatter
    seen : ndarray of bool, shape (N, M); outliers : names of poses with gross errors
    background : how many of the causes, the last ones, are too small to be asked for
    """

    family: str
    scene: Scene
    causes: tuple[Cause, ...]
    noncentrality: tuple[float, ...]
    beside: tuple[float, ...]
    together: float
    state: State
    clean: Array
    noisy: Array
    seen: Mask
    outliers: tuple[str, ...] = ()
    background: int = 0


class Draft:
    """A scene at rest, and how to measure what moves it; without scatter the arm comes back exactly."""

    def __init__(self, rng: np.random.Generator, scene: Scene, scatter: Scattering | None) -> None:
        self.rng, self.mechanism = rng, scene.mechanism()
        self.seen = _seen(rng, scene)
        self.still = at_rest(scene, self.mechanism, ())
        self.scene = with_scatter(rng, scene, self.still, *scatter) if scatter else scene
        self.projector = Projector(self.scene, self.still, self.seen & ~scene.session.held[:, None])

    def moved(self, *causes: Cause) -> Array:
        """What causes do to the readings, (N, M, 3), m."""
        return at_rest(self.scene, self.mechanism, causes).readings - self.still.readings

    def rest(self, *causes: Cause) -> Array:
        """What of it is beside the model, whitened."""
        return self.projector.left(self.moved(*causes))

    def case(
        self,
        family: str,
        causes: Sequence[Cause],
        rests: Sequence[Array],
        beside: tuple[float, ...],
        background: Sequence[Cause] = (),
    ) -> Case:
        """What the instrument reads.

        rests : of each cause and of the background after them; beside : their noncentralities beside
            the others
        """
        everything, scene = [*causes, *background], self.scene
        state = reached = at_rest(scene, self.mechanism, everything)
        whole = self.rest(*causes)
        if scene.scatter is not None:
            wander = scene.scatter.drawn(self.rng, scene.session.visit)
            reached = at_rest(scene, self.mechanism, [*everything, wander])
        noisy, outliers = _with_noise(self.rng, scene, reached.readings)
        return Case(
            family=family,
            scene=scene,
            causes=tuple(everything),
            noncentrality=tuple(float(r @ r) for r in rests),
            beside=beside,
            together=float(whole @ whole),
            state=state,
            clean=state.readings,
            noisy=noisy,
            seen=self.seen,
            outliers=outliers,
            background=len(background),
        )


def _rms(moved: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(moved**2, axis=-1))))


def _seen(rng: np.random.Generator, scene: Scene) -> Mask:
    """Which markers the instrument saw, shape (N, M); one at least of each reading."""
    seen = np.ones((scene.count, len(scene.markers)), dtype=bool)
    if scene.conditions.hidden:
        seen = rng.random(seen.shape) > 0.10
        seen[~seen.any(axis=1), 0] = True
    return seen


def _with_noise(
    rng: np.random.Generator, scene: Scene, clean: Array
) -> tuple[Array, tuple[str, ...]]:
    """Normal noise, and gross errors in 3 % of the fitted poses: one reflector, or all alike."""
    noisy = clean + scene.noise.coloured(rng.normal(size=clean.shape), clean)
    if not scene.conditions.outliers:
        return noisy, ()
    fitted = np.flatnonzero(~scene.session.held)
    chosen = np.sort(rng.choice(fitted, max(1, round(0.03 * len(fitted))), replace=False))
    for pose in chosen:
        jump = rng.normal(size=3)
        jump *= rng.uniform(20.0, 100.0) * scene.noise.sigma / np.linalg.norm(jump)
        which = slice(None) if rng.random() < 0.5 else int(rng.integers(clean.shape[1]))
        noisy[pose, which] += jump
    return noisy, tuple(scene.session.names[i] for i in chosen)


# -- sizes -----------------------------------------------------------------------------------------


def _drawn_size(draft: Draft, within: tuple[float, float]) -> float:
    return float(np.exp(draft.rng.uniform(*np.log(within))))


def sized(
    draft: Draft, draw: Draw, within: tuple[float, float] = NONCENTRALITY, outside: bool = False
) -> Cause:
    """A cause scaled to a noncentrality drawn evenly in its logarithm. Raises Unsuitable."""
    cause, wanted = draw(draft.rng, draft.scene), _drawn_size(draft, within)
    for _ in range(_SIZE_ROUNDS):
        try:
            moved = draft.moved(cause)
        except RuntimeError:
            raise Unsuitable from None
        rest = draft.projector.left(moved)
        factor = float(np.sqrt(wanted / max(float(rest @ rest), 1e-12)))
        largest = _rms(moved) * factor > draft.scene.arm.largest
        if largest or absurd(draft.scene, cause, cause.size * factor):
            raise Unsuitable
        if abs(factor - 1.0) < 0.01:
            return cause
        cause = cause.sized(factor)
    if outside or abs(factor - 1.0) < 0.05:
        return cause
    raise Unsuitable


def plausible(
    draft: Draft, draw: Draw, within: tuple[float, float] = NONCENTRALITY, outside: bool = False
) -> Cause:
    """A cause of drawn noncentrality; others are tried where one cannot have it."""
    for _ in range(_TRIES):
        try:
            cause = sized(draft, draw, within, outside)
        except Unsuitable:
            continue
        if not too_rough(cause):
            return cause
    raise Unsuitable


def sized_together(draft: Draft, drawn: Sequence[Cause]) -> list[Cause]:
    """Causes scaled alike until all together have a drawn noncentrality. Raises Unsuitable."""
    wanted, causes = _drawn_size(draft, _TOGETHER), list(drawn)
    for _ in range(3):
        rest = draft.rest(*causes)
        factor = float(np.sqrt(wanted / max(float(rest @ rest), 1e-12)))
        causes = [cause.sized(factor) for cause in causes]
    if _rms(draft.moved(*causes)) > draft.scene.arm.largest or any(map(too_rough, causes)):
        raise Unsuitable
    return causes


# -- families --------------------------------------------------------------------------------------

Family = Callable[[Draft], list[Cause]]


def _misshapen(rng: np.random.Generator, scene: Scene) -> Cause:
    cause = draw_cause(rng, scene)
    if cause.effect in ("joint_offset", "link_geometry", "joint_compliance"):
        raise Unsuitable  # of another shape they are other effects of the catalogue
    return with_wrong_shape(rng, scene, cause)


_FIRST: dict[str, tuple[Draw, ...]] = {
    "null": (),
    "single": (draw_cause,),
    "pair": (draw_cause, draw_cause),
    "shape": (_misshapen,),
    "outside": (draw_outside,),
}


def _mixture(draft: Draft) -> list[Cause]:
    """Three to eight causes, each of a size of its own, no two of one kind at one place."""
    count, found = int(draft.rng.integers(*MIXED, endpoint=True)), dict[tuple[str, str], Cause]()
    for _ in range(4 * count):
        if len(found) == count:
            return list(found.values())
        cause = plausible(draft, draw_real)
        found.setdefault((cause.effect, cause.where), cause)
    raise Unsuitable


def _whole(draft: Draft) -> list[Cause]:
    """The same kind at every joint, of one spread over the joints."""
    found = places(draft.scene)
    kind = str(draft.rng.choice([kind for kind in WHOLE if len(found.get(kind, [])) > 2]))
    return sized_together(draft, [_member(draft, kind, where) for where in found[kind]])


def _member(draft: Draft, kind: str, where: str) -> Cause:
    rng, scene = draft.rng, draft.scene
    if kind == "gear_ripple":
        return cause_at(rng, scene, kind, where).sized(float(rng.lognormal(0.0, 0.4)))
    if kind == "backlash":
        return Cause(kind, where, {"half_width": 1e-4 * float(rng.normal())})
    if kind == "joint_compliance":
        typical = scene.arm.joints[scene.index(where)].compliance
        return Cause(kind, where, {"compliance": typical * float(rng.lognormal(0.0, 0.5))})
    return Cause(kind, where, direction(rng, HARMONICS))


_REAL: dict[str, Family] = {
    "null": lambda _: [],
    "single": lambda draft: [plausible(draft, draw_real)],
    "mixture": _mixture,
    "whole": _whole,
    "outside": lambda draft: [plausible(draft, draw_beyond, outside=True)],
}


def _foreign_whole(draft: Draft) -> list[Cause]:
    """The like at every joint that turns, some twice as large as others."""
    rng, scene = draft.rng, draft.scene
    kind = foreign.WHOLE[int(rng.integers(len(foreign.WHOLE)))]
    made = [kind(rng, scene, scene.index(name)) for name in scene.arm.turning]
    return sized_together(draft, [c.sized(float(rng.lognormal(0.0, 0.35))) for c in made])


def _foreign_mixture(draft: Draft) -> list[Cause]:
    family = _foreign_whole(draft)
    wheels = family[0].effect == "transmission_harmonic"
    further = (foreign.spring,) if wheels else (foreign.spring, foreign.wheel)
    return [*family, plausible(draft, partial(foreign.one_of, further))]


_FOREIGN: dict[str, Family] = {
    "single": lambda draft: [plausible(draft, partial(foreign.one_of, foreign.FORMULAS))],
    "whole": _foreign_whole,
    "mixture": _foreign_mixture,
}


# -- populations -----------------------------------------------------------------------------------


def _drawer(
    scene: Callable[[np.random.Generator, str], Scene],
    scatter: Scattering | None,
    case: Callable[[Draft, str], Case],
) -> Callable[[np.random.Generator, str], Case]:
    """What draws a case of a family, in the first scene that can have one."""

    def draw(rng: np.random.Generator, family: str) -> Case:
        while True:
            drawn = scene(rng, family)
            try:
                return case(Draft(rng, drawn, scatter), family)
            except (Unsuitable, RuntimeError):  # the latter: too soft for its loads
                continue

    return draw


def _usual(rng: np.random.Generator, _: str) -> Scene:
    arm = ARMS[int(rng.integers(len(ARMS)))]
    return draw_scene(rng, arm, draw_conditions(rng))


def _real(rng: np.random.Generator, family: str) -> Scene:
    arm = draw_arm(rng)
    scene = draw_scene(rng, arm, draw_real_conditions(rng))
    return scene.rigid() if family == "whole" else scene


def _strange(rng: np.random.Generator, _: str) -> Scene:
    arm = draw_arm(rng)
    conditions = Conditions(
        configurations=int(rng.integers(*_FOREIGN_POSES, endpoint=True)),
        visit="once",
        one_marker=rng.random() < _FOREIGN_ONE_MARKER,
    )
    return draw_scene(rng, arm, conditions)


def _first_case(draft: Draft, family: str) -> Case:
    causes = [sized(draft, draw, outside=family == "outside") for draw in _FIRST[family]]
    if len({(c.effect, c.where) for c in causes}) < len(causes):
        raise Unsuitable
    rests = [draft.rest(cause) for cause in causes]
    beside = tuple(float(r @ r) for r in rests)
    if len(rests) == 2:
        beside = (given(*rests), given(*rests[::-1]))
    return draft.case(family, causes, rests, beside)


def _real_case(families: Mapping[str, Family], draft: Draft, family: str) -> Case:
    causes = families[family](draft)
    background = _background(draft, causes) if draft.scene.conditions.background else []
    rests = [draft.rest(cause) for cause in [*causes, *background]]
    moves = [tangents(draft.scene, draft.mechanism, draft.still, cause) for cause in causes]
    spans = [draft.projector.span(columns) for columns in moves]
    beside = beside_others(rests, [*spans, *(rest[:, None] for rest in rests[len(causes) :])])
    return draft.case(family, causes, rests, beside, background)


def _background(draft: Draft, causes: list[Cause]) -> list[Cause]:
    """Fine ripples at the joints that have none of their own."""
    rippled = {c.where for c in causes if c.effect == "gear_ripple"}
    draws = [partial(cause_at, kind="gear_ripple", where=name) for name in draft.scene.ratios
             if name not in rippled]  # fmt: skip
    return [plausible(draft, draw, _BACKGROUND) for draw in draws]


draw_case = _drawer(_usual, None, _first_case)
draw_noisy_case = _drawer(_usual, _ARM_NOISE, _first_case)
"""Of the first families, and of arms that scatter between approaches."""
draw_real_case = _drawer(_real, _REAL_NOISE, partial(_real_case, _REAL))
"""Of arms as real ones are: they scatter, ripple, settle, from several causes at once."""
draw_foreign_case = _drawer(_strange, _REAL_NOISE, partial(_real_case, _FOREIGN))
"""Whose causes follow other formulas: one, one kind at all joints, or these and one more."""
