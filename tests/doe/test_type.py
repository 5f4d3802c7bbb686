"""Plans on top of what a type knows: the bound holds, and is that of the plan beside the type."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import doe
from calib.cell.planned import Planned
from calib.model.build import build
from calib.population import Prior
from studies.demo.embedded import embedded_cell


def test_a_plan_beside_a_type_needs_fewer_poses_and_keeps_its_proof() -> None:
    cell = replace(embedded_cell(), effects=("base", "tool", "geometry"), load=None, knots={},
                   design=Planned())  # fmt: skip
    own = [p for p in build(cell).model.parameters if p.effect == "geometry"]
    sizes = np.array([p.size for p in own])
    keys = tuple((p.effect, p.where, p.name) for p in own)
    prior = Prior("kr270", keys, 0.1 * sizes, np.diag((0.02 * sizes) ** 2), 30)
    known = replace(cell, prior=prior)
    found = doe.design(known, poses=4, candidates=300, refine=False, fresh=False)
    assert found.value >= found.bound
    assert np.isfinite(found.assessment.std).all()
    told = [s for p, s in zip(found.problem.model.parameters, found.assessment.std, strict=True)
            if p.effect == "geometry"]  # fmt: skip
    assert (np.array(told) < 0.02 * sizes * 1.001).all()
    # Any other plan of these candidates is worse than the bound says.
    problem, rng = found.problem, np.random.default_rng(0)
    low, high = cell.robot.sample_limits().T
    for _ in range(20):
        M = problem.fixed + problem.information(rng.uniform(low, high, (4, 6))).sum(axis=0)
        assert problem.criterion.shown(float(problem.criterion.value(M))) >= 0.9 * found.bound
    assert any("30 robots of kr270" in note for note in found.notes)
