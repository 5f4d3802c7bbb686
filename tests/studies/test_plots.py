"""Figures by their structure: labels with units, tables equal to the data, equal bytes on repeat."""

from __future__ import annotations

import csv
import io
import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from studies.compare.agreement import band
from studies.plots.deviations import by_approach
from studies.plots.ellipses import ellipse, ellipses
from studies.plots.style import (
    APPROACHES,
    RC,
    SERIES,
    Picture,
    files,
    log_ticks,
    looks,
    svg_text,
)

NAMES = ["geometry:A2.x", "geometry:A3.x", "joint_compliance:A2.compliance"]
UNITS = ["um", "um", "urad/(N m)"]
STD = {"pose plain": np.array([2.0, np.nan, 0.004]), "points": np.array([1.0, 3.0, 0.001])}


@cache
def _deviations() -> Picture:
    return by_approach(NAMES, UNITS, STD)


@cache
def _ellipses() -> Picture:
    C = np.array([[[4.0, 1.0], [1.0, 1.0]], [[np.nan, np.nan], [np.nan, 1.0]]])
    pairs = [("dl1", "mm", "dq1", "mdeg"), ("dl2", "mm", "dq2", "mdeg")]
    return ellipses(pairs, {"points": C})


def table(picture: Picture) -> list[dict[str, str]]:
    """The CSV as it is written, by column."""
    text = files(picture, Path())[Path(f"{picture.name}.csv")]
    assert isinstance(text, str)
    return list(csv.DictReader(io.StringIO(text)))


def column(picture: Picture, name: str) -> list[Any]:
    """One column of the table before it is written."""
    return [row[picture.header.index(name)] for row in picture.rows]


def test_equal_data_give_equal_bytes() -> None:
    first, second = _deviations(), _deviations.__wrapped__()
    made = files(first, Path())
    assert made == files(first, Path())
    assert made == files(second, Path())


def test_approaches_look_different_without_colour() -> None:
    for field in ("marker", "linestyle", "hatch", "color", "sign"):
        assert len({getattr(look, field) for look in APPROACHES.values()}) == len(APPROACHES)
        assert len({str(getattr(look, field)) for look in SERIES}) == len(SERIES)
    mixed = looks(["points", "own", "other"])
    assert mixed["points"] is APPROACHES["points"]
    assert len({look.color for look in mixed.values()}) == 3


def test_user_settings_do_not_reach_the_figures() -> None:
    import matplotlib as mpl

    with mpl.rc_context({"font.size": 30.0, "font.family": "serif", "svg.hashsalt": "other"}):
        own = svg_text(_ellipses.__wrapped__())
    assert own == svg_text(_ellipses())
    assert (
        mpl.rcParams["font.size"] == RC["font.size"]
    )  # matplotlib's own default, not ours left over


def test_deviations_are_the_data() -> None:
    picture = _deviations()
    assert column(picture, "#2 points") == list(STD["points"])
    assert column(picture, "#1 pose, plain") == [2.0, None, 0.004]
    assert column(picture, "#1 pose, plain / #2 points") == [2.0, None, pytest.approx(4.0)]
    assert table(picture)[1]["#1 pose, plain"] == ""
    assert "cannot estimate" in picture.caption
    panels = [axes for axes in picture.figure.axes if axes.get_xlabel()]
    assert [axes.get_xlabel() for axes in panels] == [
        f"standard deviation [{u}]" for u in ("um", UNITS[2])
    ]


def test_band_of_chance_is_that_of_samples(rng: np.random.Generator) -> None:
    low, high = band(40)
    std = rng.normal(size=(20000, 40)).std(axis=1, ddof=1)
    assert np.mean((std > low) & (std < high)) == pytest.approx(0.95, abs=0.006)


def test_ellipse_holds_its_share() -> None:
    C = np.array([[4.0, 1.0], [1.0, 1.0]])
    edge = ellipse(C)
    np.testing.assert_allclose(
        np.einsum("ki,ij,kj->k", edge, np.linalg.inv(C), edge), -2 * np.log(0.05)
    )
    rows = table(_ellipses())
    assert float(rows[0]["correlation"]) == pytest.approx(0.5)
    assert rows[1]["correlation"] == ""


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.012, 0.028), (0.0151, 0.0188), (0.3, 40), (1e-4, 10), (0.0002, 0.05), (1.5, 250)],
)
def test_a_log_axis_has_ticks_to_read(low: float, high: float) -> None:
    panel = Figure().subplots()
    panel.set(yscale="log", ylim=(low, high))
    log_ticks(panel.yaxis, low, high)
    ticks = [tick for tick in panel.yaxis.get_majorticklocs() if low <= tick <= high]
    assert 3 <= len(ticks) <= 10
    gaps = np.diff(np.log10(ticks)) / math.log10(high / low)
    assert min(gaps) > 0.05, "labels do not meet"
