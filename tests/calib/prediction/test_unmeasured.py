"""What targets ask and no reading had: the expected error is as large as what came."""

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib.model.build import build
from calib.poses import poses_at
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings

_HOURS = 6.0


def _balanced(cell):
    """An arm whose weight bends nothing: only a load at the tip shows what yields."""
    rigid = ("base", "tool", "geometry")
    return replace(cell, effects=rigid, load=None, gravity=np.zeros(3))


def _poses(cell, rng, count, kind, target):
    limits = np.clip(cell.robot.limits, -2.0, 2.0)
    q = limits[:, 0] + (limits[:, 1] - limits[:, 0]) * rng.random((count, cell.robot.dof))
    given = {}
    if kind == "joint_compliance" and target:
        given["wrench"] = np.tile([0.0, 0.0, -500.0, 0.0, 0.0, 0.0], (count, 1))
    if kind == "base_drift":
        given["time"] = (
            np.full(count, _HOURS * 3600.0) if target else np.linspace(0.0, 3600.0, count)
        )
    if kind == "backlash":
        given["approach"] = np.full(q.shape, -1.0 if target else 1.0)
    poses = poses_at(q, **given)
    return poses if kind == "backlash" else with_moves(poses)


def _day(cell, kind, seed):
    """Readings of an arm with an effect that its model lacks, its targets, and that arm."""
    rng = np.random.default_rng(seed)
    poses, targets = (_poses(cell, rng, n, kind, of) for n, of in ((40, False), (15, True)))
    loaded = replace(poses, wrench=np.ones_like(poses.wrench))
    model = build(replace(cell, effects=("base", "tool", "geometry", kind)), loaded).model
    truth = model.initial.copy()
    for i, p in enumerate(model.parameters):
        if p.effect == kind:
            # A drive turns by about a milliradian under the weight of its arm (850 kg, at 0.7 m).
            soft = abs(rng.normal()) * 1e-3 / (850.0 * 9.81 * 0.7)
            truth[i] = soft if kind == "joint_compliance" else rng.normal() * p.size
        elif p.effect == "geometry":
            truth[i] = 0.5 * rng.normal() * p.size
    return (
        drawn_readings(model, truth, poses, None, rng, arm=cell.repeatability),
        targets,
        model,
        truth,
    )


@pytest.mark.parametrize("kind", ["joint_compliance", "base_drift", "backlash"])
def test_what_was_never_measured_is_promised_at_its_size(kr270, kind):
    cell = _balanced(kr270)
    ratios = []
    for seed in range(8):
        data, targets, model, truth = _day(cell, kind, seed)
        result = calib.identify(cell, data)
        found = calib.compensate(cell, result, targets)
        there = replace(found.targets, q=found.q)
        off = model.predict(truth, there) - result.model.predict(result.values, there)
        true = float(np.sqrt((off**2).sum(axis=-1).mean()))
        ratios.append(float(np.sqrt((found.error.rms**2).mean())) / true)
        assert any(kind in said for said in found.error.never_measured(found.weights))
    assert 0.7 < np.median(ratios) < 1.5


def test_nothing_is_added_at_targets_like_the_readings(kr270):
    cell = _balanced(kr270)
    data, _, _, _ = _day(cell, "joint_compliance", 0)
    rng = np.random.default_rng(1)
    targets = _poses(cell, rng, 30, "none", True)
    found = calib.compensate(cell, calib.identify(cell, data), targets)
    assert np.sqrt((found.error.unmeasured**2).mean()) < 0.2 * np.sqrt((found.error.rms**2).mean())
