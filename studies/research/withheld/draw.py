"""Drawing a case: the scene and its conditions, the causes, and their sizes by noncentrality."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from studies.research.withheld.causes import Cause, draw_cause, draw_outside, with_wrong_shape
from studies.research.withheld.robots import ARMS, Arm, Array
from studies.research.withheld.scene import RATIO, Noise, Scene, growing, scatter_of
from studies.research.withheld.session import Session, draw_session
from studies.research.withheld.truth import Mechanism, State
from studies.research.withheld.visible import Projector, at_rest, given

SHARES = {"null": 0.25, "single": 0.35, "pair": 0.13, "shape": 0.13, "outside": 0.14}
NONCENTRALITY = (20.0, 3000.0)
HELD_OUT = 20
_SIZE_ROUNDS = 4
_SCATTER = (RATIO, 0.5)


class NoSuchCase(Exception):
    """A cause that cannot be made as visible as drawn without being absurd."""


@dataclass(frozen=True)
class Conditions:
    """What makes a case hard, apart from its cause.

    range_noise : None, or whether the cell says that the noise grows with range: "said", "unsaid"
    """

    wrong_sigma: bool
    outliers: bool
    hidden: bool
    configurations: int
    known_geometry: bool
    weighs: bool
    payload: bool
    missing: str | None
    range_noise: str | None


EASY = Conditions(
    wrong_sigma=False,
    outliers=False,
    hidden=False,
    configurations=45,
    known_geometry=False,
    weighs=True,
    payload=False,
    missing=None,
    range_noise=None,
)
"""Nothing that makes a case hard."""


@dataclass(frozen=True, eq=False)
class Case:
    """A scene, its causes, and what the instrument reads.

    noncentrality, beside : of each cause alone, and with the other one taken out
    clean, noisy : ndarray, shape (N, M, 3), m, instrument frame, without and with noise and scatter
    seen : ndarray of bool, shape (N, M)
    outliers : names of poses with gross errors
    moved : m, RMS of what the causes do
    background : how many of the causes, the last ones, are too small to be asked for
    excess : m^2, by which a fit of the visible causes errs at held-out poses, None where not asked
    """

    family: str
    conditions: Conditions
    scene: Scene
    causes: tuple[Cause, ...]
    noncentrality: tuple[float, ...]
    beside: tuple[float, ...]
    together: float
    state: State
    clean: Array
    noisy: Array
    seen: NDArray[np.bool_]
    outliers: tuple[str, ...] = field(default=())
    moved: float = 0.0
    background: int = 0
    excess: float | None = None


def draw_case(rng: np.random.Generator, family: str, arm_noise: bool = False) -> Case:
    """A case of one family; arm_noise : of an arm that scatters from approach to approach."""
    while True:
        arm = ARMS[int(rng.integers(len(ARMS)))]
        conditions = _conditions(rng)
        scene = draw_scene(rng, arm, conditions)
        try:
            return _filled(Draft(rng, conditions, scene, _SCATTER if arm_noise else None), family)
        except NoSuchCase:
            continue


def _conditions(rng: np.random.Generator) -> Conditions:
    missing = str(rng.choice(["time", "temperature", "approach"]))
    return Conditions(
        wrong_sigma=rng.random() < 0.25,
        outliers=rng.random() < 0.15,
        hidden=rng.random() < 0.20,
        configurations=15 if rng.random() < 0.12 else 45,
        known_geometry=rng.random() < 0.15,
        weighs=rng.random() > 0.08,
        payload=rng.random() < 0.35,
        missing=missing if rng.random() < 0.15 else None,
        range_noise=(None, "said", "unsaid")[int(rng.choice(3, p=[0.85, 0.075, 0.075]))],
    )


def draw_scene(rng: np.random.Generator, arm: Arm, conditions: Conditions) -> Scene:
    """The arm's true parameters, the user's model of it, and the session."""
    session = draw_session(
        rng, arm, conditions.configurations, HELD_OUT, conditions.missing != "approach"
    )
    return scene_of_session(rng, arm, conditions, session)


def scene_of_session(
    rng: np.random.Generator, arm: Arm, conditions: Conditions, session: Session
) -> Scene:
    """The same about a session that was drawn."""
    geometry = np.zeros((arm.dof + 2, 6))
    if not conditions.known_geometry:
        geometry[1:, :3] = rng.normal(size=(arm.dof + 1, 3)) * 3e-4
        geometry[1:, 3:] = rng.normal(size=(arm.dof + 1, 3)) * 4e-4
    soft = np.flatnonzero([joint.compliance for joint in arm.joints])
    stiff = rng.permutation(soft)[: int(rng.choice(3, p=[0.5, 0.25, 0.25]))]
    compliance = np.array([j.compliance for j in arm.joints]) * rng.lognormal(0.0, 0.25, arm.dof)
    compliance[stiff] = 0.0
    guesses = _markers(rng, arm)
    payload = round(float(rng.uniform(0.3, 1.0)) * arm.payload, 2) if conditions.payload else 0.0
    com = np.round(rng.uniform(-0.4, 0.4, 3) * arm.tool, 4) if payload else np.zeros(3)
    knots = {}
    if rng.random() < 0.7:
        # Rounded as the cell shows them.
        knots = {
            joint.name: np.radians(np.round(np.degrees(np.linspace(joint.low, joint.high, 5)), 4))
            for joint in arm.joints
            if not joint.slides
        }
    stated = growing(rng, arm.sigma) if conditions.range_noise else Noise.uniform(arm.sigma)
    R = Rotation.random(rng=rng).as_matrix()
    away = rng.normal(size=3)
    return Scene(
        arm=arm,
        session=session,
        geometry=geometry,
        markers=guesses + rng.normal(size=guesses.shape) * 1e-3,
        guesses=guesses,
        compliance=compliance,
        modelled=tuple(arm.names[k] for k in soft if compliance[k]),
        known_geometry=conditions.known_geometry,
        weighs=conditions.weighs,
        payload=payload,
        com=com,
        columns=frozenset({"time", "temperature", "approach"} - {conditions.missing or ""}),
        knots=knots,
        noise=stated.times(1.5) if conditions.wrong_sigma else stated,
        believed=Noise.uniform(arm.sigma) if conditions.range_noise == "unsaid" else stated,
        R=R,
        p=float(rng.uniform(3.0, 6.0)) * away / np.linalg.norm(away),
        wrench=_wrench(arm, session),
    )


def _markers(rng: np.random.Generator, arm: Arm) -> Array:
    """Three or four reflectors about the tool, well out of line, mm as the cell shows them."""
    count = int(rng.choice([3, 4], p=[0.8, 0.2]))
    turn = rng.uniform(0, 2 * np.pi) + np.arange(count) * 2 * np.pi / count
    across = np.stack([np.cos(turn), np.sin(turn)], axis=1) * rng.uniform(0.3, 0.6)
    along = rng.uniform(0.6, 1.1, (count, 1))
    found: Array = np.round(np.hstack([across, along]) * arm.tool, 4)
    return found


def _wrench(arm: Arm, session: Session) -> Array:
    """Hung load about the nominal tip's origin, as a force sensor would give it, base axes, (N, 6)."""
    mechanism = Mechanism(arm, np.zeros((arm.dof + 2, 6)), np.zeros((1, 3)), weighs=False)
    R = mechanism.posed(session.q).R_link[:, -1]
    moment = np.cross(R @ session.hang, session.force)
    wrench: Array = np.hstack([session.force, moment]).round(4) + 0.0  # no minus zeros
    return wrench


def with_scatter(
    rng: np.random.Generator,
    scene: Scene,
    still: State,
    ratio: tuple[float, float],
    in_joints: float,
) -> Scene:
    """The scene with an arm that scatters by a ratio to the instrument; the cell may say it.

    in_joints : share of the arms that scatter in their joints, the others at the tip
    """
    shape = scatter_of(rng, scene.arm, still, in_joints=rng.random() < in_joints)
    everywhere = np.ones(still.readings.shape[:2], dtype=bool)
    wanted = np.exp(rng.uniform(*np.log(ratio))) * scene.noise.rms(still.readings, everywhere)
    reached = np.sqrt(np.mean(shape.squares(scene.arm, still)))
    scatter = shape.times(float(wanted / reached))
    said = scatter.repeatability(scene.arm, still) if rng.random() < 0.5 else None
    return replace(scene, scatter=scatter, repeatability=said)


class Draft:
    """A scene at rest, and how to measure what moves it.

    scatter : ratio to the instrument's noise, and share of arms that scatter in their joints; None of
        an arm that comes back exactly
    """

    def __init__(
        self,
        rng: np.random.Generator,
        conditions: Conditions,
        scene: Scene,
        scatter: tuple[tuple[float, float], float] | None,
    ) -> None:
        self.rng, self.conditions, self.mechanism = rng, conditions, scene.mechanism()
        self.seen = draw_seen(rng, conditions, scene)
        self.still = at_rest(scene, self.mechanism, ())
        self.scene = with_scatter(rng, scene, self.still, *scatter) if scatter else scene
        self.projector = Projector(self.scene, self.still, self.seen & ~scene.session.held[:, None])

    def rest(self, *causes: Cause) -> Array:
        """What causes move, whitened and beside the model."""
        bent = at_rest(self.scene, self.mechanism, causes)
        return self.projector.left(bent.readings - self.still.readings)

    def case(
        self,
        family: str,
        causes: Sequence[Cause],
        rests: Sequence[Array],
        beside: tuple[float, ...],
        background: Sequence[Cause] = (),
        excess: float | None = None,
    ) -> Case:
        """What the instrument reads.

        rests : of each cause and of the background after them; beside : their noncentralities beside
            the others
        """
        everything, session = [*causes, *background], self.scene.session
        state = at_rest(self.scene, self.mechanism, everything)
        whole, stood = self.rest(*causes), state
        if self.scene.scatter is not None:
            wander = self.scene.scatter.drawn(self.rng, session.visit)
            stood = at_rest(self.scene, self.mechanism, [*everything, wander])
        noisy, outliers = with_noise(self.rng, self.conditions, self.scene, stood.readings)
        shift = state.readings - self.still.readings
        return Case(
            family=family,
            conditions=self.conditions,
            scene=self.scene,
            causes=tuple(everything),
            noncentrality=tuple(float(r @ r) for r in rests),
            beside=beside,
            together=float(whole @ whole),
            state=state,
            clean=state.readings,
            noisy=noisy,
            seen=self.seen,
            outliers=outliers,
            moved=float(np.sqrt(np.mean(np.sum(shift**2, axis=-1)))),
            background=len(background),
            excess=excess,
        )


def _filled(draft: Draft, family: str) -> Case:
    causes = [sized(draft, draw, outside=family == "outside") for draw in _DRAWS[family]]
    if len({(c.effect, c.where) for c in causes}) < len(causes):
        raise NoSuchCase
    rests = [draft.rest(cause) for cause in causes]
    beside = tuple(float(r @ r) for r in rests)
    if len(rests) == 2:
        beside = (given(*rests), given(*rests[::-1]))
    return draft.case(family, causes, rests, beside)


Draw = Callable[[np.random.Generator, Scene], Cause]


def _misshapen(rng: np.random.Generator, scene: Scene) -> Cause:
    cause = draw_cause(rng, scene)
    if cause.effect in ("joint_offset", "link_geometry", "joint_compliance"):
        raise NoSuchCase  # of another shape they are other effects of the catalogue
    return with_wrong_shape(rng, scene, cause)


_DRAWS: dict[str, tuple[Draw, ...]] = {
    "null": (),
    "single": (draw_cause,),
    "pair": (draw_cause, draw_cause),
    "shape": (_misshapen,),
    "outside": (draw_outside,),
}


def sized(
    draft: Draft, draw: Draw, within: tuple[float, float] = NONCENTRALITY, outside: bool = False
) -> Cause:
    """A cause scaled to a noncentrality drawn evenly in its logarithm. Raises NoSuchCase."""
    scene = draft.scene
    cause = draw(draft.rng, scene)
    low, high = np.log(within)
    wanted = float(np.exp(draft.rng.uniform(low, high)))
    for _ in range(_SIZE_ROUNDS):
        try:
            moved = at_rest(scene, draft.mechanism, [cause]).readings - draft.still.readings
        except RuntimeError:
            raise NoSuchCase from None
        rest = draft.projector.left(moved)
        reached = float(rest @ rest)
        largest = float(np.sqrt(np.mean(np.sum(moved**2, axis=-1))))
        factor = np.sqrt(wanted / max(reached, 1e-12))
        if largest * factor > scene.arm.largest or absurd(scene, cause, cause.size * factor):
            raise NoSuchCase
        if abs(factor - 1.0) < 0.01:
            return cause
        cause = cause.sized(float(factor))
    if outside or abs(factor - 1.0) < 0.05:
        return cause
    raise NoSuchCase


_LARGEST = {
    "thermal_expansion": {"growth": 4e-4},
    "tool_compliance": {"x": 1e-6, "y": 1e-6, "z": 1e-6, "rx": 1e-4, "ry": 1e-4, "rz": 1e-4},
    "joint_compliance": {"compliance": 3e-4},
    "backlash": {"half_width": 2e-3},
    "transmission_harmonic": dict.fromkeys(("cos_1", "sin_1", "cos_2", "sin_2"), 2e-3),
}
"""Some ten times what arms show, SI. An arm that scatters hides smaller ones: without a bound a cause
that is to be seen beside it grows beyond anything that a diagnosis should believe."""


def absurd(scene: Scene, cause: Cause, size: float) -> bool:
    """Masses and compliances below nothing, sizes far from what anyone would believe."""
    values = {name: size * value for name, value in cause.values.items()}
    most = _LARGEST.get(cause.effect, {})
    if any(abs(value) > most[name] for name, value in values.items() if name in most):
        return True
    if cause.effect == "link_weight":
        own = float(scene.arm.masses[scene.arm.names.index(cause.where)])
        return abs(values["mass"]) > 0.6 * own
    if cause.effect == "payload":
        com = max(abs(values.get(f"com_{c}", 0.0)) for c in "xyz")
        mass = abs(values.get("mass", 0.0)) / max(scene.payload, 1e-9)
        return abs(values.get("scale", 0.0)) > 0.5 or mass > 0.9 or com > scene.arm.tool
    if cause.effect == "gravity_sag":
        return values["weight"] > 2.0
    if cause.effect == "stiffness_vs_angle":
        k = scene.arm.names.index(cause.where)
        return bool(min(values.values()) < -0.9 * scene.compliance[k])
    return False


def draw_seen(rng: np.random.Generator, conditions: Conditions, scene: Scene) -> NDArray[np.bool_]:
    """Which markers the instrument saw, shape (N, M); one at least of each reading."""
    seen = np.ones((scene.count, len(scene.markers)), dtype=bool)
    if conditions.hidden:
        seen = rng.random(seen.shape) > 0.10
        seen[~seen.any(axis=1), 0] = True
    return seen


def with_noise(
    rng: np.random.Generator, conditions: Conditions, scene: Scene, clean: Array
) -> tuple[Array, tuple[str, ...]]:
    """Normal noise, and gross errors in 3 % of the fitted poses: one reflector, or all alike."""
    noisy = clean + scene.noise.coloured(rng.normal(size=clean.shape), clean)
    if not conditions.outliers:
        return noisy, ()
    fitted = np.flatnonzero(~scene.session.held)
    chosen = np.sort(rng.choice(fitted, max(1, round(0.03 * len(fitted))), replace=False))
    for pose in chosen:
        jump = rng.normal(size=3)
        jump *= rng.uniform(20.0, 100.0) * scene.noise.sigma / np.linalg.norm(jump)
        which = slice(None) if rng.random() < 0.5 else int(rng.integers(clean.shape[1]))
        noisy[pose, which] += jump
    return noisy, tuple(scene.session.names[i] for i in chosen)
