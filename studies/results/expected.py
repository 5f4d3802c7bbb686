"""The error expected at the targets, and the uncertainty budget behind it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from pydantic import Field

from calib import Cell
from calib.arrays import Array
from calib.cell.targets import targets_of
from calib.inference.coverage import LEVEL
from calib.model.covariance import task_error
from calib.observations.scatter import Variances
from calib.prediction.budget import Budget, UncertaintySource, combined
from calib.prediction.discrepancy import ModelDiscrepancy
from calib.prediction.estimate import Estimate, ExpectedError
from studies.results.base import MM, Entry, Maybe, NotNegative, Positive

if TYPE_CHECKING:
    from doe import Design


class ExpectedErrors(Entry):
    """RMS error at the targets by three independent parts, all of them, and at the worst target.

    never_measured : what the targets ask that no reading had, and what it may add; in model_mm
    arm : of a pose anew at each target; with ``scatter_of`` undecided it may be the model's
    """

    parameters_mm: Maybe
    arm_mm: NotNegative
    model_mm: NotNegative
    rms_mm: Maybe
    worst_mm: Maybe
    scatter_of: Literal["arm", "undecided"]
    never_measured: tuple[str, ...] = ()

    @classmethod
    def of(cls, error: ExpectedError, weights: Array) -> Self:
        """The entry of an expected error; weights : ndarray, shape (m,), of the targets."""
        rms, worst = task_error(error.rms, weights)
        parts = {
            f"{name}_mm": task_error(getattr(error, name), weights)[0] * MM
            for name in ("parameters", "arm", "model")
        }
        undecided = error.estimate.configuration_of == "undecided"
        return cls(
            **parts,
            rms_mm=rms * MM,
            worst_mm=worst * MM,
            scatter_of="undecided" if undecided else "arm",
            never_measured=tuple(error.never_measured(weights)),
        )

    @classmethod
    def at_targets(cls, cell: Cell, estimate: Estimate) -> Self:
        """The error of an estimate at the targets of a cell."""
        targets, weights = targets_of(cell)
        return cls.of(ExpectedError(estimate, targets), weights)

    @classmethod
    def of_plan(cls, found: Design, cell: Cell) -> Self:
        """Of a plan: what its readings leave open, the arm as the cell states it, a complete model."""
        model, (targets, weights) = found.problem.model, targets_of(cell)
        count, judged = len(model.parameters), found.assessment
        stated = Variances.of_arm(model.robot.dof, cell.repeatability)
        none, known = ModelDiscrepancy(0.0, ""), np.zeros((count, count))
        exact = Estimate(model, model.initial, known, 0.0, none, (), variances=stated)
        arm, most = task_error(ExpectedError(exact, targets).arm, weights)
        return cls(
            parameters_mm=judged.task_rms * MM,
            arm_mm=arm * MM,
            model_mm=0.0,
            rms_mm=float(np.hypot(judged.task_rms, arm)) * MM,
            worst_mm=float(np.hypot(judged.task_worst, most)) * MM,
            scatter_of="arm",
        )


class BudgetRow(Entry):
    """One source at the targets, RMS.

    evaluation : "A" by statistics of the readings, "B" by what is known otherwise (JCGM 100)
    share : of the variance in the total; degrees_of_freedom : None where it counts as known
    """

    source: str
    evaluation: Literal["A", "B"]
    part_of: Literal["calibration", "arm", "model"]
    at_targets_mm: NotNegative
    degrees_of_freedom: Maybe
    share: NotNegative

    @classmethod
    def of(cls, budget: Budget, part: UncertaintySource, total: float) -> Self:
        """The row of a source; total : variance of all, mm^2."""
        targets = budget.rms(part.errors) * MM
        return cls.from_object(
            part,
            part_of=part.of,
            at_targets_mm=targets,
            degrees_of_freedom=part.freedom,
            share=targets**2 / total if total else 0.0,
        )


class ExpandedUncertainty(Entry):
    """A combined standard uncertainty, and the distance within which 95 % of errors stay.

    Errors in space: the factor is Student's t where they lie along one line, less where not.
    """

    standard_uncertainty_mm: NotNegative
    coverage_factor: Positive
    expanded_mm: NotNegative
    worst_expanded_mm: NotNegative
    degrees_of_freedom: Maybe

    @classmethod
    def of(cls, budget: Budget, parts: Sequence[UncertaintySource]) -> Self:
        """Several sources together."""
        both = combined(parts, budget.weights)
        u, most = budget.rms(both.errors), budget.rms(both.expanded)
        return cls(
            standard_uncertainty_mm=u * MM,
            coverage_factor=most / u if u else 1.0,
            expanded_mm=most * MM,
            worst_expanded_mm=budget.worst(both.expanded) * MM,
            degrees_of_freedom=both.freedom,
        )


class UncertaintyBudget(Entry):
    """All sources; what the parameters' uncertainty leaves, and with what arm and model add."""

    rows: tuple[BudgetRow, ...] = Field(min_length=1)
    calibration: ExpandedUncertainty
    total: ExpandedUncertainty
    probability: Positive

    @classmethod
    def of(cls, budget: Budget) -> Self:
        """The entry of a budget."""
        total = ExpandedUncertainty.of(budget, budget.parts)
        square = total.standard_uncertainty_mm**2
        return cls(
            rows=tuple(BudgetRow.of(budget, part, square) for part in budget.parts),
            calibration=ExpandedUncertainty.of(budget, budget.calibration),
            total=total,
            probability=LEVEL,
        )
