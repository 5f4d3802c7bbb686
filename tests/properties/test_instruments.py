"""Every kind of instrument, and every effect that it may have: derivatives, rank, the bound reached."""

from __future__ import annotations

import numpy as np
import pytest

import calib
from calib import instruments
from calib.arrays import Array
from calib.effects import EFFECTS, ENDS
from calib.effects.tuned import Tuned
from calib.model import Model
from calib.poses import Poses
from calib.simulation import drawn_readings
from tests.helpers import central_difference
from tests.properties.every_instrument import scene

ALL = scene(3, 9)
KINDS = sorted({i.kind for i in ALL.context.instruments})
OFFSETS, TRUE = ("j2", "j4"), np.array([4e-4, -7e-4])  # rad
_TRIALS = 4
RNG = np.random.default_rng
OF_PARTS = [
    (kind, where)
    for kind, effect in EFFECTS.items()
    for where in effect.places(ALL.context)
    if kind not in ENDS and ":" in where and not where.startswith("marker:")
]


def check(model: Model, poses: Poses, values: Array) -> Array:
    """The derivatives, which differences confirm."""
    readings, J = model.jacobian(values, poses)
    np.testing.assert_allclose(readings, model.predict(values, poses), rtol=1e-12, atol=1e-12)
    numeric = central_difference(lambda v: model.predict(v, poses), values, 1e-2 * model.sizes)
    scale = np.abs(J).max(axis=(0, 1, 2))
    noise = 1e-12 * np.abs(readings).max() / model.sizes
    assert (np.abs(J - numeric).max(axis=(0, 1, 2)) <= 1e-6 * scale + noise).all()
    return scale


def wandered(model: Model, values: Array, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return values + 0.3 * model.sizes * rng.normal(size=len(values)) * (model.sizes < 1.0)


def test_kinds_are_complete() -> None:
    """Whoever adds one puts it into the scene."""
    assert set(KINDS) == set(instruments.KINDS)


def test_parts_are_complete() -> None:
    assert {w for kind, w in OF_PARTS if kind == "step"} == {
        "camera:wall", "camera:eye", "board:plate", "board:tiles", "board:solid",
        "socket:nest", "socket:cup", "socket:cone", "pose:mocap", "distance:bar", "plane:table",
    }  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_of_a_kind(kind: str) -> None:
    """By places, markers, bodies and joints."""
    context = ALL.context
    arm = [EFFECTS["joint_offset"].at(context, j) for j in OFFSETS]
    tool = [EFFECTS["tool"].at(context, w) for w in EFFECTS["tool"].places(context)]
    model = ALL.model(*tool, *arm, of=kind)
    check(model, ALL.poses, wandered(model, ALL.at(model), 4))


# Distances, planes and sockets reach the bound by hand: tests/calib/test_instruments.py.
@pytest.mark.long
@pytest.mark.parametrize("kind", sorted({*KINDS} - {"distance", "plane", "socket"}))
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


@pytest.mark.parametrize(("kind", "where"), OF_PARTS, ids=lambda x: x)
def test_effects_of_parts(kind: str, where: str) -> None:
    """Beside unknown places, free markers, bodies and joints, and the same part moved once more."""
    context = ALL.context
    effect = EFFECTS[kind].at(context, where)
    if isinstance(effect, Tuned):
        effect = effect.tuned(4.5e3)
    arm = [EFFECTS["joint_offset"].at(context, j) for j in ("j2", "j4")]
    tool = [EFFECTS["tool"].at(context, w) for w in EFFECTS["tool"].places(context)]
    again = [] if kind == "step" else [EFFECTS["step"].at(context, where)]
    model = ALL.model(*tool, *arm, effect, *again)
    values = wandered(model, ALL.at(model), 5)
    scale = check(model, ALL.poses, values)
    own = slice(model.slices[-1 - len(again)].start, None)
    still = model.still - own.start
    assert (np.delete(scale[own], still[still >= 0]) > 0.0).all()


def test_trials_are_independent() -> None:
    context = ALL.context
    effects = [EFFECTS[kind].at(context, where) for kind, where in OF_PARTS]
    model = ALL.model(*effects)
    trials = np.stack([wandered(model, ALL.at(model), seed) for seed in range(3)])
    together, J = model.jacobian(trials, ALL.poses)
    for i, values in enumerate(trials):
        alone, J_alone = model.jacobian(values, ALL.poses)
        np.testing.assert_allclose(together[i], alone, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(J[i], J_alone, rtol=1e-8, atol=1e-9 * np.abs(J_alone).max())
