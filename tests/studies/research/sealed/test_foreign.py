"""Causes by other formulas: the formulas, and cases that are told by the catalogue's names."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("mujoco")

from studies.research.sealed.draw import FOREIGN_SHARES, NONCENTRALITY, draw_foreign_case
from studies.research.sealed.judge import is_listed, judge
from studies.research.sealed.key import key_of
from studies.research.truth import foreign


def test_formulas() -> None:
    moves = np.array([0.5, -0.01, -0.6, 0.02, 0.0, 0.4])
    assert foreign.play_with_dead_band(moves, 0.05).tolist() == [1, 1, -1, -1, -1, 1]
    q = np.linspace(-np.pi, np.pi, 2001)[:-1]
    wheel = foreign.eccentric(q, 0.3, 0.5, 0.9)
    assert 2 * np.mean(wheel * np.sin(q - 0.3)) == pytest.approx(1.0, rel=0.005)
    assert 2 * np.mean(wheel * np.sin(2 * q - 0.9)) == pytest.approx(0.5, rel=0.1)
    third = np.hypot(*(2 * np.mean(wheel * f(3 * q)) for f in (np.cos, np.sin)))
    assert 1e-3 < third < 5e-3  # what no harmonic of the catalogue has
    torque = np.linspace(-50.0, 50.0, 11)
    np.testing.assert_allclose(foreign.hardening(torque, 0.3)[[0, 5, -1]], [-35.0, 0.0, 35.0])
    time = np.arange(0.0, 40000.0, 10.0)
    lag = foreign.lagging(20.0 + 1e-3 * time, time, 1200.0)
    np.testing.assert_allclose(20.0 + 1e-3 * time[-1] - lag[-1], 1.2, rtol=0.01)


@pytest.mark.parametrize("family", FOREIGN_SHARES)
def test_a_case_is_told_by_names_of_the_catalogue(family: str) -> None:
    key = key_of(draw_foreign_case(np.random.default_rng(3), family), "case", 0, "salt")
    json.dumps(key, allow_nan=False)
    low, high = NONCENTRALITY
    entries = key["effects"]
    assert (len(entries) == 1) == (family == "single")
    assert len({e["effect"] for e in entries}) == (2 if family == "mixture" else 1)
    if family == "single":
        assert 0.9 * low < entries[0]["noncentrality"] < 1.1 * high
    assert not any(p["scored"] for e in entries for p in e["parameters"])
    said = [
        {"effect": e["effect"], "where": e["where"], "parameters": e["parameters"]} for e in entries
    ]
    judged = judge(key, {"verdict": "explained", "effects": said, "located": []})
    assert judged.exact
    assert not judged.intervals
    for entry in entries:
        for name in entry.get("alike", ()):
            effect, where = name.split(":")
            other = {"effect": effect, "where": where, "parameters": entry["parameters"]}
            assert is_listed(other, entry)
