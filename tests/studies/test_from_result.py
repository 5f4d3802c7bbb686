"""Records filled from results: copies, units, shapes, and what no result tells."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from pydantic import Field, ValidationError

from calib.inference.coverage import Interval
from studies.record import (
    OWN_UNIT,
    Count,
    Entry,
    From,
    IntervalEntry,
    Maybe,
    Number,
    Three,
)


class Inner(Entry):
    name: str
    off_um: Maybe


class Outer(Entry):
    kind: Literal["outer"] = "outer"
    count: Count
    rms_mm: Maybe
    shift_um_per_h: Three
    matrix_si: tuple[tuple[Number, ...], ...] = Field(alias="matrix_SI")
    inner: Inner | None
    rows: tuple[Inner, ...] = ()
    by_name: dict[str, Inner]
    share_percent: Number


INNER = SimpleNamespace(name="a", off=np.float64(2e-6))
RESULT = SimpleNamespace(
    count=np.int64(3), rms=0.5, shift=np.array([1.0, 2.0, 3.0]) / 3.6e9, matrix=np.eye(2),
    inner=None, rows=[INNER, INNER], by_name={"x": INNER}, share=0.25,
)  # fmt: skip


def test_fields_are_copied_scaled_and_shaped_by_their_names() -> None:
    made = Outer.from_result(RESULT)
    inner = Inner(name="a", off_um=2.0)
    assert (made.count, made.rms_mm, made.share_percent) == (3, 500.0, 25.0)
    assert made.shift_um_per_h == pytest.approx((1.0, 2.0, 3.0))
    assert made.matrix_si == ((1.0, 0.0), (0.0, 1.0))
    assert (made.inner, made.rows, made.by_name) == (None, (inner, inner), {"x": inner})


@pytest.mark.parametrize(
    ("own", "field", "value"),
    [
        ({"rms_mm": float("nan")}, "rms_mm", None),
        ({"rms_mm": 7.0}, "rms_mm", 7.0),  # in the unit of the entry
        ({"inner": INNER}, "inner", Inner(name="a", off_um=2.0)),
        ({"rows": iter([INNER])}, "rows", (Inner(name="a", off_um=2.0),)),
        ({"matrix_si": np.zeros((1, 1))}, "matrix_si", ((0.0,),)),
    ],
)
def test_what_is_given_stands_before_what_a_result_has(
    own: dict[str, Any], field: str, value: Any
) -> None:
    assert getattr(Outer.from_result(RESULT, **own), field) == value


def test_what_no_result_tells_is_an_error_and_not_a_default() -> None:
    told = {key: value for key, value in vars(RESULT).items() if key not in ("rows", "rms")}
    with pytest.raises(TypeError, match="tells Outer of rms_mm, rows"):
        Outer.from_result(SimpleNamespace(**told))
    with pytest.raises(TypeError, match="Outer has no colour"):
        Outer.from_result(RESULT, colour="red")
    with pytest.raises(ValidationError, match="shift_um_per_h"):
        Outer.from_result(RESULT, shift_um_per_h=np.zeros(4))


class Placed(Entry):
    name: str
    value: Annotated[Number, OWN_UNIT]
    after_um: Annotated[Maybe, From("moves.1")]
    of: Annotated[str | None, From("owner.name")]
    within_mm: Annotated[IntervalEntry | None, From("span")]


SCALED = SimpleNamespace(name="rz", scale=1e-3, owner=SimpleNamespace(name="base"))
SPAN = Interval(1e-3, 0.0, np.inf)


def test_a_field_says_where_it_comes_from() -> None:
    """By a path, in the unit that the result names, and an interval in the unit of its field."""
    found = {"value": 0.25, "moves": (0.0, 2e-6), "span": SPAN}
    made = Placed.from_result(found, SCALED)
    assert (made.value, made.after_um, made.of) == (250.0, 2.0, "base")
    assert made.within_mm == IntervalEntry(value=1.0, low=0.0, high=None)
    nothing = Placed.from_result({**found, "moves": None, "span": None, "owner": None}, SCALED)
    assert (nothing.after_um, nothing.within_mm, nothing.of) == (None, None, None)


def test_columns_fill_an_entry_for_each() -> None:
    moves, spans = np.array([[0.0, 1e-6], [0.0, np.nan]]), [None, SPAN]
    made = Placed.from_each([SCALED] * 2, value=np.array([1.0, 2.0]), moves=moves, span=spans)
    assert [(own.value, own.after_um) for own in made] == [(1000.0, 1.0), (2000.0, None)]
    assert [own.within_mm for own in made] == [None, IntervalEntry(value=1.0, low=0.0, high=None)]
    with pytest.raises(ValueError, match="shorter"):
        Placed.from_each([SCALED], value=[], moves=moves, span=spans)
