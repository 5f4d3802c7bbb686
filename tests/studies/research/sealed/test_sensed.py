"""Sealed cases that other instruments read: noise as sealed, faults as drawn, through files alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

import calib
from calib.effects import EFFECTS
from studies.research.sealed.instruments import READERS, Fault, Sensed, draw_sensed
from studies.research.sealed.key import key_of_sensed, write_sensed

# It takes seconds to put a ball into sockets, and cameras have their noise by their faults below.
QUICK = ("pose", "distance")
SOCKET = pytest.param("socket", marks=pytest.mark.long)


@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=() if k in QUICK else pytest.mark.long) for k in READERS]
)
def test_the_truth_is_known_to_its_noise(kind: str, tmp_path: Path) -> None:
    """Without a cause the user's model fits within the noise, whose size the key holds."""
    case = draw_sensed(np.random.default_rng(4), "null", kind)
    write_sensed(tmp_path / "case", case)
    cell = calib.load_cell(tmp_path / "case" / "cell.toml")
    data = calib.load_measurements(cell, tmp_path / "case" / "measurements.csv")
    found = calib.identify(cell, data)
    assert found.status == "converged"
    assert found.noise.factor == pytest.approx(1.0, abs=0.15)
    heldout = calib.load_measurements(cell, tmp_path / "case" / "heldout.csv")
    off = found.model.off(found.values, heldout) * found.model.readout.channels.lengths
    rms = np.sqrt((off**2).sum(axis=-1)[heldout.seen].mean())
    scale = 1.0 if "camera" in kind else 1e3
    assert rms * scale == pytest.approx(case.reader.floor, rel=0.25)


def known(case: Sensed) -> bool:
    """Whether the fault is an effect of the catalogue: some of those that are drawn are none."""
    return key_of_sensed(case, "case", 0, "")["effects"][0]["effect"] in EFFECTS


@pytest.mark.parametrize("kind", ["world camera", "tip camera", SOCKET])
def test_faults_are_what_the_answers_call_them(kind: str, tmp_path: Path) -> None:
    """The effect of the key in the model takes up what the fault does, at its value."""
    drawn = (draw_sensed(np.random.default_rng(k), "instrument", kind) for k in range(5, 50))
    case = next(own for own in drawn if isinstance(own.cause, Fault) and known(own))
    write_sensed(tmp_path / "case", case)
    (entry,) = key_of_sensed(case, "case", 0, "")["effects"]
    path = tmp_path / "case" / "cell.toml"
    effect = f'"{entry["effect"]}:{entry["where"]}"'
    path.write_text(path.read_text().replace('"tool"]', f'"tool", {effect}]'))
    cell = calib.load_cell(path)
    data = calib.load_measurements(cell, tmp_path / "case" / "measurements.csv")
    found = calib.identify(cell, data)
    assert found.noise.factor == pytest.approx(1.0, abs=0.15)
    for truth in entry["parameters"]:
        ids = [(p.effect, p.name) for p in found.model.parameters]
        at = ids.index((entry["effect"], truth["name"]))
        p = found.model.parameters[at]
        assert p.unit == truth["unit"]
        assert abs(found.values[at] / p.scale - truth["value"]) < 4.0 * found.std[at] / p.scale
