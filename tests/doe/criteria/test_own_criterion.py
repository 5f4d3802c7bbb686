"""A criterion of the user's own, in an installed package of theirs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import ClassVar, Self

import numpy as np
import pytest

import doe
from calib import Cell, plugins
from calib.errors import CalibError
from doe import criteria
from doe.criteria.protocol import Question
from doe.criteria.trace import Trace
from tests.doe.plans import unpolished


@dataclass(frozen=True, eq=False)
class Relative(Trace):
    """Mean variance of the parameters, each in its plausible size."""

    name: ClassVar[str] = "relative"
    unit: ClassVar[str] = "trace of the covariance, parameters in plausible sizes"

    @classmethod
    def of(cls, question: Question) -> Self:
        return cls(question.sized.T)


@pytest.fixture(autouse=True)
def _announced(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    entry = EntryPoint("relative", f"{__name__}:Relative", "posecal.criteria")
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry])
    criteria.catalogue.cache_clear()
    yield
    criteria.catalogue.cache_clear()


@pytest.mark.long
def test_a_plan_is_designed_and_proved_by_its_name(kr270: Cell) -> None:
    options = {"candidates": 250}
    own = unpolished(kr270, criterion="relative", **options)
    other = unpolished(kr270, criterion="D", **options)
    sizes = own.problem.model.sizes

    def relative(plan: doe.Design) -> float:
        return float(np.sum((plan.assessment.std / sizes) ** 2))

    assert own.value == pytest.approx(relative(own), rel=1e-6)
    assert own.bound <= own.value <= relative(other)
    assert own.efficiency == pytest.approx(own.bound / own.value)


def test_a_name_that_is_unknown_or_taken(kr270: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(
        CalibError, match=r"criterion: 'B' is unknown; known are task, .*, relative"
    ):
        doe.design(kr270, criterion="B", candidates=10)
    entry = EntryPoint("D", f"{__name__}:Relative", "posecal.criteria")
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry])
    criteria.catalogue.cache_clear()
    with pytest.raises(CalibError, match=r"criterion 'D' of .*: the name is taken"):
        criteria.catalogue()
