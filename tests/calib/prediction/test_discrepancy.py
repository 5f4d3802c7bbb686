"""What a fit leaves: left-out configurations against refits, and noise that is the instrument's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Cell
from calib.effects import EFFECTS
from calib.model.build import build
from calib.noise import Noise
from calib.poses import Measurements, poses_at
from calib.prediction.discrepancy import FittedModel, model_discrepancy
from calib.prediction.estimate import estimate_of
from calib.simulation import drawn_readings
from tests.helpers import cell_of, random_robot
from tests.properties.every_instrument import scene

GEOMETRY = ("base", "tool", "geometry")
MARKERS = np.array([[0.2, 0.0, 0.05], [0.18, 0.1, -0.04], [0.22, -0.06, -0.08]])


def session(poses: int, louder: float, markers: int, seed: int) -> tuple[Cell, Measurements]:
    """Cell, and readings with an instrument so many times noisier than it says."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, 6)
    cell = cell_of(robot, MARKERS[:markers], GEOMETRY)
    model = build(cell).model
    values = model.sizes * rng.uniform(-0.3, 0.3, len(model.parameters))
    noise = Noise(*(louder * s for s in (cell.noise.along, cell.noise.across, 0.0, 0.0)))
    measured = poses_at(rng.uniform(*robot.limits.T, size=(poses, 6)))
    return cell, drawn_readings(model, values, measured, noise, rng)


def test_left_out_configurations_are_those_of_refits() -> None:
    """Poses are taken out and the rest identified: what they then miss by was foreseen."""
    cell, data = session(30, 1.0, 3, 1)
    found = calib.identify(cell, data)
    assert not found.fit.outlier.any()
    span = np.eye(len(found.values))[:, found.std > 0.0]
    known = (found.model, found.values, found.covariance, span)
    fit = FittedModel(*known, data, found.weights, 1e-5, None)
    errors, rows = fit.left_out(data.poses.configuration)
    assert rows.determined.all()
    assert rows.growth.min() > 1.0
    for i in (0, 7, 19):
        rest = calib.identify(cell, data.take(np.delete(np.arange(30), i)))
        own = data.take([i])
        missed = own.points - rest.predict(own.poses)
        np.testing.assert_allclose(errors[i], missed[0], atol=0.02 * np.abs(missed).max())


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_noisy_instrument_is_no_model_error(seed: int) -> None:
    """Three times noisier than stated, three markers: the shape of the marker set tells."""
    cell, data = session(60, 3.0, 3, seed)
    found = calib.identify(cell, data)
    assert found.noise.source == "residual"
    known = estimate_of(found)
    assert known.discrepancy.rms == 0.0
    assert known.notes == ()
    assert found.noise.sigma == pytest.approx(3.0 * cell.noise.along, rel=0.1)


def test_one_marker_cannot_tell_and_says_so() -> None:
    cell, data = session(60, 3.0, 1, 0)
    known = estimate_of(calib.identify(cell, data))
    total = known.discrepancy.rms
    if known.variances is not None:
        tip = known.variances.approach + known.variances.configuration
        total = float(np.sqrt(total**2 + 3.0 * tip[-2]))
    assert total > 2.0 * np.sqrt(3.0) * cell.noise.along
    assert "cannot tell the instrument from the arm" in " ".join(known.notes)
    quiet, data = session(60, 1.0, 1, 0)
    assert estimate_of(calib.identify(quiet, data)).notes == ()


def test_instruments_that_read_no_length_do_not_speak_of_any() -> None:
    """A camera beside a wire: what is unseen is that of the wire, however many corners there are."""
    here = scene(8, 25)
    offset = EFFECTS["joint_offset"].at(here.context, "j2")
    read = tuple(i for i in here.context.instruments if i.kind in ("camera", "distance"))
    context = replace(here.context, instruments=read)
    base = [EFFECTS["base"].at(context, w) for w in EFFECTS["base"].places(context)]
    model = replace(here.model(), instruments=read, effects=(*base, offset))
    data = drawn_readings(model, here.at(model), here.poses, None, np.random.default_rng(0))
    wire = next(part for i, part in model.readout.channels.blocks if i.kind == "distance")
    weights = model.readout.whitening(here.at(model), data.poses, data.readings, data.sigma)
    size = len(here.at(model))
    fit = FittedModel(
        model, here.at(model), np.zeros((size, size)), np.eye(size), data, weights, 2e-5, None
    )
    off = data.readings.copy()
    off[:, wire, 0] += 1e-3
    heldout = replace(data, readings=off)
    shown = fit.squared(heldout, *fit.predicted(heldout))
    assert shown.beyond(shown.noise) == pytest.approx(1e-3, rel=1e-2)
    assert model_discrepancy(fit, heldout, 1.0).rms == pytest.approx(1e-3, rel=1e-2)


def test_a_configuration_read_often_is_left_out_as_by_dense_matrices() -> None:
    """Forty readings of one pose, more rows than parameters: ``(I - Q_F Q_F^T)^-1 r_F``."""
    cell, data = session(40, 1.0, 3, 1)
    data = data.take(np.append(np.arange(40), np.zeros(39, dtype=int)))
    found = calib.identify(cell, data)
    span = np.eye(len(found.values))[:, found.std > 0.0]
    known = (found.model, found.values, found.covariance, span)
    fit = FittedModel(*known, data, found.weights, 1e-5, None)
    errors, rows = fit.left_out(data.poses.configuration)
    points, J = found.model.jacobian(found.values, data.poses)
    J = (found.weights @ (J @ span)).reshape(-1, span.shape[1])
    Q, _ = np.linalg.qr(J / np.linalg.norm(J, axis=0))
    r = (found.weights @ (data.readings - points)[..., None]).ravel()
    r = (r - Q @ (Q.T @ r)).reshape(len(data), -1)
    here = np.append(0, np.arange(40, 79))
    own = Q.reshape(*r.shape, -1)[here].reshape(-1, Q.shape[1])
    freedom = np.eye(len(own)) - own @ own.T
    missed = np.linalg.solve(freedom, r[here].ravel()).reshape(len(here), -1, 3, 1)
    expected = (np.linalg.inv(found.weights[here]) @ missed)[..., 0]
    assert len(own) > Q.shape[1]
    assert rows.determined.all()
    np.testing.assert_allclose(errors[here], expected, rtol=1e-7, atol=1e-12)
    more = np.trace(np.linalg.inv(freedom) - np.eye(len(own))) / np.trace(own @ own.T)
    assert rows.growth[data.poses.configuration[0]] == pytest.approx(more, rel=1e-6)
