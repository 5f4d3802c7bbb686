"""An order that a steady drift disturbs little, for a model that has none.

A drift that nobody modelled passes for errors of the arm as far as the order lets it. An order in which
a drift of the base could be identified as well, at little cost to all else, keeps both apart (a run
order nearly free of trends: Cheng, Jacroux, Journal of the American Statistical Association 83(404),
1988).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from doe.assess import assess
from doe.day.day import day_of, quickest_order
from doe.problem import Problem, problem_of
from doe.problem.visits import Visits
from doe.run_order import in_run_order

_DRIFT = "base_drift"


@dataclass(frozen=True)
class TrendPrice:
    """What it costs to keep a steady drift of the base apart.

    without : float, m, expected error at the targets where there is no drift in the model
    ordered, quickest : the same with it, in this order and in the quickest
    seconds : float, by which the ways of this order are longer
    """

    without: float
    ordered: float
    quickest: float
    seconds: float


def nearly_free_of_trends(problem: Problem, visits: Visits) -> tuple[Visits, TrendPrice]:
    """The visits of a plan in an order that tells a drift of the base from all else, and its price.

    Raises CalibError where the time counts and joint speeds are unknown.
    """
    cell = problem.cell
    request = replace(problem.request, levels=None, fixed=None, prove=False)
    drifting = problem_of(replace(cell, effects=(*cell.effects, _DRIFT)), request)
    ordered = in_run_order(drifting, replace(visits, moment=np.arange(len(visits))))
    quick = visits.take(quickest_order(cell, visits.q, visits.move))
    first, second = (day_of(cell, own.poses(cell), around=False) for own in (ordered, quick))
    price = TrendPrice(
        without=assess(problem, visits).task_rms,
        ordered=assess(drifting, Visits.of(first.timed)).task_rms,
        quickest=assess(drifting, Visits.of(second.timed)).task_rms,
        seconds=first.moving - second.moving,
    )
    return replace(ordered, moment=None), price
