"""The figures of a diagnosis hold its numbers, and its record those of spectra."""

from __future__ import annotations

import numpy as np
import pytest

from calib.diagnosis import Diagnosis
from studies.diagnose.make import aliases_of, diagnose_record, shown, spectrum_entry
from studies.diagnose.pictures import waterfall
from studies.diagnose.record import ErrorSteps
from studies.document import pictures_of
from studies.kinds import tell
from studies.plots.style import Picture
from studies.record import envelope
from studies.results.read import read
from tests.calib.diagnosis.test_error_curve import HALF, found
from tests.calib.diagnosis.test_spectra import mirrored, on_grid, spectra_at, with_ripple
from tests.calib.identification.test_identify_tunings import arm, session
from tests.calib.identification.test_identify_tunings import read as instrument_reads


@pytest.fixture(scope="module")
def result() -> Diagnosis:
    return found("backlash:A3", (HALF,))[0]


@pytest.fixture(scope="module")
def drawn(result: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Picture]:
    file = tmp_path_factory.mktemp("diagnosed") / "d.json"
    record = diagnose_record(result, envelope("cell", []), shown=shown(result))
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


def test_what_makes_it_worse_is_marked() -> None:
    picture = waterfall(
        ErrorSteps(unit="mm", of="fitted poses", added=("a:A1", "b:A2"), rms_mm=(0.3, 0.1, 0.2)),
        0.05,
    )
    labels = [text.get_text() for text in picture.figure.axes[0].texts]
    assert labels == ["0.300", "\N{MINUS SIGN}0.200", "+0.100", "0.200"]
    keys = [text.get_text() for text in picture.figure.legends[0].get_texts()]
    assert keys == ["floor: noise alone, 0.0500 mm", "taken off by an effect", "added by an effect"]
    assert "4.00 times the floor" in picture.caption
    alone = waterfall(ErrorSteps(unit="mm", of="held-out poses", added=(), rms_mm=(0.2,)), 0.2)
    assert [row[0] for row in alone.rows] == ["before: model as given"]
    assert "No effect was found" in alone.caption


def test_entries_say_aliases() -> None:
    cell, rng = arm(), np.random.default_rng(9)
    poses = on_grid(session(cell, rng, 90), 1)
    data = instrument_reads(cell, poses, rng, with_ripple(poses, 1, 100.0, 6e-5))
    found = list(spectra_at(cell, data, [("j2", 100.0)]).values())
    for spectrum in found:
        assert len(spectrum_entry(spectrum).lines) == len(spectrum.lines)
    (cycles,) = (c for c, _ in found[1].named)
    assert aliases_of("j1", cycles, found) == ()
    np.testing.assert_allclose(np.sort(aliases_of("j2", cycles, found)), mirrored(cycles), atol=0.1)
