"""Comparing estimators and plans: predicted covariance beside simulation.

result = compare(cell, {"a": plan_a, "b": plan_b}, trials=1000)
result.plans[0].verdicts[0].prediction.std
"""

from studies.compare.compare import Comparison, PlanStudy, Verdict, compare
from studies.compare.engines import engine

__all__ = ["Comparison", "PlanStudy", "Verdict", "compare", "engine"]
