"""The figures of a diagnosis hold its numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calib.diagnosis import Diagnosis
from studies.diagnose.error_curve import error_curve
from studies.diagnose.make import diagnose_record
from studies.diagnose.record import CurvePanel, ErrorCurveEntry, Steps
from studies.diagnose.shown import shown
from studies.diagnose.waterfall import waterfall
from studies.document import pictures_of
from studies.kinds import tell
from studies.plots.style import Picture, files, svg_text
from studies.record import envelope
from studies.results import read
from tests.calib.diagnosis.test_error_curve import HALF, found


@pytest.fixture(scope="module")
def result() -> Diagnosis:
    return found("backlash:A3", (HALF,))[0]


@pytest.fixture(scope="module")
def drawn(result: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Picture]:
    file = tmp_path_factory.mktemp("diagnosed") / "d.json"
    record = diagnose_record(result, (), None, shown(result), None, envelope("cell", []))
    file.write_text(record.dumps())
    return {picture.name: picture for picture in pictures_of(tell(read(file)))}


@pytest.mark.long
def test_the_fall_is_that_of_the_gap(result: Diagnosis, drawn: dict[str, Picture]) -> None:
    picture = drawn["waterfall"]
    rows = {str(row[0]): row for row in picture.rows}
    assert result.gap.heldout_before is not None
    assert result.gap.heldout_after is not None
    before, after = 1e3 * result.gap.heldout_before, 1e3 * result.gap.heldout_after
    assert rows["before: model as given"][1] == pytest.approx(before)
    assert rows["backlash:A3"][1:3] == (pytest.approx(after), pytest.approx(after - before))
    assert picture.rows[-1][3] == pytest.approx(1e3 * result.gap.floor)
    assert "held-out poses [mm]" in picture.figure.axes[0].get_xlabel()
    assert rows["after: what is left"][1] == pytest.approx(after)
    assert f"{after / rows['after: what is left'][3]:.2f} times the floor" in picture.caption


@pytest.mark.long
def test_the_curve_has_a_row_for_each_pose(result: Diagnosis, drawn: dict[str, Picture]) -> None:
    picture = drawn["error_1_A3_by_approach_A3"]
    assert [row[0] for row in picture.rows] == list(result.data.poses.names)
    columns = dict(zip(picture.header, zip(*picture.rows, strict=True), strict=True))
    own = np.array(columns["error of A3 [urad], backlash:A3"], dtype=float)
    sign = np.array(columns["last motion of A3, its sign"], dtype=float)
    np.testing.assert_allclose(sign, result.data.poses.approach[:, 2])  # type: ignore[index]
    half = 0.5 * (own[sign > 0].mean() - own[sign < 0].mean())
    assert half == pytest.approx(1e6 * result.causes[0].values[0], rel=1e-6)
    assert "constant part" in picture.caption


@pytest.mark.long
def test_every_picture_is_complete_and_the_same_again(drawn: dict[str, Picture]) -> None:
    assert len(drawn) == 2
    for picture in drawn.values():
        made = files(picture, Path())
        assert made == files(picture, Path())
        assert picture.caption.endswith(".")
        assert "\n" not in "".join(picture.header)
        svg = svg_text(picture)
        assert min(float(s) for s in re.findall(r"font-size: ([\d.]+)px", svg)) >= 9.0
        assert all(len(row) == len(picture.header) for row in picture.rows)


def test_what_makes_it_worse_is_marked() -> None:
    picture = waterfall(
        Steps(of="fitted poses", added=("a:A1", "b:A2"), rms_mm=(0.3, 0.1, 0.2)), 0.05
    )
    labels = [text.get_text() for text in picture.figure.axes[0].texts]
    assert labels == ["0.300", "\N{MINUS SIGN}0.200", "+0.100", "0.200"]
    keys = [text.get_text() for text in picture.figure.legends[0].get_texts()]
    assert keys == ["floor: noise alone, 0.0500 mm", "taken off by an effect", "added by an effect"]
    assert "4.00 times the floor" in picture.caption
    alone = waterfall(Steps(of="held-out poses", added=(), rms_mm=(0.2,)), 0.2)
    assert [row[0] for row in alone.rows] == ["before: model as given"]
    assert "No effect was found" in alone.caption


def test_panels_for_each_direction() -> None:
    rng = np.random.default_rng(0)
    grid, variable = np.linspace(0.0, 1.0, 71), rng.uniform(0.0, 1.0, 40)
    single = [float(np.sin(v)) if v > 0.1 else None for v in variable]
    panels = tuple(
        CurvePanel(
            label=f"base {axis} [um]",
            value=tuple(np.sin(grid).tolist()),
            std=(0.1,) * 71,
            at_poses=tuple(np.sin(variable).tolist()),
            std_at_poses=(0.1,) * 40,
            single=tuple(single),
            effect=tuple(variable.tolist()),
            line=line,
        )
        for axis, line in zip("xyz", (True, False, True), strict=True)
    )
    curve = ErrorCurveEntry(
        name="error",
        title="Error",
        caption="A caption.",
        effect="base_drift:base",
        levels=False,
        variable_label="time [h]",
        grid=tuple(grid.tolist()),
        variable=tuple(variable.tolist()),
        pose_names=tuple(f"p{i}" for i in range(40)),
        panels=panels,
    )
    picture = error_curve(curve)
    visible = [axes for axes in picture.figure.axes if axes.get_visible()]
    assert [axes.get_ylabel() for axes in visible] == [panel.label for panel in panels]
    keys = [text.get_text() for text in picture.figure.legends[0].get_texts()]
    assert {"base_drift:base", "base_drift:base, at each pose", "95 % band"} <= set(keys)
