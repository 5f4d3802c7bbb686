"""The identified model that one command hands to the next."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import calib
from calib.files.estimate import load_estimate
from calib.files.read import sha256
from calib.files.write import json_text
from calib.model.build import build
from calib.prediction.discrepancy import ModelDiscrepancy
from calib.prediction.estimate import Estimate
from studies.demo.embedded import embedded_cell, embedded_plan
from studies.results.base import envelope
from studies.results.compensate import CompensateResult
from studies.results.estimate import Estimated
from tests.fuzz.reader import put

CELL = embedded_cell()
POSES = embedded_plan(CELL).take([0, 7])


def estimate(folder: Path, content: bytes) -> object:
    """What ``posecal compensate`` does with a result."""
    known = load_estimate(CELL, put(folder, "result.json", content))
    found = calib.compensate(CELL, known, POSES)
    return CompensateResult.of(found, CELL, envelope(CELL.name, [])).to_json()


def _result(command: str, effects: tuple[str, ...]) -> str:
    """A result as far as ``compensate`` reads it."""
    model = build(replace(CELL, effects=effects), POSES).model
    values = 0.1 * model.sizes
    own = Estimate(
        model,
        values,
        np.diag(0.01 * model.sizes**2),
        0.0,
        ModelDiscrepancy(1e-5, "fitted poses"),
        (model.parameters[0].id,),
        ("a note",),
    )
    inputs = [
        {"file": str(path), "sha256": sha256(path)} for path in (CELL.path, *CELL.robot_files)
    ]
    head = {"schema": 1, "command": command, "inputs": inputs}
    return json_text({**head, "estimate": Estimated.of(own).model_dump(by_alias=True)})


ESTIMATES = (
    _result("identify", ("base", "tool", "joint_offset")),
    _result("identify", CELL.effects),
    _result(
        "diagnose",
        (
            "base",
            "tool",
            "joint_offset:A2",
            "backlash:A1",
            "transmission_harmonic:A3",
            "joint_compliance:A2",
        ),
    ),
)
