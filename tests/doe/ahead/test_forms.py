"""Poses that show whether a cause has another form, foreseen and then read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
import doe
from calib import Cell
from calib.arrays import Array
from calib.cell.targets import targets_of
from calib.diagnosis import Diagnosis
from calib.diagnosis.shape import TESTED
from calib.effects.protocol import Effect
from calib.model import Model
from calib.model.build import build, context_of, place_effect
from calib.poses import Measurements, poses_at
from calib.simulation import drawn_readings
from doe.ahead.forecast import Forecast
from doe.ahead.information import FREE
from doe.ahead.next_poses import accuracy_of
from studies.demo.embedded import embedded_cell
from tests.doe.ahead.day import asking_only
from tests.helpers import with_effects

CAUSE = "transmission_scale:A3"


class Session:
    """A robot with one cause more than its model, and what is read of it."""

    def __init__(self) -> None:
        rng = np.random.default_rng(3)
        self.cell = replace(with_effects(embedded_cell(), "base", "tool", "geometry"), load=None)
        low, high = self.cell.robot.sample_limits().T
        self.q = rng.uniform(low, high, (14, len(low)))
        kind, _, where = CAUSE.partition(":")
        effect: Effect = place_effect(kind, where, context_of(self.cell, poses_at(self.q)))
        model = build(self.cell).model
        self.truth: Array = 0.2 * rng.normal(size=len(model.sizes)) * model.sizes
        self.model: Model = model
        self.model, self.truth = model.extended(self.truth, (effect,))
        self.truth[-1] = 3e-5

    def read(self, q: Array) -> Measurements:
        poses = poses_at(q, names=[f"p{i}" for i in range(len(q))])
        return drawn_readings(
            self.model, self.truth, poses, self.cell.noise, np.random.default_rng(1)
        )

    def diagnosed(self, q: Array) -> Diagnosis:
        with asking_only("transmission_scale", "backlash"):
            return calib.diagnose(self.cell, self.read(q))


@pytest.fixture(scope="module")
def session() -> Session:
    return Session()


@pytest.fixture(scope="module")
def found(session: Session) -> Diagnosis:
    return session.diagnosed(session.q)


def test_a_cause_that_stands_alone_is_shown_by_the_poses_that_were_to_show_it(
    session: Session, found: Diagnosis
) -> None:
    (cause,) = found.causes
    assert cause.named.candidate.key == CAUSE
    assert not cause.doubt.tested
    plain = doe.next_poses(session.cell, found, count=6)
    assert not len(plain.poses)
    further = doe.next_poses(session.cell, found, count=6, forms=True)
    (form,) = further.forms
    assert form.now == pytest.approx(cause.doubt.power, abs=0.03)
    again = session.diagnosed(np.concatenate([session.q, further.poses.q]))
    assert again.verdict == "explained"
    assert again.causes[0].doubt.power >= TESTED
    assert form.after == pytest.approx(again.causes[0].doubt.power, abs=0.05)
    rng = np.random.default_rng(0)
    low, high = session.cell.robot.sample_limits().T
    anywhere = rng.uniform(low, high, (6, len(low)))
    random = session.diagnosed(np.concatenate([session.q, anywhere]))
    assert random.causes[0].doubt.power < again.causes[0].doubt.power


def expected(model: Model, cell: Cell, rows: Array) -> float:
    """Mean square at the targets from rows (N, p) per plausible size, by plain inversion."""
    targets, weights = targets_of(cell)
    _, J = model.jacobian(np.zeros(len(model.sizes)), targets)
    cov = np.linalg.inv(rows.T @ rows + np.eye(rows.shape[1]) / FREE**2)
    J = J * model.sizes
    squares = np.einsum("kmip,pq,kmiq->km", J, cov, J).mean(axis=1)
    return float(weights @ squares / weights.sum())


def test_the_error_at_the_targets_is_that_of_all_rows_at_once(
    session: Session, found: Diagnosis
) -> None:
    forecast = Forecast.after_diagnosis(session.cell, found, [])
    # At the nominal arm, so that targets and readings are linearised where the other side does.
    model = found.stage.model
    _, rows = forecast.known.independent
    p = len(model.parameters)
    still = replace(found, after=replace(found.after, values=np.zeros(len(found.after.values))))
    accuracy = accuracy_of(forecast, still)
    more = np.random.default_rng(0).normal(size=(5, 9, rows.shape[1])) / forecast.model.sizes
    q = np.zeros((5, session.cell.robot.dof))
    blocks = accuracy.columns_of(more, q)
    known = accuracy.now.added(blocks[0])
    tried, twice = (accuracy.values(k, k.tried(blocks))[:, 0] for k in (accuracy.now, known))
    own = rows[:, :p] * model.sizes

    def direct(*further: int) -> float:
        blocks = [more[i][:, :p] * model.sizes for i in further]
        return -0.5 * np.log(expected(model, session.cell, np.concatenate([own, *blocks])))

    assert float(accuracy.values(accuracy.now, accuracy.now.S)[0]) == pytest.approx(
        direct(), rel=1e-6
    )
    np.testing.assert_allclose(tried, [direct(i) for i in range(5)], rtol=1e-6)
    np.testing.assert_allclose(twice, [direct(0, i) for i in range(5)], rtol=1e-6)


def test_poses_for_both_do_most_of_what_poses_for_one_would(
    session: Session, found: Diagnosis
) -> None:
    both = doe.next_poses(session.cell, found, count=4, forms=True, accuracy=True)
    assert both.shares is not None
    assert min(both.shares) > 0.5
    assert max(both.shares) < 1.1
    alone = doe.next_poses(session.cell, found, count=4, forms=True)
    assert alone.forms[0].after > both.forms[0].after - 0.02
    assert alone.shares is None
