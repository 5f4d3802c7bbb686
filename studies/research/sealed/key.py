"""Cases as files, and their keys in the names and units of the answers."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from studies.research.sealed.draw import Case
from studies.research.sealed.judge import SI, unit
from studies.research.truth.causes import Cause
from studies.research.truth.conditions import PAIRED
from studies.research.truth.effects import HARMONICS, TUNED, is_outside
from studies.research.truth.files import write_scene
from studies.research.truth.scene import Scene

LINES = 2.0
"""Widths of a spectral line within which the cycles of a ripple count as found."""
READINGS = 3.0
"""Readings within which the moment of a step counts as found."""
# What the answer parametrises in its way: the total or the change, the frame of the drift.
_UNSCORED = ("stiffness_vs_angle", "gravity_sag", "tracker_drift")
Entry = dict[str, Any]


def write_case(folder: Path, case: Case) -> None:
    """Write cell.toml, robot.urdf, measurements.csv and heldout.csv into a new folder."""
    write_scene(folder, case.scene, case.noisy, case.seen)


def _values(cause: Cause, scored: bool, slides: bool, timed: bool) -> list[Entry]:
    found = []
    for name, value in cause.values.items():
        shown = unit(cause.effect, name, slides, timed)
        true = value * (1.0 if name in TUNED else cause.size) / SI[shown]
        found.append({"name": name, "value": true, "unit": shown, "scored": scored})
    return found


def key_of(case: Case) -> Entry:
    """Everything that scoring needs; the seed draws all else again."""
    scene, held = case.scene, case.scene.session.held
    noise = (case.noisy - case.clean)[held][case.seen[held]]
    rigid = [joint for joint in scene.arm.soft if joint not in scene.modelled]
    conditions = {**asdict(scene.conditions), "rigid": rigid, "markers": len(scene.markers)}
    drawn = zip(case.causes, case.noncentrality, case.beside, strict=True)
    entries = [_entry(scene, *one) for one in drawn]
    for entry in entries[len(entries) - case.background :]:
        entry["background"] = True
    outside = case.family == "outside"
    key: Entry = {
        "family": case.family,
        "robot": scene.arm.name,
        "conditions": conditions,
        "effects": entries[1:] if outside else entries,
        "outside": entries[0] if outside else None,
        "noncentrality": case.together,
        "floor_mm": _floor(case) * 1e3,
        "heldout_noise_rms_mm": float(np.sqrt(np.mean(np.sum(noise**2, axis=-1)))) * 1e3,
        "outliers": list(case.outliers),
    }
    if scene.conditions.visit != PAIRED:
        key["draw"] = "real arms"
    if scene.scatter is not None:
        conditions["arm_noise"] = "said" if scene.repeatability else "unsaid"
    return key


def _floor(case: Case) -> float:
    """3-D RMS of held-out readings beside a perfect model, m: nothing foretells where an arm stops."""
    scene, held = case.scene, case.scene.session.held
    instrument = scene.noise.rms(case.clean[held], case.seen[held])
    if scene.scatter is None:
        return instrument
    squares = scene.scatter.squares(scene.arm, case.state)[held][case.seen[held]]
    return float(np.sqrt(instrument**2 + np.mean(squares)))


def _entry(scene: Scene, cause: Cause, alone: float, beside: float) -> Entry:
    entry: Entry = {
        "effect": cause.effect,
        "where": cause.where,
        "places": _places(scene, cause),
        "noncentrality": alone,
        "beside": beside,
        "parameters": [],
    }
    if is_outside(cause.effect):
        entry["size"] = {n: v * cause.size for n, v in cause.values.items()}
        return entry
    if cause.shape is not None:
        entry["shape"] = {"joint": scene.arm.names[cause.shape[0]], "phase_rad": cause.shape[1]}
    if cause.alike:
        entry["alike"] = list(cause.alike)
    if cause.effect == "friction_windup":
        entry["twins"] = [f"backlash:{cause.where}"]  # both follow the approach alone
    entry |= _tuning(scene, cause)
    slides = cause.where in scene.arm.names and cause.where not in scene.arm.turning
    scored = cause.effect not in _UNSCORED and cause.scored
    whole = Cause(cause.effect, cause.where, {**_absent(scene, cause), **cause.values}, cause.size)
    entry["parameters"] = _values(whole, scored, slides, "time" in scene.conditions.columns)
    return entry


def _tuning(scene: Scene, cause: Cause) -> Entry:
    """The tolerance of the tuned parameter, and what the data leave open of it.

    A line is 2 pi / range of the joint wide, in cycles a turn; between two readings a step may have
    been at any moment.
    """
    clock = scene.fitted_clock
    if cause.effect == "gear_ripple":
        q = scene.joint(cause.where)[~scene.session.held]
        wide = LINES * 2.0 * np.pi / float(np.ptp(q))
        return {"tuned": _near(cause, "cycles", "1/turn", wide)}
    if cause.effect == "step":
        at, pace = cause.values["at"], float(clock[-1]) / (len(clock) - 1)
        gap = (float(clock[clock < at].max()), float(clock[clock >= at].min()))
        shown = "s" if "time" in scene.conditions.columns else "readings"
        return {"tuned": _near(cause, "at", shown, READINGS * pace), "between": {"at": gap}}
    return {}


def _near(cause: Cause, name: str, shown: str, tolerance: float) -> Entry:
    return {"name": name, "value": cause.values[name], "unit": shown, "tolerance": tolerance}


def _absent(scene: Scene, cause: Cause) -> dict[str, float]:
    """Parameters of the effect that are truly zero: an interval should hold that too."""
    if cause.effect == "transmission_harmonic":
        return dict.fromkeys(HARMONICS, 0.0)
    if cause.effect == "joint_coupling":
        return {f"from_{name}": 0.0 for name in scene.arm.turning if name != cause.where}
    return {"per_move": 0.0, "per_speed": 0.0} if cause.effect == "settling" else {}


def _places(scene: Scene, cause: Cause) -> list[str]:
    """Names under which the place is right: moving base and moving instrument are one and the same."""
    where, moving = cause.where, ["base", "instrument"]
    if cause.effect in ("base_drift", "tracker_drift", "settling_base", "random_walk"):
        return moving
    if cause.effect in ("warm_up", "step") and where in moving:
        return moving
    if cause.effect == "two_jumps":
        return [where, *moving]
    if cause.effect == "cable_force":  # it bends the drives, and is a load: all of these say so
        return ["payload", "tool", "arm", *scene.modelled]
    upright = scene.arm.turning[0]
    if cause.effect in ("base_compliance", "bearing_compliance") and where in ("base", upright):
        return ["base", upright]  # its bearing tilts as the base does
    return [where]
