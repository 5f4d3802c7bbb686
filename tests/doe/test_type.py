"""Plans on top of what a type knows: the bound holds, and is that of the plan beside the type."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import doe
from calib.cell.planned import Planned
from calib.model.build import build
from calib.population import Prior
from calib.poses import poses_at
from studies.demo.embedded import embedded_cell


def test_a_plan_beside_a_type_needs_fewer_poses_and_keeps_its_proof() -> None:
    cell = replace(embedded_cell(), effects=("base", "tool", "geometry"), load=None, knots={},
                   design=Planned())  # fmt: skip
    own = [p for p in build(cell).model.parameters if p.effect == "geometry"]
    sizes = np.array([p.size for p in own])
    keys = tuple((p.effect, p.where, p.name) for p in own)
    prior = Prior("kr270", keys, 0.1 * sizes, np.diag((0.02 * sizes) ** 2), 30)
    known = replace(cell, prior=prior)
    rng = np.random.default_rng(0)
    q = rng.uniform(*cell.robot.sample_limits().T, (120, cell.robot.dof))
    pool = poses_at(q, names=[f"p{i}" for i in range(len(q))])
    found = doe.design(known, poses=4, candidates=pool)
    assert found.value >= found.bound * (1.0 - 1e-9)
    assert np.isfinite(found.assessment.std).all()
    told = [s for p, s in zip(found.problem.model.parameters, found.assessment.std, strict=True)
            if p.effect == "geometry"]  # fmt: skip
    assert (np.array(told) < 0.02 * sizes * 1.001).all()
    # No plan of these candidates is better than the bound says, the best by their own look included.
    problem = found.problem
    blocks = problem.information(q)
    alone = problem.criterion.plain.value(problem.fixed + blocks)
    plans = [rng.choice(len(q), 4, replace=False) for _ in range(2000)]
    plans += [rng.choice(np.argsort(-alone)[:12], 4, replace=False) for _ in range(200)]
    M = problem.fixed + np.array([blocks[plan].sum(axis=0) for plan in plans])
    best = float(problem.criterion.plain.value(M).max())
    assert problem.criterion.shown(best) >= found.bound * (1.0 - 1e-6)
    assert problem.criterion.shown(best) >= found.value * (1.0 - 1e-6)
    assert any("30 robots of kr270" in note for note in found.notes)
