"""The example of ``posecal explain python`` runs as it stands, and what it prints is short."""

from __future__ import annotations

import contextlib
import io
import re
from dataclasses import replace
from importlib.resources import files
from typing import Any

import numpy as np
import pytest

import calib
import doe
from calib.result import Result
from studies.demo.embedded import embedded_text

PAGE = (files("studies.explain") / "topics" / "python.md").read_text(encoding="utf-8")
MOST_LINES = 20


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("day")
    (folder / "arm.urdf").write_text(embedded_text("kr270.urdf"))
    met: dict[str, Any] = {}
    code = "\n".join(re.findall(r"^    (.*)$", PAGE, flags=re.M)).replace(
        "arm.urdf", f"{folder}/arm.urdf"
    )
    with contextlib.redirect_stdout(io.StringIO()) as said:
        exec(compile(code, "python.md", "exec"), met)
    return met | {"said": said.getvalue()}


def test_the_day_finds_what_was_put_in(day: dict[str, Any]) -> None:
    assert day["plan"].efficiency > 0.9
    assert (day["cause"].name, day["cause"].where) == ("backlash", "A3")
    assert day["cause"].probability > 0.9
    assert day["corrected"].rms(day["corrected"].expected) < 5e-5
    assert len(day["said"].splitlines()) < 5 * MOST_LINES


@pytest.mark.parametrize(
    "name", ["plan", "result", "diagnosis", "corrected", "data", "cell", "robot"]
)
def test_a_repr_is_short(day: dict[str, Any], name: str) -> None:
    text = repr(day[name])
    assert 0 < len(text.splitlines()) <= MOST_LINES
    assert len(text) < 3000


@pytest.mark.parametrize("name", ["plan", "result", "diagnosis", "corrected", "data"])
def test_a_result_tells_itself(day: dict[str, Any], name: str) -> None:
    found = day[name]
    assert isinstance(found, Result)
    assert found.summary().startswith(found.sentences()[0])
    rows = found.rows()
    assert rows
    assert all(row.keys() == rows[0].keys() for row in rows)
    page = found._repr_html_()
    assert page.count("<tr>") == len(rows) + 1


def test_forecasts_are_short(day: dict[str, Any]) -> None:
    enough = doe.enough(day["cell"], day["data"], goal=1e-4)
    foreseen = doe.foresee(day["cell"], day["plan"].poses)
    further = doe.next_poses(day["cell"], day["diagnosis"])
    for found in (enough, foreseen, further):
        assert len(repr(found).splitlines()) <= MOST_LINES
        assert found.rows() or found is further


def test_what_was_not_estimated_has_no_deviation(day: dict[str, Any]) -> None:
    """Three configurations, each read twice, without what errors usually are."""
    cell = replace(day["cell"], size_prior="off")
    alone = calib.identify(cell, day["data"].take(np.array([0, 1, 2, 0, 1, 2])))
    assert alone.status == "rank_deficient"
    assert np.isnan(alone.std).any()
    assert not (alone.std == 0.0).any()


def test_the_page_names_what_is_public() -> None:
    for face in (calib, doe):
        for name in face.__all__:
            assert f"`{name}`" in PAGE, name
    assert "typing" not in dir(calib)
    assert "Any" not in dir(calib)


def test_a_data_frame_where_pandas_is(day: dict[str, Any]) -> None:
    pandas = pytest.importorskip("pandas")
    frame = day["result"].to_frame()
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame.columns) == ["parameter", "value", "std", "unit"]


@pytest.mark.parametrize(
    ("markers", "more", "said"),
    [
        ({"m1": (0.1, 0.0)}, {}, "three coordinates"),
        (np.zeros((2, 3)), {"pay_load": 3.0}, "a cell has no 'pay_load'"),
    ],
)
def test_what_a_cell_refuses(
    day: dict[str, Any], markers: Any, more: dict[str, Any], said: str
) -> None:
    with pytest.raises(calib.CalibError, match=said):
        calib.Cell(day["robot"], markers, **more)
