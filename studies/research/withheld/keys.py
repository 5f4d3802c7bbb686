"""A case as the files that a user would bring, and its key in the names and units of the answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.research.withheld.causes import Cause, Foreign, fitted_clock
from studies.research.withheld.draw import Case
from studies.research.withheld.effects import BEYOND, OUTSIDE, TUNED
from studies.research.withheld.judge import SI, unit
from studies.research.withheld.real_arms import RealConditions
from studies.research.withheld.scene import Noise, Scene
from studies.research.withheld.tables import csv_text
from studies.research.withheld.truth import urdf


def write_case(folder: Path, case: Case) -> None:
    """Write cell.toml, robot.urdf, measurements.csv and heldout.csv into a new folder."""
    text = cell_text(folder.name, case.scene)
    write_texts(folder, case.scene, text, partial(table_text, case))


def write_texts(
    folder: Path, scene: Scene, cell: str, table: Callable[[NDArray[np.int_]], str]
) -> None:
    """Write the files of a case; table : of some poses."""
    folder.mkdir(parents=True)
    held = scene.session.held
    texts = {
        "cell.toml": cell,
        "robot.urdf": urdf(scene.arm, scene.weighs),
        "measurements.csv": table(np.flatnonzero(~held)),
        "heldout.csv": table(np.flatnonzero(held)),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")


def cell_text(name: str, scene: Scene) -> str:
    """The measurement cell with the user's model."""
    arm = scene.arm
    effects = ["base", "tool"] if scene.known_geometry else ["base", "tool", "geometry"]
    effects += [f"joint_compliance:{joint}" for joint in scene.modelled]
    lines = [
        "schema = 1",
        f'name = "{name}"',
        "",
        "[robot]",
        'urdf = "robot.urdf"',
        f'base = "{arm.base}"',
        f'tip = "{arm.tip}"',
    ]
    if scene.repeatability is not None:
        place, turn = scene.repeatability
        lines += [
            f"repeatability_mm = {place * 1e3:.4g}",
            f"repeatability_urad = {turn * 1e6:.4g}",
        ]
    if scene.ratios_said:
        lines += ["", "[robot.gear_ratio]"]
        lines += [f"{joint} = {ratio}" for joint, ratio in scene.ratios.items()]
    if arm.spring is not None:
        joint, before, after = arm.spring
        lines += [
            "",
            "[robot.compensators_mm]",
            f"{joint} = {{ before = {_mm(before)}, after = {_mm(after)} }}",
        ]
    lines += ["", "[markers_mm]"]
    lines += [f"m{i} = {_mm(guess)}" for i, guess in enumerate(scene.guesses, 1)]
    lines += ["", "[instrument]", f"sigma_mm = {_noise(scene.believed)}"]
    if scene.payload:
        lines += ["", "[payload]", f"mass_kg = {scene.payload!r}", f"com_mm = {_mm(scene.com)}"]
    quoted = ", ".join(f'"{effect}"' for effect in effects)
    lines += ["", "[model]", f"effects = [{quoted}]"]
    if scene.knots:
        lines += ["", "[model.knots_deg]"]
        lines += [
            f"{joint} = [{', '.join(f'{v:.4f}' for v in np.degrees(knots))}]"
            for joint, knots in scene.knots.items()
        ]
    return "\n".join([*lines, ""])


def table_text(case: Case, poses: NDArray[np.int_]) -> str:
    """Rows of the visible markers of some poses, in order of time."""
    scene, session = case.scene, case.scene.session
    arm = scene.arm
    joints = [f"{j.name}_{'mm' if j.slides else 'deg'}" for j in arm.joints]
    shown = np.where(arm.slides, session.q * 1e3, np.degrees(session.q))
    header = ["pose", "marker", *joints, "x_mm", "y_mm", "z_mm"]
    header += ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"]
    if scene.measured is not None:
        header += [f"{j.name}_{'N' if j.slides else 'Nm'}" for j in arm.joints]
    header += ["temperature_degC"] if "temperature" in scene.columns else []
    header += ["time_s"] if "time" in scene.columns else []
    header += [f"approach_{n}" for n in arm.names] if "approach" in scene.columns else []
    rows = [header]
    for i in poses:
        state = [f"{v:.4f}" for v in scene.wrench[i]]
        if scene.measured is not None:
            state += [f"{v:.4f}" for v in scene.measured[i]]
        state += [f"{session.temperature[i]:.3f}"] if "temperature" in scene.columns else []
        state += [f"{session.time[i]:.1f}"] if "time" in scene.columns else []
        if "approach" in scene.columns:
            state += [f"{v:.0f}" for v in session.approach[i] + 0.0]
        for marker in np.flatnonzero(case.seen[i]):
            point = [f"{v:.5f}" for v in case.noisy[i, marker] * 1e3]
            angles = [f"{v:.6f}" for v in shown[i]]
            rows.append([session.names[i], f"m{marker + 1}", *angles, *point, *state])
    return csv_text(rows)


def _noise(believed: Noise) -> str:
    if not believed.grows:
        return f"{believed.sigma * 1e3:.4g}"
    names = ("range_mm", "transverse_mm", "transverse_mm_per_m")
    values = (believed.along, believed.across, believed.across_per_m)
    shown = [f"{name} = {value * 1e3:.4f}" for name, value in zip(names, values, strict=True)]
    return f"{{ {', '.join(shown)} }}"


def _mm(values: object) -> str:
    return "[" + ", ".join(f"{v:.4f}" for v in np.asarray(values, dtype=float) * 1e3) + "]"


LINES = 2.0
"""Widths of a spectral line within which the cycles of a ripple count as found."""
READINGS = 3.0
"""Readings within which the moment of a step counts as found."""


def tuning_of(scene: Scene, cause: Cause) -> dict[str, Any]:
    """Entries of a key: the tolerance of the tuned parameter, and what the data leave open of it.

    A line is 2 pi / range of the joint wide, in cycles a turn; between two readings a step may have
    been at any moment.
    """
    own = fitted_clock(scene)
    if cause.effect == "gear_ripple":
        q = scene.session.q[~scene.session.held, scene.arm.names.index(cause.where)]
        line = 2.0 * np.pi / float(np.ptp(q))
        return {"tuned": _near(cause, "cycles", "1/turn", LINES * line)}
    if cause.effect == "step":
        at, pace = cause.values["at"], float(own[-1]) / (len(own) - 1)
        gap = (float(own[own < at].max()), float(own[own >= at].min()))
        shown = "s" if "time" in scene.columns else "readings"
        return {"tuned": _near(cause, "at", shown, READINGS * pace), "between": {"at": gap}}
    return {}


def _near(cause: Cause, name: str, shown: str, tolerance: float) -> dict[str, Any]:
    return {"name": name, "value": cause.values[name], "unit": shown, "tolerance": tolerance}


# What the answer parametrises in its own way: the total or the change, the frame of the drift.
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
        "noncentrality": alone,
        "beside": beside,
        "parameters": [],
    }
    if cause.effect in (*OUTSIDE, *BEYOND):
        entry["size"] = {n: v * cause.size for n, v in cause.values.items()}
        return entry
    if cause.shape is not None:
        entry["shape"] = {"joint": scene.arm.names[cause.shape[0]], "phase_rad": cause.shape[1]}
    slides = any(j.slides and j.name == cause.where for j in scene.arm.joints)
    if isinstance(cause, Foreign) and cause.alike:
        entry["alike"] = list(cause.alike)
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
                "scored": cause.effect not in UNSCORED and cause.scored,
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
