"""The key of a case: what was put in, in the names and units of the answers."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from studies.research.withheld.causes import Cause
from studies.research.withheld.draw import Case
from studies.research.withheld.outside import OUTSIDE
from studies.research.withheld.real.beyond import BEYOND
from studies.research.withheld.real.conditions import RealConditions
from studies.research.withheld.real.effects import TUNED
from studies.research.withheld.real.tuning import tuning_of
from studies.research.withheld.scene import Scene
from studies.research.withheld.units import SI, unit

# What the answer parametrises in its own way: the total or the change, the frame of the drift.
_BEYOND_CATALOGUE = {**OUTSIDE, **BEYOND}
UNSCORED = ("stiffness_vs_angle", "gravity_sag", "tracker_drift")


def key_of(case: Case, name: str, index: int, salt: str) -> dict[str, Any]:
    """Everything that scoring needs, and the truth for who wants to look."""
    scene, outside = case.scene, case.family == "outside"
    soft = [joint.name for joint in scene.arm.joints if joint.compliance]
    held = scene.session.held
    noise = (case.noisy - case.clean)[held][case.seen[held]]
    key: dict[str, Any] = {
        "schema": 1,
        "salt": salt,
        "case": name,
        "index": index,
        "family": case.family,
        "robot": scene.arm.name,
        "conditions": {
            **asdict(case.conditions),
            "rigid": [name for name in soft if name not in scene.modelled],
            "markers": len(scene.markers),
        },
        "effects": [],
        "outside": None,
        "noncentrality": case.together,
        "displacement_rms_mm": case.moved * 1e3,
        "sigma_mm": scene.noise.sigma * 1e3,
        "believed_sigma_mm": scene.believed.sigma * 1e3,
        "noise_mm": {name: value * 1e3 for name, value in asdict(scene.noise).items()},
        "floor_mm": _floor(case) * 1e3,
        "heldout_noise_rms_mm": float(np.sqrt(np.mean(np.sum(noise**2, axis=-1)))) * 1e3,
        "outliers": list(case.outliers),
        "truth": {
            "compliance_urad_per_Nm": dict(
                zip(scene.arm.names, (scene.compliance * 1e6).tolist(), strict=True)
            ),
            "geometry_m_rad": scene.geometry.tolist(),
            "markers_mm": (scene.markers * 1e3).tolist(),
        },
    }
    if isinstance(case.conditions, RealConditions):
        key["draw"] = "real arms"
        key["reachable_mm"] = float(np.hypot(_floor(case), np.sqrt(case.excess or 0.0))) * 1e3
    if scene.scatter is not None:
        key["conditions"]["arm_noise"] = "said" if scene.repeatability else "unsaid"
        key["arm_noise"] = _arm_noise(case)
    entries = [
        _entry(scene, cause, alone, beside)
        for cause, alone, beside in zip(case.causes, case.noncentrality, case.beside, strict=True)
    ]
    faint = len(entries) - case.background
    for entry in entries[faint:]:
        entry["background"] = True
    if outside:
        key["outside"], key["effects"] = entries[0], entries[1:]
    else:
        key["effects"] = entries
    return key


def _floor(case: Case) -> float:
    """3-D RMS of held-out readings beside a perfect model, m: nothing foretells where an arm stops."""
    scene, held = case.scene, case.scene.session.held
    instrument = scene.noise.rms(case.clean[held], case.seen[held])
    if scene.scatter is None:
        return instrument
    squares = scene.scatter.squares(scene.arm, case.state)[held][case.seen[held]]
    return float(np.sqrt(instrument**2 + np.mean(squares)))


def _arm_noise(case: Case) -> dict[str, Any]:
    """The arm's own scatter: standard deviations of its joints or its tip, rad and m."""
    scene, scatter = case.scene, case.scene.scatter
    assert scatter is not None  # noqa: S101
    place, turn = scatter.repeatability(scene.arm, case.state)
    return {
        "in": "joints" if scatter.joints.any() else "tip",
        "joints_rad_m": scatter.joints.tolist(),
        "tip_m_rad": scatter.tip.tolist(),
        "rms_mm": float(np.sqrt(np.mean(scatter.squares(scene.arm, case.state)))) * 1e3,
        "repeatability_mm": place * 1e3,
        "repeatability_urad": turn * 1e6,
    }


def _entry(scene: Scene, cause: Cause, alone: float, beside: float) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "effect": cause.effect,
        "where": cause.where,
        "places": _places(scene, cause),
        "depends_on": _depends(scene, cause),
        "noncentrality": alone,
        "beside": beside,
        "parameters": [],
    }
    if cause.effect in _BEYOND_CATALOGUE:
        entry["size"] = {n: v * cause.size for n, v in cause.values.items()}
        return entry
    if cause.shape is not None:
        entry["shape"] = {"joint": scene.arm.names[cause.shape[0]], "phase_rad": cause.shape[1]}
    slides = any(j.slides and j.name == cause.where for j in scene.arm.joints)
    if cause.effect == "friction_windup":
        entry["twins"] = [f"backlash:{cause.where}"]  # both follow the approach alone
    entry |= tuning_of(scene, cause)
    for name, value in {**_absent(scene, cause), **cause.values}.items():
        shown = unit(cause.effect, name, slides, "time" in scene.columns)
        size = 1.0 if name in TUNED else cause.size
        entry["parameters"].append(
            {
                "name": name,
                "value": value * size / SI[shown],
                "unit": shown,
                "scored": cause.effect not in UNSCORED and cause.shape is None,
            }
        )
    return entry


def _absent(scene: Scene, cause: Cause) -> dict[str, float]:
    """Parameters of the effect that are truly zero: an interval should hold that too."""
    if cause.effect == "transmission_harmonic":
        return dict.fromkeys(("cos_1", "sin_1", "cos_2", "sin_2"), 0.0)
    if cause.effect == "joint_coupling":
        turns = [j.name for j in scene.arm.joints if not j.slides and j.name != cause.where]
        return {f"from_{name}": 0.0 for name in turns}
    if cause.effect == "settling":
        return {"per_move": 0.0, "per_speed": 0.0}
    return {}


def _places(scene: Scene, cause: Cause) -> list[str]:
    """Names under which the place is right: moving base and moving instrument are one and the same."""
    where = cause.where
    if cause.effect in ("base_drift", "tracker_drift", "settling_base", "random_walk"):
        return ["base", "instrument"]
    if cause.effect in ("warm_up", "step") and where in ("base", "instrument"):
        return ["base", "instrument"]
    if cause.effect == "two_jumps":
        return [where, "base", "instrument"]
    if cause.effect == "cable_force":
        # It bends the drives, and is a load: all of these say so.
        return ["payload", "tool", "arm", *scene.modelled]
    upright = next(j.name for j in scene.arm.joints if not j.slides)
    if cause.effect in ("base_compliance", "bearing_compliance") and where in ("base", upright):
        # The first axis stands upright: its bearing tilts as the base does.
        return ["base", upright]
    return [where]


def _depends(scene: Scene, cause: Cause) -> list[str]:
    """What the answer may say that the cause depends on; empty where this is not scored."""
    if cause.effect not in _BEYOND_CATALOGUE:
        return []
    names = scene.arm.names
    k = names.index(cause.where) if cause.where in names else 0
    return [
        text.format(k=names[k], j=names[k - 1]) for text in _BEYOND_CATALOGUE[cause.effect].depends
    ]
