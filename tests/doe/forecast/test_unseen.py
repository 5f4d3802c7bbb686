"""Arms with something that no model holds: what is called reached must then come."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arrays import Array
from calib.prediction.estimate import fitted_of
from doe.forecast.enough import Enough, enough
from doe.forecast.unseen import at_ends, at_held_out
from studies.research.truth.day import Day, Setting, draw_day, write_day

_POSES, _DAYS = 40, 10
_HERE = Setting("6R", 0.0, 1, _POSES, 3)


def warming(rng: np.random.Generator) -> Callable[[Array], Array]:
    """Zeros of the joints that wander through the day, and stay where they were at its end."""
    far, tau = rng.normal(size=6) * 4e-5, rng.uniform(0.3, 2.0)

    def truth(q: Array) -> Array:
        at = np.arange(len(q)) / _POSES if len(q) == _POSES else np.ones(len(q))
        return np.asarray(q + far * (1.0 - np.exp(-at / tau))[:, None])

    return truth


def sagging(rng: np.random.Generator) -> Callable[[Array], Array]:
    """Shoulder and elbow that give way as no link of the model does."""
    size = rng.uniform(0.5e-4, 3e-4, 2)

    def truth(q: Array) -> Array:
        moved, arm = q.copy(), q[:, 1] + q[:, 2]
        moved[:, 1] += size[0] * np.sin(2.0 * q[:, 1]) + size[1] * np.cos(arm)
        moved[:, 2] += size[1] * np.sin(arm) * np.abs(np.sin(arm))
        return moved

    return truth


def asked(folder: Path, day: Day) -> tuple[Enough, float]:
    """What is said of a day, and by how much fresh poses then miss, RMS, m."""
    write_day(folder, day)
    cell = calib.load_cell(folder / "cell.toml")
    answer = enough(cell, calib.load_measurements(cell, folder / "measurements.csv"))
    assert answer.found is not None
    targets, _ = calib.load_targets(cell, folder / "targets.csv")
    off = answer.found.predict(targets) - day.approached
    return answer, float(np.sqrt((off**2).sum(axis=-1).mean()))


@pytest.mark.long
@pytest.mark.parametrize("effect", [warming, sagging])
def test_what_is_called_reached_comes(
    tmp_path: Path, effect: Callable[[np.random.Generator], Callable[[Array], Array]]
) -> None:
    """Once in twenty may be wrong: of ten days, three would be a hundred to one against that."""
    wrong, promised = 0, []
    for index in range(_DAYS):
        rng = np.random.default_rng([index, 77])
        answer, came = asked(tmp_path, draw_day(_HERE, index, 5, effect(rng)))
        wrong += came > answer.steps[0].task_most
        promised.append(came / answer.steps[0].task_rms)
        assert answer.steps[0].task_most >= answer.lacking.seen.rms
    assert wrong <= 2
    assert np.sqrt(np.mean(np.square(promised))) < 1.2


@pytest.mark.long
def test_a_day_that_lacks_nothing_is_promised_nothing_more(tmp_path: Path) -> None:
    answer, came = asked(tmp_path, draw_day(_HERE, 0, 5))
    assert answer.lacking.rms == 0.0
    assert answer.steps[0].task_rms == pytest.approx(came, rel=0.4)
    assert answer.steps[0].task_most < 2.0 * came


def test_the_ends_of_the_day_are_those_of_refits(tmp_path: Path) -> None:
    """A third is taken away and the rest identified: what it then misses by was foreseen."""
    day = draw_day(Setting("6R", 0.0, 1, 45, 3), 3, 5, warming(np.random.default_rng(3)))
    write_day(tmp_path, day)
    cell = calib.load_cell(tmp_path / "cell.toml")
    data = calib.load_measurements(cell, tmp_path / "measurements.csv")
    found = calib.identify(cell, data)
    assert not found.fit.outlier.any()
    fit = fitted_of(found)
    foreseen = at_ends(fit)
    assert foreseen is not None
    noise = 3.0 * fit.sigma**2
    came = []
    for end in (np.arange(15), np.arange(30, 45)):
        rest = calib.identify(cell, data.take(np.setdiff1d(np.arange(45), end)))
        off = data.take(end).points - rest.predict(data.take(end).poses)
        came.append(float((off**2).sum(axis=-1).mean()))
    assert min(abs(foreseen.rms / np.sqrt(np.array(came) - noise) - 1.0)) < 0.02
    assert foreseen.lacking <= foreseen.rms


def test_held_out_poses_are_what_was_measured_there(tmp_path: Path) -> None:
    day = draw_day(Setting("6R", 0.0, 1, 45, 3), 4, 5, sagging(np.random.default_rng(4)))
    write_day(tmp_path, day)
    cell = calib.load_cell(tmp_path / "cell.toml")
    data = calib.load_measurements(cell, tmp_path / "measurements.csv")
    own, held = data.take(slice(0, 30)), data.take(slice(30, 45))
    answer = enough(cell, own, heldout=held)
    assert answer.found is not None
    off = held.points - answer.found.predict(held.poses)
    missed = float((off**2).sum(axis=-1).mean())
    fit = fitted_of(answer.found)
    assert at_held_out(fit, held).rms == pytest.approx(np.sqrt(missed - 3.0 * fit.sigma**2))
    assert answer.steps[0].task_most >= answer.lacking.seen.rms
    assert enough(cell, own, heldout=held, goal=0.99 * answer.lacking.seen.rms).needed is None
