"""What the uncertainty of identified parameters leaves at the targets."""

from __future__ import annotations

from dataclasses import dataclass

from calib.accuracy.budget import Budget, Expected, budget_of, combined
from calib.arrays import Array
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.compensation.estimate import Estimate
from calib.identification import Identification
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class Accuracy:
    """What the uncertainty of identified parameters leaves at the targets.

    expected : Expected, by the parameters alone; source : str, what the targets are
    """

    targets: Poses
    budget: Budget
    expected: Expected
    source: str

    @property
    def errors(self) -> Array:
        """RMS of each target, shape (m,), m."""
        return self.expected.errors

    @property
    def rms(self) -> float:
        """Over the targets, m."""
        return self.expected.rms(self.errors)

    @property
    def worst(self) -> float:
        """At the worst of them, m."""
        return self.expected.worst(self.errors)


def accuracy_at_targets(
    cell: Cell, found: Identification, estimate: Estimate | None = None
) -> Accuracy:
    """The accuracy to expect at the cell's targets.

    estimate : of the same identification, for what the arm and the model's lacks add in the budget
    """
    targets, weights = targets_of(cell)
    after = cell.design.targets_after or 0.0
    budget = budget_of(found, estimate, targets, weights, after)
    expected = combined(budget.calibration, weights)
    return Accuracy(targets, budget, expected, cell.targets_in_words)
