"""What no further reading lowers: the arm's scatter, what the model lacks, and a trend of the day."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arm.repeatability import usual_repeatability
from calib.arrays import Array
from calib.cell import Cell
from calib.compensation.estimate import estimate_of, fitted_of
from calib.compensation.trend import trend_of
from calib.compensation.unexplained import scatter_at
from calib.identification import Identification
from calib.model import Model
from calib.model.covariance import task_error
from calib.observations import Points
from calib.poses import Poses
from calib.scatter import Variances, scatter_of
from calib.scatter.restricted import maximised
from calib.scatter.search import problem_of


@dataclass(frozen=True)
class Unnoticed:
    """What the tip's scatter would do, the likeliest and a standard error more.

    at_targets : float, m, RMS; louder : float, by how much more the readings would err than stated
    """

    at_targets: float = 0.0
    louder: float = 1.0


def unnoticed(
    cell: Cell,
    model: Model,
    values: Array,
    found: Identification | None,
    targets: Poses,
    weights: Array,
) -> Unnoticed:
    """None where scatter was found, or the cell says how the arm repeats.

    A test leaves out what is not surely there. Whoever promises a bound must not; but no arm is taken
    to repeat worse than data sheets of its size say.
    """
    levels = None if found is None else found.levels
    if found is None or levels is None or levels.variances.any or cell.repeatability is not None:
        return Unnoticed()
    kept, span = ~found.fit.outlier, np.eye(len(found.values))[:, found.std > 0.0]
    points = Points(found.model, found.fit.data, found.weights * kept[:, None, None, None])
    none = Variances.none(model.robot.dof)
    scatter = scatter_of(found.model, found.values, found.fit.data.poses, none)
    levers = points.rows(scatter.levers)
    r, J = points.linearise(found.values)
    problem, start, _ = problem_of(scatter, levers, r, J @ span)
    start[0] = levels.variances.scale**2
    theta, at = maximised(problem, start, np.array([len(start) - 2, len(start) - 1]))
    theta[-2] += np.sqrt(2.0 / at.information[-2, -2])  # that of the tip's place, known so badly
    own = (theta * problem.units)[-len(none.configuration) :]
    usual, shown = usual_repeatability(model.robot.reach), scatter.of_tip(own).translation
    own = own * min(1.0, usual.worst / shown) ** 2  # no arm of this size is worse
    likely = Variances(levels.variances.scale, none.approach, own)
    rms, _ = task_error(np.sqrt(scatter_at(model, values, targets, likely).mean(axis=-1)), weights)
    return Unnoticed(rms, scatter.at(likely).typical(levers) / likely.scale)


def may_move_on(cell: Cell, found: Identification | None, targets: Poses, weights: Array) -> float:
    """RMS error at targets hours after the last reading by a trend that may be chance, m.

    Zero where one is shown, which is expected then, or nobody says that the targets come later.
    """
    after = cell.design.targets_after
    if found is None or not after:
        return 0.0
    known = estimate_of(found)
    if known.trend is not None:
        return 0.0
    known = replace(known, trend=trend_of(fitted_of(found), sure=1.0))
    moved = known.moved_on(replace(targets, start=known.start), after)
    return task_error(moved, weights)[0] * (known.clock_unit == "s")
