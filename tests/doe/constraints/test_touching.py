"""What is touched: poses that meet it, fits that scatter as foreseen, and half a plan of it.

The truth is plain numpy: a chain, contacts and noise that share no code with planner or estimator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import calib
import doe
from calib import Cell
from calib.arrays import Array
from calib.cell import Repeatability
from calib.instruments import Distance, Instrument, KnownDistance, Plane, Socket
from calib.instruments.plane import place_of
from calib.poses import poses_at
from doe.constraints import scene_of, visible
from doe.forecast.enough import enough
from doe.forecast.foresee import foresee
from studies.compare.experiment import POINTS, experiment_of, predict
from tests.helpers import all_seen, cell_of
from tests.touched_arm import OFF, OFFSETS, TRUE, arm, led_to, points_of, positions

ONE = np.array([[0.10, 0.02, -0.05]])
SIGMA = 2e-5
LIMITS = np.tile([-2.0, 2.0], (4, 1))
MIDDLE = np.array([0.3, -0.2, 0.4])
NORMAL = np.array([0.2, -0.3, 0.9])
SITES = points_of(arm(), np.array([[0.4, -0.5, 0.6, 0.2], [-0.6, 0.7, -0.3, 0.5]]), markers=ONE)[
    :, 0
]
APART = float(np.sqrt(((SITES[0] - SITES[1]) ** 2).sum()))
SOCKETS = Socket(name="a", sites=("a", "b"), sigma=SIGMA, standing=SITES)
PLANE = Plane(name="table", sigma=SIGMA, standing=place_of(MIDDLE, NORMAL)[None])


def cell_with(*instruments: Instrument, lengths: tuple[KnownDistance, ...] = ()) -> Cell:
    cell = cell_of(replace(arm(), limits=LIMITS), ONE, ("base", OFF))
    return replace(cell, instruments=instruments, known_distances=lengths)


def at(q: Array, off: Sequence[float] | Array = ()) -> Array:
    """The marker (m, 3) of an arm whose joints are off."""
    return points_of(arm(), q, off, ONE)[:, 0]


def to_plane(p: Array, site: Array) -> Array:
    return ((p - MIDDLE) @ NORMAL / np.sqrt(NORMAL @ NORMAL))[:, None]


def to_socket(p: Array, site: Array) -> Array:
    return p - SITES[site]


KINDS = {
    "sockets": (cell_with(SOCKETS, lengths=(KnownDistance(("a", "b"), APART, 1e-5),)), to_socket),
    "plane": (cell_with(PLANE), to_plane),
}


def touching(kind: str, count: int = 12) -> tuple[Array, Array]:
    """Poses (m, 4) within the limits at which the nominal arm touches, and at which place, (m,)."""
    q, missed = np.random.default_rng(3).uniform(-1.5, 1.5, (60, 4)), KINDS[kind][1]
    site = np.arange(len(q)) % (2 if kind == "sockets" else 1)
    q, there = led_to(q, lambda q: missed(at(q), site))
    met = there & (np.abs(q) <= 2.0).all(axis=1)
    return q[met][:count], site[met][:count]


def settled(kind: str, q: Array, site: Array, rng: np.random.Generator) -> Array:
    """Joints at which the true arm touches, its noise aside."""
    missed = KINDS[kind][1]
    noise = SIGMA * rng.normal(size=missed(at(q), site).shape)
    touched, there = led_to(q, lambda q: missed(at(q, TRUE), site), noise)
    assert there.all()
    return touched


@pytest.mark.sampled
@pytest.mark.parametrize("kind", KINDS)
def test_every_pose_touches_and_fits_scatter_as_foreseen(kind: str) -> None:
    cell, (q, site) = KINDS[kind][0], touching(kind)
    assert len(q) == 12
    experiment = experiment_of(cell, poses_at(q))
    cov = predict(experiment, POINTS).covariance
    ids = [p.id for p in experiment.model.parameters]
    names = [f"joint_offset:{joint}.offset" for joint in OFFSETS]
    own = [ids.index(name) for name in names]
    rng, statistics = np.random.default_rng(0), []
    for _ in range(5):
        touched = settled(kind, q, site, rng)
        places = np.array(["a", "b"])[site] if kind == "sockets" else None
        readings = np.zeros((len(q), 1, 3 if kind == "sockets" else 1))
        data = all_seen(poses_at(touched, site=places), readings)
        lengths = [replace(k, length=APART + 1e-5 * rng.normal()) for k in cell.known_distances]
        own_cell = replace(cell, known_distances=tuple(lengths))
        result = calib.identify(own_cell, data)
        off = result.values[positions(result, *names)] - TRUE
        statistics.append(off @ np.linalg.solve(cov[np.ix_(own, own)], off))
    assert 1e-3 < chi2.cdf(sum(statistics), 3 * len(statistics)) < 1.0 - 1e-3


def test_a_pose_is_read_by_what_it_touches_alone() -> None:
    bar = Distance(name="bar", sigma=SIGMA, standing=np.array([0.2, 0.2, -0.6]))
    cell = cell_with(bar, PLANE)
    q = np.concatenate([touching("plane", 8)[0], np.random.default_rng(0).uniform(-2, 2, (40, 4))])
    on_plane = np.abs(to_plane(at(q), q)[:, 0]) < 1e-6
    assert on_plane.sum() == 8
    seen = visible(scene_of(cell, q))
    np.testing.assert_array_equal(seen[:, 1], on_plane)
    assert not seen[on_plane, 0].any()
    assert seen[~on_plane, 0].all()


@pytest.mark.parametrize("kind", KINDS)
def test_no_plan_is_made_for_them(kind: str) -> None:
    with pytest.raises(calib.CalibError, match="are not planned for; choose them by hand"):
        doe.design(KINDS[kind][0], poses=12, criterion="D", candidates=300)


def test_what_cannot_be_foreseen_or_reached_is_refused() -> None:
    with pytest.raises(calib.CalibError, match=r"give position_mm of a, b in the base's frame"):
        experiment_of(cell_with(replace(SOCKETS, standing=None)), poses_at(touching("sockets")[0]))
    with pytest.raises(calib.CalibError, match="touches nothing to"):
        experiment_of(KINDS["plane"][0], poses_at(np.zeros((3, 4))))


def test_half_a_plan_of_sockets_is_forecast_as_identifications_find_it() -> None:
    """The length between them counts now, at the end, and in what a plan foresees."""
    cell = replace(KINDS["sockets"][0], repeatability=Repeatability(0.0, 0.0))
    q, site = touching("sockets")
    names = [f"p{k:02d}" for k in range(len(q))]
    touched = settled("sockets", q, site, np.random.default_rng(0))
    poses = poses_at(touched, site=np.array(["a", "b"])[site], names=names)
    whole, plan = all_seen(poses, np.zeros((len(q), 1, 3))), poses_at(q, names=names)
    half, end = whole.take(np.arange(7)), calib.identify(cell, whole)
    answer = enough(cell, half, plan)
    np.testing.assert_allclose(answer.steps[0].std, calib.identify(cell, half).std, rtol=1e-6)
    assert answer.steps[-1].readings == len(whole)
    assert not answer.steps[-1].open
    np.testing.assert_allclose(answer.steps[-1].std, end.std, rtol=1e-3)
    view = foresee(cell, plan)
    own = view.beside.modelled
    std = np.sqrt(np.diag(np.linalg.inv(own.T @ own)))
    moving = calib.identify(cell, whole.take(~view.waiting)).std
    np.testing.assert_allclose(std, moving, rtol=0.01)
