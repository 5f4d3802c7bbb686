"""The truth of ``compare``: MuJoCo's arm, faults planted in the model, and fits from scratch."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib import Cell, Poses
from calib.arm.statics import Payload
from calib.model.build import build
from calib.noise import Noise
from calib.poses import Measurements, poses_at
from studies.compare import montecarlo
from studies.compare.agreement import derivatives
from studies.compare.compare import PlanComparison, compare
from studies.compare.experiment import POINTS, experiment_of, plausible
from studies.compare.in_mujoco import points_in_mujoco
from studies.compare.montecarlo import FromScratch, refits, surprising
from studies.compare.prediction import predict
from tests.helpers import cell_of, random_poses, random_robot, read_by, with_effects
from tests.studies.compare.fields import fields_of, one_marker

pytest.importorskip("mujoco")

EXPRESSED = (
    "base", "tool", "geometry", "joint_compliance", "link_weight", "payload", "backlash",
    "transmission_scale", "transmission_harmonic", "joint_coupling",
)  # fmt: skip


@pytest.mark.parametrize(("dof", "slides"), [(3, ()), (6, (1,)), (7, ())])
def test_mujoco_and_the_model_lead_to_the_same_points(dof: int, slides: tuple[int, ...]) -> None:
    """Every effect that MuJoCo's arm can have, at once, on arms of no special shape under any load."""
    rng = np.random.default_rng(dof)
    robot = random_robot(rng, dof, prismatic=slides)
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (3, 3)), EXPRESSED)
    cell = replace(cell, payload=Payload(5.0, (0.1, 0.0, 0.2)))
    poses = random_poses(rng, robot, 12)
    model = build(cell, poses).model
    values = plausible(model, poses, dof)
    values[:6] = rng.normal(size=6)
    points = points_in_mujoco(cell, model, values, poses)
    np.testing.assert_allclose(points, model.predict(values, poses), atol=1e-10)
    still = np.where(np.arange(len(values)) < 6, values, 0.0)
    assert np.abs(points - model.predict(still, poses)).max() > 1e-3, "the effects must show"


@pytest.fixture(scope="module")
def arm() -> Cell:
    """Four elastic joints, links of 2 to 40 kg, a base to be found, two markers."""
    rng = np.random.default_rng(3)
    robot = random_robot(rng, 4)
    return cell_of(robot, rng.uniform(-0.2, 0.2, (2, 3)), ("base", "joint_compliance"))


@pytest.fixture(scope="module")
def plan(arm: Cell) -> Poses:
    return random_poses(np.random.default_rng(4), arm.robot, 12)


def study(cell: Cell, plan: Poses, truth: Any = "mujoco", trials: int = 60) -> PlanComparison:
    return compare(cell, {"p": plan}, trials=trials, truth=truth, seed=2)


@pytest.mark.long
def test_every_column_of_every_effect_passes() -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        robot = random_robot(rng, 6, prismatic=(2,) if seed else ())
        cell = cell_of(robot, rng.uniform(-0.2, 0.2, (3, 3)), EXPRESSED)
        poses = random_poses(rng, robot, 10)
        model = build(cell, poses).model
        values = plausible(model, poses, seed)
        assert derivatives(model, poses, 0.0 * values, values).off < 1e-4


def test_nonlinearity_is_still_called_so(kr270: Cell, table_two: Poses) -> None:
    """The same poses as the wrong derivative's, but noise of millimetres on one marker."""
    cell = one_marker(with_effects(kr270, "base"))
    cell = replace(cell, instruments=read_by(Noise.isotropic(3e-3)), load=None)
    near = poses_at(table_two.q[:1] + 0.01 * np.random.default_rng(0).normal(size=(8, 6)))
    result = compare(cell, {"coarse": near}, trials=200, truth="mujoco")
    assert result.plans[0].points.reason == "noise"
    assert not result.plans[0].slopes.wrong


@pytest.mark.long
def test_trials_from_scratch_are_the_same_wherever_blocks_are_cut(arm: Cell, plan: Poses) -> None:
    experiment = experiment_of(arm, plan)
    prediction = predict(experiment, POINTS)
    done = refits(experiment, [prediction], 120, scratch=4).scratch["points"]
    assert len(done) == 4
    assert all(own.same and own.noise == "cell" for own in done)
    assert not refits(experiment, [prediction], 3).scratch["points"]


def test_trials_that_end_elsewhere_are_counted() -> None:
    here, there = FromScratch(0.0, 0, "cell", 0.5), FromScratch(3.0, 1, "cell", 0.5)
    loud, spared = FromScratch(0.0, 0, "residual", 0.5), FromScratch(0.0, 0, "cell", 0.95)
    assert surprising([here] * 20) == (False, False, False)
    assert surprising([here] * 19 + [there]) == (False, False, False)
    assert surprising([here] * 16 + [there] * 4) == (True, False, False)
    assert surprising([here] * 10 + [loud] * 10) == (False, True, False)
    assert surprising([spared] * 2) == (False, False, False)
    assert surprising([spared] * 20) == (False, False, True)


@pytest.mark.long
def test_a_search_that_is_led_astray_is_said(
    arm: Cell, plan: Poses, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Identification sets a quarter of good poses aside; the refits keep them."""
    right = montecarlo.estimated

    def wasteful(cell: Cell, data: Measurements, **options: Any) -> Any:
        return right(cell, data.take(np.arange(9)), **options)

    monkeypatch.setattr(montecarlo, "estimated", wasteful)
    result = study(arm, plan, "model", trials=80)
    done = result.plans[0].refits.scratch["points"]
    assert not any(own.same for own in done)
    found = fields_of(result)["agreement"]
    assert found["believed"] is False
    assert "elsewhere than fits that start at the true robot" in found["says"]
