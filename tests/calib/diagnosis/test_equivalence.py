"""A class holds all causes that the data cannot tell apart, across kinds, and no excluded one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Diagnosis
from calib.diagnosis.candidates import EXCLUDED
from calib.diagnosis.equivalence import classes, imitations
from tests.calib.diagnosis.days import Day, heavier_load, measured_day
from tests.calib.diagnosis.test_diagnose import DRIFT, diagnosed

pytestmark = pytest.mark.long


def members(found: Diagnosis) -> list[list[str]]:
    return [[c.key for c, _ in cause.named.members] for cause in found.causes]


def test_a_heavier_load_is_in_the_class_of_the_link_that_it_looks_like(tmp_path: Path) -> None:
    cell, data, heldout = measured_day(tmp_path, heavier_load, 1000.0, 3, payload=False)
    found = calib.diagnose(cell, data, heldout=heldout)
    assert found.verdict == "ambiguous"
    (members_of_it,) = members(found)
    assert "payload:payload" in members_of_it
    assert len(members_of_it) <= 4


def test_exact_twins_are_listed_at_any_size_and_nothing_else_is_one() -> None:
    """A base and an instrument that drift move everything alike."""
    for size in (1.0, 20.0):
        found = diagnosed("base_drift:base", tuple(size * v for v in DRIFT), 8)
        assert sorted(members(found)[0]) == ["base_drift:base", "tracker_drift:instrument"]
        (entry,) = found.outcome.entries
        others = imitations(found.outcome, entry)
        pair = {"base_drift:base", "tracker_drift:instrument"}
        assert {t.candidate.key for t in others if t.exact} | {entry.candidate.key} == pair
        assert others[0].exact


def test_what_imitates_nothing_is_far(found_lost_motion: Diagnosis) -> None:
    """Where the joint yields, friction winds it up by as much: one cause, two names."""
    found = found_lost_motion
    assert found.verdict == "explained"
    assert members(found) == [["backlash:elbow", "friction_windup:elbow"]]
    (_, lost), (_, wound) = found.causes[0].named.members
    assert lost == pytest.approx(wound)
    assert lost > 0.4
    (entry,) = found.outcome.entries
    assert min(t.left for t in imitations(found.outcome, entry)) > 100.0
    named, _ = classes(found.stage, found.outcome)
    assert np.isclose(sum(share for _, share in named[0].members), 1.0)


def test_what_the_user_excludes_is_never_named(lost_motion_day: Day) -> None:
    cell, data, heldout = lost_motion_day
    cell = replace(cell, excluded=("backlash:elbow", "transmission_harmonic"))
    found = calib.diagnose(cell, data, heldout=heldout)
    gone = {n.effect for n in found.not_asked if n.reason == EXCLUDED}
    assert "backlash:elbow" in gone
    assert "transmission_harmonic:elbow" in gone
    assert not gone & {name for names in members(found) for name in names}
    assert not gone & {f"{h.effect}:{h.where}" for h in found.hidden}
    assert found.located[0].where == "elbow"
    assert found.verdict == "unknown"
