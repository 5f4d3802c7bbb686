"""Figures: no words collide, equal data give equal bytes, and what is drawn is the data."""

from __future__ import annotations

import re
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

import calib
from calib import Cell
from calib.diagnosis import Diagnosis
from studies import figures
from studies.figures.arm import placed
from studies.figures.parameters import ellipse
from studies.figures.style import log_axis, panels, styled, svg
from studies.render import markdown
from studies.research.picture import picture
from studies.results.base import envelope
from studies.results.diagnose import DiagnoseResult, SpectrumLines, aliases_of
from studies.results.identify import IdentifyResult
from studies.results.parts import joint_array
from studies.results.read import read_as
from tests.calib.test_diagnose import HALF, curve_of
from tests.calib.test_recovered import arm, session
from tests.calib.test_recovered import read as instrument_reads
from tests.calib.test_spectra import mirrored, on_grid, spectra_at, with_ripple
from tests.two_arms import EYE, PLATE, in_view, written

_INSET = 1.0  # pixels at 100 dots per inch: what touches by rounding does not collide
_BESIDE = 1.0  # pixels that words side by side keep apart, else they read as one


def words_of(figure: Figure) -> list[tuple[str, Bbox]]:
    """Every text that is drawn, with its box in pixels at 100 dots per inch."""
    found: list[tuple[str, Bbox]] = []
    draw = Text.draw

    def recorded(self: Text, renderer: object) -> None:
        draw(self, renderer)
        if self.get_visible() and self.get_text().strip():
            found.append((self.get_text(), self.get_window_extent(renderer)))

    figure.set_dpi(100)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # finds the places
    with patch.object(Text, "draw", recorded):
        canvas.draw()
    return found


def collisions(figure: Figure) -> list[tuple[str, str]]:
    """Pairs of texts that overlap, and texts that leave the figure."""
    words = words_of(figure)
    width, height = (100.0 * size for size in figure.get_size_inches())
    beyond = [
        (text, "the edge")
        for text, box in words
        if min(box.x0, box.y0) < -_INSET or box.x1 > width + _INSET or box.y1 > height + _INSET
    ]
    return beyond + [
        (one, other)
        for (one, a), (other, b) in combinations(words, 2)
        if min(a.x1, b.x1) - max(a.x0, b.x0) > -_BESIDE
        and min(a.y1, b.y1) - max(a.y0, b.y0) > _INSET
    ]


@pytest.fixture(scope="module")
def identified(demo_folder: Path) -> IdentifyResult:
    return read_as(demo_folder / "identify.json", IdentifyResult)


@pytest.fixture(scope="module")
def drawn(demo_folder: Path, identified: IdentifyResult) -> dict[str, Figure]:
    """Every figure of the demonstration's identification and diagnosis, by name."""
    cell = calib.load_cell(demo_folder / "cell.toml")
    q = joint_array(cell.robot, identified.conditions)
    diagnosed = read_as(demo_folder / "diagnose.json", DiagnoseResult)
    assert q is not None
    found = {
        "arm": figures.arm(cell, q),
        "errors_by_pose": figures.errors_by_pose(identified),
        "errors_against": figures.errors_against(identified),
        "deviations": figures.deviations(identified),
        "causes": figures.causes(diagnosed),
        "readme": picture(demo_folder),
        **{
            f"{c.where} {c.depends_on}": figures.located_curve(diagnosed, c)
            for c in diagnosed.curves
        },
    }
    return {name: figure for name, figure in found.items() if figure is not None}


def test_no_words_collide_and_none_is_too_small(drawn: dict[str, Figure]) -> None:
    assert len(drawn) >= 6
    for name, figure in drawn.items():
        text = svg(figure, name, "What is seen.")
        sizes = [float(size) for size in re.findall(r"font-size: ([\d.]+)px", text)]
        assert min(sizes) >= 8.0, name
        assert 'role="img" aria-label="What is seen."' in text
        assert "\n\n" not in text
        assert "nan" not in re.findall(r">([^<]*)<", text)
        assert collisions(figure) == [], name


def test_equal_data_give_equal_bytes_whatever_the_settings(identified: IdentifyResult) -> None:
    import matplotlib as mpl

    own = svg(figures.errors_by_pose(identified), "a")
    with mpl.rc_context({"font.size": 30.0, "font.family": "serif", "svg.hashsalt": "other"}):
        assert svg(figures.errors_by_pose(identified), "a") == own
    assert mpl.rcParams["font.size"] == 10.0, "matplotlib's own default, not ours left over"


def test_errors_by_pose_are_those_of_the_residuals(identified: IdentifyResult) -> None:
    (panel,) = figures.errors_by_pose(identified).axes
    after = {line.get_label(): line.get_ydata() for line in panel.lines}
    held = [r for r in identified.residuals if r.heldout]
    rms = np.sqrt(np.mean([np.square(r.vector).sum() for r in held]))
    shown = np.asarray(after["after, held-out poses"])  # three markers at each pose
    assert np.sqrt(np.mean(shown**2)) == pytest.approx(rms)
    assert rms == pytest.approx(identified.rms_mm.heldout)


@pytest.mark.filterwarnings("error")
def test_names_in_any_script_are_drawn_in_silence(identified: IdentifyResult) -> None:
    """Signs that the font lacks, and such as XML may not hold."""
    names = ["\u6e2c\u5b9a", "\N{ROBOT FACE}", "bell\x07"]
    rows = [
        r.model_copy(update={"pose": n}) for r, n in zip(identified.residuals, names, strict=False)
    ]
    fields = {**identified.model_dump(by_alias=True), "residuals": rows}
    small = IdentifyResult.model_validate(fields)
    root = ElementTree.fromstring(svg(figures.errors_by_pose(small), "a"))
    text = "".join(root.itertext())
    assert all(n in text for n in (*names[:2], "bell\N{REPLACEMENT CHARACTER}"))


def test_what_makes_it_worse_is_marked() -> None:
    steps = SimpleNamespace(
        unit="mm", of="fitted poses", added=("a:A1", "b:A2"), rms_mm=(0.3, 0.1, 0.2)
    )
    result: Any = SimpleNamespace(steps=steps, gap=SimpleNamespace(floor_mm=0.05))
    figure = figures.causes(result)
    assert figure is not None
    labels = [text.get_text() for text in figure.axes[0].texts]
    assert labels == ["0.3", "\N{MINUS SIGN}0.2", "+0.1", "0.2"]
    blue, red = (figure.axes[0].patches[k].get_facecolor() for k in (1, 2))
    assert blue != red


def test_ellipse_holds_its_share() -> None:
    C = np.array([[4.0, 1.0], [1.0, 1.0]])
    edge = ellipse(C)
    square = np.einsum("ik,ij,jk->k", edge, np.linalg.inv(C), edge)
    np.testing.assert_allclose(square, -2 * np.log(0.05))
    assert np.isnan(ellipse(np.full((2, 2), np.nan))).all()


def test_every_tip_of_a_tree_is_drawn(tmp_path: Path) -> None:
    cell = calib.load_cell(written(tmp_path, PLATE, EYE))
    figure = figures.arm(cell, in_view(cell, 5).q)
    thick = [line for line in figure.axes[0].lines if line.get_linewidth() == 4.0]
    assert len(thick) == len(cell.robot.tips)
    # The ends of the axes of the eye, a metre off, are no markers.
    assert placed(cell, in_view(cell, 5).q)[1].shape[1] == len(cell.marker_names) - 2
    assert collisions(figure) == []


@styled
def _axis(low: float, high: float) -> list[float]:
    _, (panel,) = panels(3.0, 3.0)
    log_axis(panel.yaxis, [low, high])
    bottom, top = panel.get_ylim()
    assert bottom < low < high < top
    return [tick for tick in panel.yaxis.get_majorticklocs() if bottom <= tick <= top]


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.012, 0.028), (0.0151, 0.0188), (0.3, 40), (1e-4, 10), (0.0002, 0.05), (1.5, 250)],
)
def test_a_log_axis_has_ticks_to_read(low: float, high: float) -> None:
    assert 2 <= len(_axis(low, high)) <= 10


@pytest.fixture(scope="module")
def diagnosis() -> Diagnosis:
    return curve_of("backlash:A3", (HALF,))[0]


@pytest.mark.long
def test_steps_and_curve_are_those_of_the_diagnosis(diagnosis: Diagnosis, kr270: Cell) -> None:
    made = envelope("cell", [])
    result = DiagnoseResult.of(diagnosis, kr270, made)
    gap, steps = result.gap, result.steps
    assert steps is not None
    assert steps.added == ("backlash:A3",)
    assert steps.of == "held-out poses"
    assert steps.rms_mm == pytest.approx((gap.heldout_before_mm, gap.heldout_after_mm))
    (curve,) = result.curves
    assert curve.absorbed
    assert "such as a constant part" in markdown(result, page=True, draw=lambda *own: own[2])
    (panel,) = curve.panels
    own, sign = (np.array(values, dtype=float) for values in (panel.effect, curve.variable))
    np.testing.assert_allclose(sign, diagnosis.data.poses.approach[:, 2])  # type: ignore[index]
    half = 0.5 * (own[sign > 0].mean() - own[sign < 0].mean())
    assert half == pytest.approx(1e6 * diagnosis.causes[0].values[0], rel=1e-6)
    figure = figures.located_curve(result, curve)
    assert [axes.get_ylabel() for axes in figure.axes] == ["error of A3 [urad]"]
    assert result.model_validate_json(result.to_json()) == result


def test_entries_say_aliases() -> None:
    cell, rng = arm(), np.random.default_rng(9)
    poses = on_grid(session(cell, rng, 90), 1)
    data = instrument_reads(cell, poses, rng, with_ripple(poses, 1, 100.0, 6e-5))
    seen = list(spectra_at(cell, data, [("j2", 100.0)]).values())
    for spectrum in seen:
        assert len(SpectrumLines.of(spectrum).lines) == len(spectrum.lines)
    (cycles,) = (c for c, _ in seen[1].named)
    assert aliases_of("j1", cycles, seen) == ()
    np.testing.assert_allclose(np.sort(aliases_of("j2", cycles, seen)), mirrored(cycles), atol=0.1)
