"""Every effect and every kind of instrument: derivatives, rank, and the bound reached."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import instruments
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.effects import EFFECTS, ENDS, Context
from calib.effects.protocol import Effect, LoadEffect
from calib.effects.tuned import Tuned
from calib.model import Model
from calib.poses import Poses
from calib.simulation import drawn_readings
from tests.helpers import central_difference, model_of, random_context, random_poses, random_robot
from tests.properties.every_instrument import scene

RNG = np.random.default_rng
ALL = scene(3, 9)
KINDS = sorted({i.kind for i in ALL.context.instruments})
OFFSETS, TRUE = ("j2", "j4"), np.array([4e-4, -7e-4])  # rad
_TRIALS = 4


def confirmed(model: Model, poses: Poses, values: Array, rounding: float) -> Array:
    """How much each value moves at most, by derivatives that differences confirm.

    rounding : of a reading over the step, which limits what differences can show
    """
    readings, J = model.jacobian(values, poses)
    np.testing.assert_allclose(readings, model.predict(values, poses), rtol=1e-12, atol=1e-12)
    numeric = central_difference(lambda v: model.predict(v, poses), values, 1e-2 * model.sizes)
    largest = np.abs(J).max(axis=(0, 1, 2))
    off = np.abs(J - numeric).max(axis=(0, 1, 2))
    assert (off <= 1e-6 * largest + rounding / model.sizes).all()
    return largest


def smooth(model: Model) -> Array:
    """Which values readings follow: by the moment of a step, or a lag, they have no derivative."""
    return ~np.isin(np.arange(len(model.parameters)), model.still)


# -- Effects of an arm that a tracker reads; those of other instruments follow

ANY = random_context(RNG(0), random_robot(RNG(0), 6))
ON_ARM = {kind: effect for kind, effect in EFFECTS.items() if effect.places(ANY)}
SOFT = ["joint_compliance", "tool_compliance"]  # without these, loads move nothing
NANOMETRE = 1e-9  # of an equilibrium, over a step of a hundredth of a size


@pytest.mark.parametrize("kind", [*ON_ARM, "all"])
@pytest.mark.parametrize(("dof", "prismatic"), [(6, ()), (4, (1,)), (2, (0,))])
def test_derivatives_of_effects(kind: str, dof: int, prismatic: tuple[int, ...]) -> None:
    rng = RNG(dof)
    robot = random_robot(rng, dof, prismatic)
    context, poses = random_context(rng, robot), random_poses(rng, robot, 12)
    soft = SOFT if kind != "all" and issubclass(EFFECTS[kind], LoadEffect) else []
    model = model_of(context, list(ON_ARM) if kind == "all" else [kind, *soft])
    values = model.initial + model.sizes * rng.normal(size=len(model.sizes))
    largest = confirmed(model, poses, values, NANOMETRE)
    assert (largest > 0.0)[smooth(model)].all(), "every parameter must move a marker here"


@pytest.mark.parametrize("payload", [Payload(), Payload(0.0, (0.1, 0.0, 0.2))])
@pytest.mark.parametrize(
    ("measured", "names"), [(True, ["scale", "com_x", "com_y", "com_z"]), (False, ["mass"])]
)
def test_derivatives_of_an_unknown_load(payload: Payload, measured: bool, names: list[str]) -> None:
    """Where no payload is given: the scale of the measured wrench, or a body nobody wrote down."""
    rng = RNG(1)
    robot = random_robot(rng, 5, (2,))
    context = replace(random_context(rng, robot), payload=payload, measured_load=measured)
    model, poses = model_of(context, ["payload", *SOFT]), random_poses(rng, robot, 12)
    assert [p.name for p in model.parameters if p.effect == "payload"] == names
    values = model.sizes * rng.normal(size=len(model.parameters))
    assert (confirmed(model, poses, values, NANOMETRE) > 0.0)[smooth(model)].all()


# -- Kinds of instruments, and effects of their parts

# At each part one effect at least, a step.
OF_PARTS = [
    (kind, where)
    for kind, effect in EFFECTS.items()
    for where in effect.places(ALL.context)
    if kind not in ENDS and ":" in where and not where.startswith("marker:")
]


def test_kinds_and_parts_are_complete() -> None:
    """Whoever adds one puts it into the scene."""
    assert set(KINDS) == set(instruments.KINDS)
    assert {w for kind, w in OF_PARTS if kind == "step"} == {
        "camera:wall", "camera:eye", "board:plate", "board:tiles", "board:solid",
        "socket:nest", "socket:cup", "socket:cone", "pose:mocap", "distance:bar", "plane:table",
    }  # fmt: skip


def wandered(model: Model, seed: int) -> Array:
    """Values about those of instruments where they stand."""
    values = ALL.at(model)
    return values + 0.3 * model.sizes * RNG(seed).normal(size=len(values)) * (model.sizes < 1.0)


def confirmed_there(model: Model, seed: int) -> Array:
    values = wandered(model, seed)
    rounding = 1e-12 * np.abs(model.predict(values, ALL.poses)).max()
    return confirmed(model, ALL.poses, values, float(rounding))


def free_arm(context: Context) -> list[Effect]:
    offsets = [EFFECTS["joint_offset"].at(context, j) for j in OFFSETS]
    return [*model_of(context, ["tool"]).effects, *offsets]


@pytest.mark.parametrize(("kind", "free"), [*((kind, False) for kind in KINDS), ("camera", True)])
def test_derivatives_of_a_kind(kind: str, free: bool) -> None:
    """By places, markers, bodies and joints, and by a lens that is free."""
    here = scene(3, 9, free)
    confirmed_there(here.model(*free_arm(here.context), of=kind), 4)


@pytest.mark.parametrize(("kind", "where"), OF_PARTS, ids=lambda x: x)
def test_derivatives_of_effects_of_parts(kind: str, where: str) -> None:
    """Beside unknown places, free markers, bodies and joints, and the same part moved once more."""
    effect = EFFECTS[kind].at(ALL.context, where)
    if isinstance(effect, Tuned):
        effect = effect.tuned(4.5e3)
    again = [] if kind == "step" else [EFFECTS["step"].at(ALL.context, where)]
    model = ALL.model(*free_arm(ALL.context), effect, *again)
    own = slice(model.slices[-1 - len(again)].start, None)
    assert (confirmed_there(model, 5)[own] > 0.0)[smooth(model)[own]].all()


# The others reach the bound by hand: tests/calib/test_instruments.py.
@pytest.mark.long
@pytest.mark.parametrize("kind", ["camera", "pose"])
def test_the_bound_of_a_kind_is_reached(kind: str) -> None:
    """Full rank without a guess; errors scatter as the inverse of the information says."""
    here = scene(8, 25)
    arm = [EFFECTS["joint_offset"].at(here.context, j) for j in OFFSETS]
    true = here.model(*arm, of=kind)
    values = here.at(true)
    values[-len(TRUE) :] = TRUE
    cell, rng, total = here.cell(kind, "base", f"joint_offset:{','.join(OFFSETS)}"), RNG(7), 0.0
    for _ in range(_TRIALS):
        data = drawn_readings(true, values, here.poses, None, rng)
        found = calib.identify(cell, data)
        assert found.rank == len(values) == len(found.model.parameters)
        own = [p.id for p in found.model.parameters]
        at = [own.index(p.id) for p in true.parameters]
        off = found.values[at] - values
        covariance = found.covariance[np.ix_(at, at)] / found.noise.factor**2
        total += float(off @ np.linalg.solve(covariance, off))
    dof = _TRIALS * len(values)
    assert total == pytest.approx(dof, abs=4.0 * np.sqrt(2.0 * dof))


@pytest.mark.parametrize("read", ["arm", "parts"])
def test_trials_are_independent(read: str) -> None:
    """Several sets of values at once are as each alone."""
    if read == "parts":
        model = ALL.model(*(EFFECTS[kind].at(ALL.context, where) for kind, where in OF_PARTS))
        poses, trials = ALL.poses, np.stack([wandered(model, seed) for seed in range(3)])
    else:
        rng = RNG(5)
        robot = random_robot(rng, 5)
        model = model_of(random_context(rng, robot), list(EFFECTS))
        poses = random_poses(rng, robot, 3)
        trials = model.initial + model.sizes * rng.normal(size=(4, len(model.parameters)))
    together, J = model.jacobian(trials, poses)
    for i, values in enumerate(trials):
        alone, J_alone = model.jacobian(values, poses)
        np.testing.assert_allclose(together[i], alone, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(J[i], J_alone, rtol=1e-8, atol=1e-9 * np.abs(J_alone).max())
