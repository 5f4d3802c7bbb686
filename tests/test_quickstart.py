"""The example of ``posecal explain python`` runs as it stands, and what it prints is short."""

from __future__ import annotations

import contextlib
import io
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import calib
import doe
from calib.result import Result
from studies.command.explain import page
from studies.demo.embedded import embedded_text

PAGE = page("python")
MOST_LINES = 20


@pytest.fixture(scope="module")
def python_day(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("day")
    (folder / "arm.urdf").write_text(embedded_text("kr270.urdf"))
    met: dict[str, Any] = {}
    code = "\n".join(re.findall(r"^    (.*)$", PAGE, flags=re.M)).replace(
        "arm.urdf", f"{folder}/arm.urdf"
    )
    with contextlib.redirect_stdout(io.StringIO()) as said:
        exec(compile(code, "python.md", "exec"), met)
    return met | {"said": said.getvalue()}


def test_the_day_finds_what_was_put_in(python_day: dict[str, Any]) -> None:
    assert python_day["plan"].efficiency > 0.9
    assert (python_day["cause"].name, python_day["cause"].where) == ("backlash", "A3")
    assert python_day["cause"].probability > 0.9
    corrected = python_day["corrected"]
    free = np.array(corrected.limited_by) == ""  # poses of a plan may stand at the end of a joint
    assert free.sum() > len(free) // 2
    assert corrected.expected[free].max() < 5e-5
    assert len(python_day["said"].splitlines()) < 5 * MOST_LINES


def test_a_result_tells_itself_and_its_repr_is_short(python_day: dict[str, Any]) -> None:
    for name in ("plan", "result", "diagnosis", "corrected", "data", "cell", "robot"):
        found = python_day[name]
        text = repr(found)
        assert 0 < len(text.splitlines()) <= MOST_LINES, name
        assert len(text) < 3000, name
        if name in ("cell", "robot"):
            continue
        assert isinstance(found, Result)
        assert found.summary().startswith(found.sentences()[0])
        rows = found.rows()
        assert rows
        assert all(row.keys() == rows[0].keys() for row in rows)
        assert found._repr_html_().count("<tr>") == len(rows) + 1, name


def test_forecasts_are_short(python_day: dict[str, Any]) -> None:
    enough = doe.enough(python_day["cell"], python_day["data"], goal=1e-4)
    foreseen = doe.foresee(python_day["cell"], python_day["plan"].poses)
    for found in (enough, foreseen):
        assert len(repr(found).splitlines()) <= MOST_LINES
        assert found.rows()


def test_what_was_not_estimated_has_no_deviation(python_day: dict[str, Any]) -> None:
    """Three configurations, each read twice, without what errors usually are."""
    cell = replace(python_day["cell"], size_prior="off")
    alone = calib.identify(cell, python_day["data"].take(np.array([0, 1, 2, 0, 1, 2])))
    assert alone.status == "rank_deficient"
    assert np.isnan(alone.std).any()
    assert not (alone.std == 0.0).any()


def test_the_page_names_what_is_public() -> None:
    for face in (calib, doe):
        for name in face.__all__:
            assert f"`{name}`" in PAGE, name
    assert "typing" not in dir(calib)
    assert "Any" not in dir(calib)


def test_a_data_frame_where_pandas_is(python_day: dict[str, Any]) -> None:
    pandas = pytest.importorskip("pandas")
    frame = python_day["result"].to_frame()
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame.columns) == ["parameter", "value", "std", "unit"]


@pytest.mark.parametrize(
    ("markers", "more", "said"),
    [
        ({"m1": (0.1, 0.0)}, {}, "three finite coordinates"),
        (np.zeros((2, 3)), {"pay_load": 3.0}, "a cell has no 'pay_load'"),
    ],
)
def test_what_a_cell_refuses(
    kr270: calib.Cell, markers: Any, more: dict[str, Any], said: str
) -> None:
    with pytest.raises(calib.CalibError, match=said):
        calib.Cell(kr270.robot, markers, **more)
