"""Noncentralities of a key against a Monte Carlo of the linear problem, written out densely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

pytest.importorskip("mujoco")

from studies.withheld.causes import Cause
from studies.withheld.draw import Case
from studies.withheld.keys import key_of
from studies.withheld.real import conditions as days
from studies.withheld.real import draw
from studies.withheld.real.conditions import RealConditions
from studies.withheld.real.visible import beside_others
from studies.withheld.robots import HEAVY, Array
from studies.withheld.scatter import Wander
from studies.withheld.visible import Acting, at_rest
from tests.studies.withheld.scenes import PLAIN

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
        patch.setattr(draw, "draw_conditions", lambda rng: small)
        patch.setattr(draw, "draw_arm", lambda rng: replace(HEAVY, spring=None))
        patch.setattr(draw, "MIXED", (3, 3))
        patch.setattr(days, "HELD_OUT", 4)
        return draw.draw_real_case(np.random.default_rng(8), "mixture")


def fitted(case: Case, *causes: Acting, scene: object = None) -> Array:
    """Readings of the poses that are fitted, in a row."""
    own = case.scene if scene is None else scene
    readings = at_rest(own, own.mechanism(), causes).readings  # type: ignore[union-attr, arg-type]
    return np.asarray(readings[case.seen & ~case.scene.session.held[:, None]].ravel())


def model_columns(case: Case) -> Array:
    """Derivatives by base, every frame, markers and compliances: the simulator displaced each way."""
    scene, found = case.scene, []

    def slope(change: str, value: Array, unit: float) -> None:
        plus = replace(scene, **{change: getattr(scene, change) + value})
        minus = replace(scene, **{change: getattr(scene, change) - value})
        found.append((fitted(case, scene=plus) - fitted(case, scene=minus)) / (2 * unit))

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
    still, found = fitted(case), []
    for name in names:
        values = {**dict.fromkeys(names, 0.0), **tuned, name: cause.values[name] * cause.size}
        found.append(fitted(case, Cause(cause.effect, cause.where, values)) - still)
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
        ends = [fitted(case, Wander(s * unit[:, :n], s * unit[:, n:])) for s in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2 * STEP) * std)
    A = np.stack(columns, axis=1).reshape(-1, 2, 3 * len(scene.markers), n + 6)
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


def test_gains_of_simulated_data(case: Case) -> None:
    """Chi-square gained by a cause has the mean: parameters + noncentrality, beside others or alone."""
    key = key_of(case, "case", 0, "salt")
    white = np.linalg.inv(root_of_covariance(case))
    still = fitted(case)
    J = white @ model_columns(case)
    T = [white @ cause_columns(case, cause) for cause in case.causes]
    noise = np.random.default_rng(0).normal(size=(DRAWS, len(still)))
    every = white @ (fitted(case, *case.causes) - still)
    assert len(T) == len(key["effects"]) == 3
    for k, entry in enumerate(key["effects"]):
        others: Sequence[Array] = [t for i, t in enumerate(T) if i != k]
        own = white @ (fitted(case, case.causes[k]) - still)
        for name, less, shift in (
            ("beside", np.hstack([J, *others]), every),
            ("noncentrality", J, own),
        ):
            mean, count = gain(less, T[k], noise + shift)
            expected = count + entry[name]
            spread = np.sqrt(2.0 * (count + 2.0 * entry[name]) / DRAWS)
            assert abs(mean - expected) < 4.0 * spread + 0.01 * expected, (name, entry["effect"])
        assert entry["beside"] <= entry["noncentrality"] * 1.001


def test_beside_others_by_hand() -> None:
    """Three displacements in the plane and out of it; one of them is a sum of what others can do."""
    x, y, z = np.eye(3)
    rests = [3.0 * x, 4.0 * (x + y), 5.0 * (y + z)]
    spans = [np.stack([x, z], axis=1), rests[1][:, None], rests[2][:, None]]
    # The second and third span a plane with normal (1, -1, 1); the first and third span all but none.
    found = beside_others(rests, spans)
    assert found == pytest.approx((9.0 / 3.0, 0.0, 0.0), abs=1e-12)
    assert beside_others([2.0 * x], [x[:, None]]) == (4.0,)
