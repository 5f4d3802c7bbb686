"""Shuffled controls and known failures: what is made, and when an answer to it is right."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

pytest.importorskip("mujoco")

from studies.research.benchmarks.controls import (
    CONTROLS,
    Lag,
    main,
    measured,
    of_columns,
    said,
    settling,
    shuffled,
    sized,
)
from studies.research.benchmarks.day import SCARA
from studies.research.withheld.causes import Cause
from studies.research.withheld.robots import LIGHT
from studies.research.withheld.visible import Projector, at_rest
from tests.studies.research.withheld.scenes import scene_of


def answer(verdict: str, *effects: tuple[str, str], located: Any = ()) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "effects": [{"effect": e, "where": w, "class": []} for e, w in effects],
        "located": [{"where": w, "depends_on": d} for w, d in located],
    }


def test_a_joint_lags_by_a_share_of_its_last_move() -> None:
    scene = scene_of(LIGHT)
    action = scene.nothing()
    Lag(2, 1e-3).add_to(action, scene, at_rest(scene, scene.mechanism(), ()))
    q = scene.session.q[:, 2]
    for i in range(0, len(q), 2):  # free and loaded readings of one stay
        expected = -1e-3 * (q[i] - q[i - 2]) if i else 0.0
        np.testing.assert_allclose(action.joint[i : i + 2, 2], expected, atol=1e-15)
    assert not np.delete(action.joint, 2, axis=1).any()


def test_shuffling_moves_the_columns_alone() -> None:
    scene = scene_of(LIGHT)
    case = measured(np.random.default_rng(0), scene, Lag(1, 1e-4))
    mixed = shuffled(np.random.default_rng(1), case)
    np.testing.assert_array_equal(mixed.noisy, case.noisy)
    before, after = case.scene.session, mixed.scene.session
    np.testing.assert_array_equal(after.q, before.q)
    for name in ("time", "temperature"):
        a, b = getattr(before, name), getattr(after, name)
        assert (a != b).mean() > 0.8
        np.testing.assert_array_equal(np.sort(a), np.sort(b))
    stays = {tuple(row) for row in before.time.reshape(-1, 2)}
    assert {tuple(row) for row in after.time.reshape(-1, 2)} == stays
    where = [list(before.time).index(t) for t in after.time]
    np.testing.assert_array_equal(after.approach, before.approach[where])


def test_sized_by_noncentrality() -> None:
    scene = scene_of(LIGHT)
    cause = sized(scene, Cause("backlash", "elbow", {"half_width": 1e-6}), 300.0)
    still = at_rest(scene, scene.mechanism(), ())
    moved = at_rest(scene, scene.mechanism(), [cause]).readings - still.readings
    seen = np.ones(moved.shape[:2], dtype=bool) & ~scene.session.held[:, None]
    rest = Projector(scene, still, seen).left(moved)
    assert rest @ rest == pytest.approx(300.0, rel=0.02)


def test_screw_is_measured_at_its_limits_only() -> None:
    case, right = CONTROLS["scara"](np.random.default_rng(0))
    z = case.scene.session.q[:, SCARA.names.index("Z")]
    assert set(z[~case.scene.session.held]) == set(SCARA.limits[SCARA.names.index("Z")])
    both = [("joint_coupling", "Z"), ("transmission_scale", "Z")]
    assert right(answer("explained", *both))
    assert not right(answer("explained", both[0]))
    assert not right(answer("unknown", located=[("Z", "q:Z")]))


def test_what_is_right() -> None:
    case, right = settling(np.random.default_rng(0))
    names = case.scene.arm.names
    still = at_rest(case.scene, case.scene.mechanism(), ())
    assert np.abs(case.clean - still.readings).max() > 5e-5
    (joint,) = (n for n in names if right(answer("unknown", located=[(n, f"motion:{n}")])))
    assert right(answer("explained", ("settling", joint)))
    assert not right(answer("explained", ("backlash", joint)))
    assert not right(answer("unknown", ("backlash", joint), located=[(joint, f"motion:{joint}")]))
    _, quiet = of_columns(np.random.default_rng(0), "base_drift", shuffle=True)
    assert quiet(answer("unknown", located=[("arm", "pose")]))
    assert quiet(answer("no_gap"))
    assert not quiet(answer("unknown", located=[("base", "time")]))
    assert not quiet(answer("unknown", located=[("pan", "motion:pan")]))
    assert not quiet(answer("ambiguous", ("warm_up", "base")))
    _, named = of_columns(np.random.default_rng(0), "base_drift", shuffle=False)
    drift = answer("ambiguous", ("tracker_drift", "instrument"))
    assert not named(drift)
    drift["effects"][0]["class"] = [{"effect": "base_drift", "where": "base"}]
    assert named(drift)
    assert said(drift) == "ambiguous tracker_drift:instrument"
    _, six = CONTROLS["six harmonics"](np.random.default_rng(0))
    all_six = [("transmission_harmonic", f"A{k}") for k in range(1, 7)]
    assert six(answer("explained", *all_six))
    assert not six(answer("explained", *all_six[:5]))


@pytest.mark.long
def test_command(tmp_path: Path) -> None:
    options = ["--seeds", "1", "--only", "scara", "--json", str(tmp_path / "controls.json")]
    done = CliRunner().invoke(main, options)
    assert done.exit_code == 0, done.output
    (found,) = json.loads((tmp_path / "controls.json").read_text())["answers"]
    assert f"{int(found['right'])} of 1" in done.output
    assert found["verdict"] in done.output
