"""What is asked of a plan, and of which candidates: a cell's request made ready to be solved.

A request (:mod:`~doe.problem.request`) and a cell become a :class:`~doe.problem.problem.Problem`; its
candidates are drawn and judged by :mod:`~doe.problem.pool`, what each of them tells is said by
:mod:`~doe.problem.linearisation`, and what no plan could determine is refused before the search.
"""

from doe.problem.problem import RIDGE, Problem, problem_of

__all__ = ["RIDGE", "Problem", "problem_of"]
