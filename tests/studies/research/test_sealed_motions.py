"""The truth of sealed motions by means of its own, and how answers are scored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib.arrays import Array
from calib.files.motions import load_motions
from studies.research.rates import Rate
from studies.research.sealed_motions.__main__ import written
from studies.research.sealed_motions.arms import ARMS
from studies.research.sealed_motions.score import scored
from studies.research.sealed_motions.truth import FAMILIES, NULL, Case, Cause, _bristles, case

NAMED = {"effect": "armature", "where": "j2", "probability": 0.99, "class": [], "parameters": [
    {"name": "inertia", "ci95": [0.4, 0.6]}]}  # fmt: skip


def answer(*effects: dict[str, Any]) -> dict[str, Any]:
    gap = {"heldout_before_mm": 9.0, "heldout_after_mm": 5.0}
    return {"verdict": "partly", "effects": list(effects), "gap": gap}


def a_case(family: str, *causes: Cause) -> Case:
    return Case(ARMS[0], family, (), {}, (), causes, "")


TRUE = Cause("armature", "j2", seen=True, values={"inertia": 0.5})


@pytest.mark.parametrize(
    ("own", "said", "right", "wrong", "held"),
    [
        (a_case("armature", TRUE), [NAMED], True, (), (True,)),
        (a_case("armature", TRUE), [], False, (), ()),
        (a_case("armature", TRUE), [NAMED | {"where": "j3"}], False, (("armature", "j3"),), ()),
        (a_case("armature", TRUE), [NAMED | {"effect": "spring", "probability": 0.5,
         "class": [{"effect": "armature", "where": "j2"}]}], True, (), ()),
        (a_case("armature", Cause("armature", "j2", seen=False)), [], True, (), ()),
        (a_case(NULL), [NAMED], None, (("armature", "j2"),), ()),
        (a_case("payload", Cause("payload", "payload")),
         [NAMED | {"effect": "inertials", "where": "arm"}], False, (), ()),
    ],
)  # fmt: skip
def test_an_answer_is_scored(
    own: Case, said: list[dict[str, Any]], right: bool | None, wrong: Any, held: Any
) -> None:
    found = scored(own, answer(*said))
    assert found.right is right
    assert found.wrong == wrong
    assert tuple(ok for _, ok in found.held) == held


def test_limits_of_a_share() -> None:
    assert Rate("", "", 9, 10).interval == pytest.approx((0.5958, 0.9821), abs=1e-3)


def bent(q: Array, stiff: float) -> float:
    """Bending at the end by the differential equation, in small steps."""
    z = 0.0
    for step in np.diff(q):
        for _ in range(200):
            z += stiff * step / 200.0 * (1.0 - z * np.sign(step))
    return z


def test_bristles_follow_their_equation() -> None:
    q = 1e-3 * np.sin(np.linspace(0.0, 9.0, 2000))
    found = _bristles(q[None, :, None], np.array([1e3]), np.zeros(1))[0, -1, 0]
    assert found == pytest.approx(bent(q, 1e3), abs=2e-3)


@pytest.mark.long
@pytest.mark.parametrize("family", ["payload", "torque_ripple"])
def test_what_was_drawn_makes_the_torque(family: str, tmp_path: Path) -> None:
    """The product reads the files, and its terms with the key's values leave the noise alone."""
    own = case(FAMILIES.index(family), 5)
    written(own, tmp_path)
    cell = calib.load_cell(tmp_path / "cell.toml")
    found = calib.diagnose(cell, load_motions(cell, tmp_path / "motion.csv"))
    named = {(c.effect, c.where) for c in found.causes}
    named |= {rival[:2] for c in found.causes for rival in c.rivals}
    assert family in {effect for effect, _ in named}
    assert all(c.standing == "one_of" for c in found.causes if c.effect != family)
    assert {(c.effect, c.where) for c in own.causes} <= named
