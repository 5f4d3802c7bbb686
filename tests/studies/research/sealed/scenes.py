"""Small scenes for the tests of the withheld cases."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import calib
from calib import Cell, Measurements
from studies.research.sealed.draw import Case
from studies.research.sealed.key import write_case
from studies.research.truth.arms import Arm
from studies.research.truth.causes import Cause
from studies.research.truth.conditions import Conditions
from studies.research.truth.scene import Scene, at_rest, draw_scene

PLAIN = Conditions(configurations=15, known_geometry=True, payload=True)


def scene_of(arm: Arm, seed: int = 0) -> Scene:
    """A scene without geometric errors whose instrument stands in the base."""
    scene = draw_scene(np.random.default_rng(seed), arm, PLAIN)
    return replace(scene, markers=scene.guesses, R=np.eye(3), p=np.zeros(3))


def case_of(scene: Scene, *causes: Cause) -> Case:
    """What the instrument reads without noise."""
    state = at_rest(scene, scene.mechanism(), causes)
    return Case(
        family="single",
        scene=scene,
        causes=causes,
        noncentrality=(100.0,) * len(causes),
        beside=(100.0,) * len(causes),
        together=100.0,
        state=state,
        clean=state.readings,
        noisy=state.readings,
        seen=np.ones(state.readings.shape[:2], dtype=bool),
    )


def as_files(folder: Path, case: Case) -> tuple[Cell, Measurements]:
    """Written and read again by the model under test."""
    write_case(folder, case)
    return read_files(folder)


def read_files(folder: Path) -> tuple[Cell, Measurements]:
    """The cell of a case, and what is fitted."""
    cell = calib.load_cell(folder / "cell.toml")
    return cell, calib.load_measurements(cell, folder / "measurements.csv")
