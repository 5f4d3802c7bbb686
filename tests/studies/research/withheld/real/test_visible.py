"""Noncentralities of a key against a Monte Carlo of the linear problem, written out densely."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag

from calib.arrays import Array

pytest.importorskip("mujoco")

from studies.research.withheld import real_arms
from studies.research.withheld.causes import Cause
from studies.research.withheld.draw import Case
from studies.research.withheld.keys import key_of
from studies.research.withheld.real_arms import RealConditions
from studies.research.withheld.robots import HEAVY
from studies.research.withheld.scene import Scene, Wander
from studies.research.withheld.visible import Acting, Projector, at_rest, beside_others, excess
from tests.studies.research.withheld.scenes import PLAIN

STEP = 1e-4
DRAWS = 300
TUNED = ("cycles", "tau", "at")


@pytest.fixture(scope="module")
def case() -> Case:
    """Three causes on a heavy arm of free geometry, read at sixteen configurations."""
    plain = {**PLAIN.__dict__, "known_geometry": False, "configurations": 16, "payload": False}
    small = RealConditions(
        **plain,
        visit="free and loaded",
        one_marker=False,
        background=False,
        torques=False,
        ratios_said=False,
        grid=False,
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(real_arms, "draw_conditions", lambda rng: small)
        patch.setattr(real_arms, "draw_arm", lambda rng: replace(HEAVY, spring=None))
        patch.setattr(real_arms, "MIXED", (3, 3))
        patch.setattr(real_arms, "HELD_OUT", 4)
        return real_arms.draw_real_case(np.random.default_rng(8), "mixture")


def readings(case: Case, *causes: Acting, scene: Scene | None = None) -> Array:
    """All readings of a scene in a row."""
    own = case.scene if scene is None else scene
    return np.asarray(at_rest(own, own.mechanism(), causes).readings.ravel())


def rows(case: Case, held: bool) -> NDArray[np.bool_]:
    """Those of the poses that are fitted, or held out."""
    return np.repeat(case.seen & (case.scene.session.held[:, None] == held), 3)


def model_columns(case: Case) -> Array:
    """Derivatives by base, every frame, markers and compliances: the simulator displaced each way."""
    scene, found = case.scene, []

    def slope(change: str, value: Array, unit: float) -> None:
        plus = replace(scene, **{change: getattr(scene, change) + value})
        minus = replace(scene, **{change: getattr(scene, change) - value})
        ends = [readings(case, scene=one) for one in (plus, minus)]
        found.append((ends[0] - ends[1]) / (2 * unit))

    for change, shape in (("geometry", scene.geometry.shape), ("markers", scene.markers.shape)):
        for at in np.ndindex(shape):
            value = np.zeros(shape)
            value[at] = STEP
            slope(change, value, STEP)
    for name in scene.modelled:
        value = np.zeros(scene.arm.dof)
        value[scene.arm.names.index(name)] = 1e-8
        slope("compliance", value, 1e-8)
    return np.stack(found, axis=1)


def cause_columns(case: Case, cause: Cause) -> Array:
    """Derivatives by each linear parameter of one cause, its tuning known."""
    tuned = {n: v for n, v in cause.values.items() if n in TUNED}
    names = [n for n in cause.values if n not in TUNED]
    still, found = readings(case), []
    for name in names:
        values = {**dict.fromkeys(names, 0.0), **tuned, name: cause.values[name] * cause.size}
        found.append(readings(case, Cause(cause.effect, cause.where, values)) - still)
    return np.stack(found, axis=1)


def root_of_covariance(case: Case) -> Array:
    """Noise of each reading, and what an approach shares: free and loaded follow each other."""
    scene = case.scene
    assert scene.scatter is not None
    n, count = scene.arm.dof, scene.count
    columns = []
    for k, std in enumerate(scene.scatter.std):
        unit = np.zeros((count, n + 6))
        unit[:, k] = STEP
        ends = [readings(case, Wander(s * unit[:, :n], s * unit[:, n:])) for s in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2 * STEP) * std)
    own = np.stack(columns, axis=1)[rows(case, held=False)]
    A = own.reshape(-1, 2, 3 * len(scene.markers), n + 6)
    stays = [block.reshape(-1, n + 6) for block in A]
    return np.asarray(
        block_diag(
            *(np.linalg.cholesky(B @ B.T + scene.noise.sigma**2 * np.eye(len(B))) for B in stays)
        )
    )


def residual(columns: Array, rows: Array) -> tuple[Array, int]:
    """Sums of squares that columns leave of each row, and their rank.

    What moves the arm by less than a thousandth of the others only shifts loads: it would take metres.
    """
    scaled = columns / np.linalg.norm(columns, axis=0)
    U, s, _ = np.linalg.svd(scaled, full_matrices=False)
    U = U[:, s > 1e-3 * s[0]]
    return np.asarray(np.sum(rows**2, axis=1) - np.sum((rows @ U) ** 2, axis=1)), U.shape[1]


def gain(less: Array, more: Array, rows: Array) -> tuple[float, int]:
    """Mean of chi-square that the further columns gain, and how many there are."""
    before, p = residual(less, rows)
    after, q = residual(np.hstack([less, more]), rows)
    return float(np.mean(before - after)), q - p


@dataclass(frozen=True)
class Linear:
    """The linear problem: what whitens the fit, and columns at all readings."""

    white: Array
    model: Array
    causes: list[Array]


@pytest.fixture(scope="module")
def linear(case: Case) -> Linear:
    white = np.linalg.inv(root_of_covariance(case))
    return Linear(white, model_columns(case), [cause_columns(case, c) for c in case.causes])


@pytest.mark.long
def test_gains_of_simulated_data(case: Case, linear: Linear) -> None:
    """Chi-square gained by a cause has the mean: parameters + noncentrality, beside others or alone."""
    key, own = key_of(case, "case", 0, "salt"), rows(case, held=False)
    J = linear.white @ linear.model[own]
    T = [linear.white @ columns[own] for columns in linear.causes]
    noise = np.random.default_rng(0).normal(size=(DRAWS, len(J)))

    def shift(*causes: Cause) -> Array:
        return np.asarray(linear.white @ (readings(case, *causes) - readings(case))[own])

    assert len(T) == len(key["effects"]) == 3
    for k, entry in enumerate(key["effects"]):
        others = [t for i, t in enumerate(T) if i != k]
        for name, less, moved in (
            ("beside", np.hstack([J, *others]), shift(*case.causes)),
            ("noncentrality", J, shift(case.causes[k])),
        ):
            mean, count = gain(less, T[k], noise + moved)
            expected = count + entry[name]
            spread = np.sqrt(2.0 * (count + 2.0 * entry[name]) / DRAWS)
            assert abs(mean - expected) < 4.0 * spread + 0.01 * expected, (name, entry["effect"])
        assert entry["beside"] <= entry["noncentrality"] * 1.001


@pytest.mark.long
@pytest.mark.parametrize("visible", [3, 2])
def test_what_a_fit_leaves(case: Case, linear: Linear, visible: int) -> None:
    """Held-out errors of three thousand fits of what is visible, beside what is too faint."""
    scene, (fit, held) = case.scene, (rows(case, held=h) for h in (False, True))
    columns = np.hstack([linear.model, *linear.causes[:visible]])
    J = linear.white @ columns[fit]
    lengths = np.linalg.norm(J, axis=0)
    back = np.linalg.pinv(J / lengths, rcond=1e-3) / lengths[:, None]
    faint = readings(case, *case.causes[visible:]) - readings(case)
    noise = np.random.default_rng(1).normal(size=(3000, len(J)))
    wrong = (noise + linear.white @ faint[fit]) @ back.T @ columns[held].T - faint[held]
    still = at_rest(scene, scene.mechanism(), ())
    seen = case.seen & ~scene.session.held[:, None]
    found = excess(
        scene,
        still,
        Projector(scene, still, seen),
        case.seen,
        np.hstack(linear.causes[:visible]).reshape(*still.readings.shape, -1),
        faint.reshape(still.readings.shape),
    )
    assert found == pytest.approx(3.0 * np.mean(wrong**2), rel=0.05)
    if visible == 3:
        assert min(case.beside) > 60.0
        reached = np.hypot(key_of(case, "case", 0, "salt")["floor_mm"], 1e3 * np.sqrt(found))
        assert key_of(case, "case", 0, "salt")["reachable_mm"] == pytest.approx(reached, rel=1e-3)


def test_beside_others_by_hand() -> None:
    """Three displacements in the plane and out of it; one of them is a sum of what others can do."""
    x, y, z = np.eye(3)
    rests = [3.0 * x, 4.0 * (x + y), 5.0 * (y + z)]
    spans = [np.stack([x, z], axis=1), rests[1][:, None], rests[2][:, None]]
    # The second and third span a plane with normal (1, -1, 1); the first and third span all but none.
    found = beside_others(rests, spans)
    assert found == pytest.approx((9.0 / 3.0, 0.0, 0.0), abs=1e-12)
    assert beside_others([2.0 * x], [x[:, None]]) == (4.0,)
