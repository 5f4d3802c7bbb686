"""Half a plan of sockets touched: the length between them counts now, and with all that is to come."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib.cell import Repeatability
from calib.poses import Measurements, Poses, poses_at
from doe.forecast.enough import Enough, enough
from doe.forecast.foresee import foresee
from tests.doe.constraints.test_touching import KINDS, settled, to_socket, touching
from tests.helpers import all_seen

CELL = replace(KINDS["sockets"][0], repeatability=Repeatability(0.0, 0.0))
SO_FAR = np.arange(7)


@pytest.fixture(scope="module")
def plan() -> Poses:
    q, _ = touching("sockets")
    return poses_at(q, names=[f"p{k:02d}" for k in range(len(q))])


@pytest.fixture(scope="module")
def whole(plan: Poses) -> Measurements:
    site = touching("sockets")[1]
    q = settled(plan.q, site, to_socket, np.random.default_rng(0))
    poses = poses_at(q, site=np.array(["a", "b"])[site], names=plan.names)
    return all_seen(poses, np.zeros((len(q), 1, 3)))


@pytest.fixture(scope="module")
def answer(plan: Poses, whole: Measurements) -> Enough:
    return enough(CELL, whole.take(SO_FAR), plan)


def test_now_is_what_identify_says(whole: Measurements, answer: Enough) -> None:
    found = calib.identify(CELL, whole.take(SO_FAR))
    np.testing.assert_allclose(answer.steps[0].std, found.std, rtol=1e-6)


def test_the_end_is_what_identify_will_say(whole: Measurements, answer: Enough) -> None:
    found = calib.identify(CELL, whole)
    assert answer.steps[-1].readings == len(whole)
    assert not answer.steps[-1].open
    np.testing.assert_allclose(answer.steps[-1].std, found.std, rtol=1e-3)


def test_a_plan_foresees_the_length_as_an_identification_has_it(
    plan: Poses, whole: Measurements
) -> None:
    view = foresee(CELL, plan)
    found = calib.identify(CELL, whole.take(~view.waiting))
    own = view.known.independent[1][:, : len(view.values)]
    std = np.sqrt(np.diag(np.linalg.inv(own.T @ own)))
    np.testing.assert_allclose(std, found.std, rtol=0.01)
