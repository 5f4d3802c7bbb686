"""Table II's fifteen poses beside optimal ones.

    python -m studies.research.paper.plan [--candidates N] [--json FILE]

The paper says how its poses were restricted (five angles of A2, joint limits, obstacles that it does
not list) and not how they were chosen. Here are plans of the same size at the same levels within the
same joint limits, on the same model: 250 kg at (300, 0, 150) mm, which makes chi_6 observable, three
markers, base and tool known, nine compliances, no weights of links; targets of a milling task.
"""

from __future__ import annotations

from calib import Cell, Poses
from doe.levels import levels_of, parse_levels
from doe.planning import planned
from doe.request import Request
from studies.demo.embedded import embedded_plan
from studies.research.bench import Output, Row, bench, count, each, table
from studies.research.problems import LEVELS, PAPER_POSES, paper_cell

FIGURES = {"task": "task_rms", "A": "trace", "D": "determinant"}
"""Of each criterion the figure of the assessment to compare."""


def compared(cell: Cell, table_two: Poses, criterion: str, candidates: int) -> Row:
    """An optimal plan beside Table II: both figures, their ratio, the proof, and poses that match."""
    levels = levels_of(cell, parse_levels(cell, LEVELS), None)
    asked = Request(PAPER_POSES, criterion, levels, candidates=candidates, at_markers=True)
    plan = planned(cell, asked, {"Table II": table_two}, curve=True)
    rival, key = plan.rivals["Table II"], FIGURES[criterion]
    own, theirs = getattr(plan.assessment, key), getattr(rival.assessment, key)
    larger, goal = plan.problem.criterion.larger_is_better, rival.assessment.value
    enough = [s.poses for s in plan.curve if (s.value >= goal if larger else s.value <= goal)]
    return {
        "criterion": criterion,
        "optimal": own,
        "Table II": theirs,
        "ratio": max(own / theirs, theirs / own),
        "proved": plan.efficiency,
        "share of\nTable II": rival.efficiency,
        "poses that\nmatch it": min(enough, default=None),
        "time [s]": plan.seconds,
    }


@bench(count("--candidates", 100_000))
def main(candidates: int, seed: int) -> Output:
    """Compare; task in m at the markers, A and D in urad/(N m)."""
    del seed
    cell = paper_cell(masses=False)
    plan = embedded_plan(cell)
    rows = each(compared, ((cell, plan, name, candidates) for name in FIGURES))
    return [table(rows)], rows


if __name__ == "__main__":
    main()
