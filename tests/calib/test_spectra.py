"""Lines in the spectrum of each joint, against arms of a plain simulator with known ripples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from calib import Cell, Measurements
from calib.arrays import Array
from calib.diagnosis.spectra import Spectrum, spectra_of
from calib.effects.ripple import GearRipple
from calib.model.build import context_of
from calib.poses import Poses
from tests.calib.test_recovered import arm, off_at, read, session
from tests.helpers import stage_of

STEP = np.radians(10.0)
MIRROR = 36.0  # cycles a turn that steps of 10 degrees cannot tell from none


def spectra_at(
    cell: Cell, data: Measurements, ripples: Sequence[tuple[str, float]] = ()
) -> dict[str, Spectrum]:
    """At a fit of the cell's model, with ripples beside it, without any selection."""
    stage, context = stage_of(cell, data), context_of(cell, data.poses)
    tuned = [GearRipple.at(context, where).tuned(cycles) for where, cycles in ripples]
    return {s.joint: s for s in spectra_of(stage, stage.fit(tuned))}


def with_ripple(
    poses: Poses, joint: int, cycles: float, amplitude: float, phase: float = 0.7
) -> Array:
    return off_at(poses, joint, amplitude * np.cos(cycles * poses.q[:, joint] + phase))


def on_grid(poses: Poses, joint: int) -> Poses:
    q = poses.q.copy()
    q[:, joint] = np.round(q[:, joint] / STEP) * STEP
    return replace(poses, q=q)


def mirrored(cycles: float) -> Array:
    """All that is equal at steps of 10 degrees, itself left out."""
    k = np.arange(-20, 21) * MIRROR
    every = np.unique(np.round(np.abs(np.concatenate([k + cycles, k - cycles])), 9))
    return every[(every < 449.0) & (np.abs(every - cycles) > 1e-6)]


@pytest.mark.long
def test_lines_of_two_joints_with_their_amplitudes() -> None:
    """Also that their errors are as large as stated where all of them is in the model."""
    cell, beyond = arm(), []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        poses = session(cell, rng, 70)
        true = {"j1": (rng.uniform(20.0, 400.0), 3e-5), "j3": (rng.uniform(20.0, 400.0), 6e-5)}
        dq = sum(with_ripple(poses, int(j[1]) - 1, *line) for j, line in true.items())
        data = read(cell, poses, rng, dq)
        assert spectra_at(cell, data)["j3"].lines
        found = spectra_at(cell, data, [(joint, cycles) for joint, (cycles, _) in true.items()])
        assert not found["j2"].lines
        assert not found["j4"].lines
        for joint, (cycles, amplitude) in true.items():
            own = found[joint]
            (line,) = own.lines
            beyond.append((line.cycles - cycles) / line.std)
            beyond.append((line.amplitude - amplitude) / line.amplitude_std)
            assert abs(line.cycles - cycles) < 0.2 * own.width
            assert line.ratios == (0.5 * line.cycles, line.cycles)
            assert not line.aliases
            assert abs(own.cycles[np.argmax(own.fall)] - cycles) < own.width
    assert np.abs(beyond).max() < 3.5
    assert 0.75 < np.std(beyond) < 1.3


@pytest.mark.long
def test_noise_passes_the_false_alarm_seldom() -> None:
    cell, alarms, falls = arm(), 0, []
    for seed in range(40):
        rng = np.random.default_rng(100 + seed)
        found = spectra_at(cell, read(cell, session(cell, rng, 60), rng)).values()
        alarms += any((s.fall > s.false_alarm).any() for s in found)
        assert all((s.fall > s.false_alarm).any() or not s.lines for s in found)
        falls.append(np.concatenate([s.fall[s.cycles > 5.0] for s in found]))
    assert alarms <= 2  # of 0.4 to be expected at most
    every = np.concatenate(falls)
    assert np.median(every) == pytest.approx(2.0 * np.log(2.0), rel=0.05)  # chi-square of two
    assert every.mean() == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize(("cycles", "amplitude"), [(100.0, 6e-5), (240.0, 6e-5), (2.0, 2e-4)])
def test_what_a_grid_cannot_tell_is_said(cycles: float, amplitude: float) -> None:
    """A slow error is no line where the grid mirrors it."""
    cell, rng = arm(), np.random.default_rng(5 if cycles > 2.0 else 6)
    poses = on_grid(session(cell, rng, 90), 1)
    found = spectra_at(cell, read(cell, poses, rng, with_ripple(poses, 1, cycles, amplitude)))
    own = found["j2"]
    assert found["j1"].repeats is None
    assert own.repeats == pytest.approx(MIRROR, abs=0.02)
    if cycles == 2.0:
        mirror = np.abs(own.cycles - (MIRROR - cycles)) < 0.5
        assert own.fall[mirror].max() > 2.0 * own.false_alarm
        assert not own.lines
        return
    (line,) = own.lines
    alike = np.sort([line.cycles, *line.aliases])
    np.testing.assert_allclose(alike, np.sort([cycles, *mirrored(cycles)]), atol=0.1)


def test_the_second_line_of_a_joint_and_not_the_chance_peaks_of_the_first() -> None:
    cell, rng = arm(), np.random.default_rng(7)
    poses = session(cell, rng, 90)
    dq = with_ripple(poses, 2, 120.0, 4e-4) + with_ripple(poses, 2, 240.0, 5e-5)
    found = spectra_at(cell, read(cell, poses, rng, dq), [("j3", 120.0)])["j3"]
    lines = zip(found.lines, ((120.0, 0.1, 4e-4), (240.0, 0.3, 5e-5)), strict=True)
    for line, (cycles, within, amplitude) in lines:
        assert line.cycles == pytest.approx(cycles, abs=within)
        assert abs(line.amplitude - amplitude) < 3.0 * line.amplitude_std
    assert (found.fall > found.false_alarm).sum() > 20  # what it would be fallen for


def test_a_ripple_of_the_model_shows_and_does_not_leak() -> None:
    cell, rng = arm(), np.random.default_rng(8)
    poses = session(cell, rng, 70)
    data = read(cell, poses, rng, with_ripple(poses, 2, 120.0, 4e-4))
    found = spectra_at(cell, data, [("j3", 120.0)])
    (line,) = found["j3"].lines
    assert abs(line.cycles - 120.0) < 4.0 * line.std
    assert abs(line.amplitude - 4e-4) < 3.0 * line.amplitude_std
    assert found["j3"].named == ((pytest.approx(line.cycles, abs=0.05), ()),)
    for joint in ("j1", "j2", "j4"):
        assert found[joint].fall.max() < found[joint].false_alarm
        assert not found[joint].named
