"""Figures by their structure: labels with units, tables equal to the data, equal bytes on repeat."""

from __future__ import annotations

import csv
import io
import math
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

from studies.compare.agreement import band
from studies.plots.accuracy import against_number
from studies.plots.deviations import by_approach, predicted_against_simulated
from studies.plots.ellipses import correlation, correlations
from studies.plots.errors import histogram
from studies.plots.residuals import by_pose_and_axis
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
def _ratios() -> Picture:
    simulated = {key: 1.05 * value for key, value in STD.items()}
    return predicted_against_simulated(NAMES, UNITS, STD, simulated, 200, band(200))


@cache
def _correlation() -> Picture:
    return correlation(NAMES, np.array([[4.0, 1.9, 0.0], [1.9, 1.0, 0.0], [0.0, 0.0, 0.0]]))


@cache
def _accuracy() -> Picture:
    return against_number([3, 6, 12], {"points": np.array([np.nan, 2e-5, 1e-5])})


@cache
def _residuals() -> Picture:
    residuals = np.random.default_rng(5).normal(size=(4, 2, 3)) * 1e-5
    residuals[2, 0, 1] = 1e-3
    seen = np.ones((4, 2), dtype=bool)
    seen[3] = False
    outliers = np.array([False, False, True, False])
    return by_pose_and_axis(["p1", "p2", "p3", "p4"], residuals, seen, ["m1", "m2"], 1e-5, outliers)


def table(picture: Picture) -> list[dict[str, str]]:
    """The CSV as it is written, by column."""
    text = files(picture, Path())[Path(f"{picture.name}.csv")]
    assert isinstance(text, str)
    return list(csv.DictReader(io.StringIO(text)))


def column(picture: Picture, name: str) -> list[Any]:
    """One column of the table before it is written."""
    return [row[picture.header.index(name)] for row in picture.rows]


def test_equal_data_give_equal_bytes() -> None:
    first, second = _ratios(), _ratios.__wrapped__()
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
        own = svg_text(_accuracy.__wrapped__())
    assert own == svg_text(_accuracy())
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
    assert column(_ratios(), "#2 points: ratio") == pytest.approx([1.05] * 3)


def test_correlation_is_that_of_the_covariance() -> None:
    picture = _correlation()
    assert picture.rows[0] == (NAMES[0], NAMES[1], pytest.approx(0.95))
    assert np.isnan(correlations(np.diag([1.0, 0.0]))[1, 1])
    image = picture.figure.axes[0].images[0]
    assert image.get_clim() == (-1.0, 1.0)


def test_residuals_mark_what_is_outside() -> None:
    picture = _residuals()
    panels = picture.figure.axes
    assert [axes.get_ylabel() for axes in panels] == ["x [mm]", "y [mm]", "z [mm]"]
    assert len({axes.get_ylim() for axes in panels}) == 1
    assert panels[0].get_ylim()[1] < 0.1  # an outlier of a millimetre does not set the scale
    assert picture.rows[2][1:] == (
        pytest.approx(0.71, abs=0.01),
        pytest.approx(1.0),
        "y",
        "m1",
        "yes",
    )
    assert picture.rows[3] == ("p4", None, None, None, None, "")


@pytest.mark.filterwarnings("error")
def test_names_in_any_script_are_drawn_in_silence() -> None:
    """Signs that the font lacks, and such as XML may not hold."""
    names = ["\u6e2c\u5b9a", "\N{ROBOT FACE}", "bell\x07"]
    seen = np.ones((3, 1), dtype=bool)
    picture = by_pose_and_axis(
        names, np.full((3, 1, 3), 1e-5), seen, ["m1"], 1e-5, np.zeros(3, dtype=bool)
    )
    text = "".join(ElementTree.fromstring(svg_text(picture)).itertext())
    assert all(
        name in text for name in ("\u6e2c\u5b9a", "\N{ROBOT FACE}", "bell\N{REPLACEMENT CHARACTER}")
    )


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


def test_the_first_bin_holds_no_others() -> None:
    """Points far below those of the nominal model have bins of their own."""
    rng = np.random.default_rng(0)
    before, after = rng.normal(0, 5e-3, (400, 3)), rng.normal(0, 5e-7, (400, 3))
    picture = histogram(before, after, 1e-6)
    below = picture.figure.axes[1]
    heights = [bar.get_height() for bar in below.patches]
    assert sum(heights) == 400
    assert heights[0] < 0.25 * max(heights)
