"""The embedded example against the paper's printed tables."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from calib import Cell, Poses
from studies.demo.embedded import simulated

PAPER = json.loads((Path(__file__).parent.parent / "reference" / "paper.json").read_text())


def test_plan_and_markers_are_those_printed(kr270: Cell, table_two: Poses) -> None:
    np.testing.assert_allclose(np.degrees(table_two.q), PAPER["table_II_deg"], atol=1e-9)
    markers = list(PAPER["table_III_markers_mm"].values())
    np.testing.assert_allclose(kr270.markers * 1e3, markers, atol=1e-9)


def test_truth_is_table_four(kr270: Cell, table_two: Poses) -> None:
    _, model, truth = simulated(kr270, table_two, 0)
    printed = PAPER["table_IV"]
    for p, value in zip(model.parameters, truth, strict=True):
        if p.effect == "joint_compliance":
            assert value / p.scale == pytest.approx(printed[p.where])
        if p.effect == "stiffness_vs_angle":
            knot = p.name.removeprefix("compliance@")
            assert value / p.scale == pytest.approx(printed["A2_at_deg"][knot])
