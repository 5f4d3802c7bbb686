"""A scene and what was read of it as the files that a user would bring."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from studies.research.truth.arms import Arm, Array, Mask
from studies.research.truth.mechanism import urdf
from studies.research.truth.noise import Noise
from studies.research.truth.scene import Scene

Rows = NDArray[np.int_]
_WRENCH = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """Rows of a file, the columns' names first."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue()


def write_scene(folder: Path, scene: Scene, points: Array, seen: Mask) -> None:
    """Write cell.toml, robot.urdf, measurements.csv and heldout.csv into a new folder.

    points : ndarray, shape (N, M, 3), m, as read; seen : shape (N, M), which of them were
    """
    folder.mkdir(parents=True)
    fitted, held = np.flatnonzero(~scene.session.held), np.flatnonzero(scene.session.held)
    texts = {
        "cell.toml": _cell(folder.name, scene),
        "robot.urdf": urdf(scene.arm, scene.conditions.weighs),
        "measurements.csv": _table(scene, points, seen, fitted),
        "heldout.csv": _table(scene, points, seen, held),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")


def _cell(name: str, scene: Scene) -> str:
    """The measurement cell with the user's model."""
    arm = scene.arm
    lines = ["schema = 1", f'name = "{name}"', "", *_robot(arm)]
    if scene.repeatability is not None:
        place, turn = scene.repeatability
        lines += [f"repeatability_mm = {place * 1e3:.4g}", f"repeatability_urad = {turn * 1e6:.4g}"]
    if scene.conditions.ratios_said:
        lines += ["", "[robot.gear_ratio]"]
        lines += [f"{joint} = {ratio}" for joint, ratio in scene.ratios.items()]
    if arm.spring is not None:
        joint, before, after = arm.spring
        anchors = f"{{ before = {_mm(before)}, after = {_mm(after)} }}"
        lines += ["", "[robot.compensators_mm]", f"{joint} = {anchors}"]
    lines += [
        "",
        *_markers(scene.guesses),
        "",
        "[instrument]",
        f"sigma_mm = {_noise(scene.believed)}",
    ]
    if scene.payload:
        lines += ["", "[payload]", f"mass_kg = {scene.payload!r}", f"com_mm = {_mm(scene.com)}"]
    effects = ["base", "tool"] if scene.conditions.known_geometry else ["base", "tool", "geometry"]
    effects += [f"joint_compliance:{joint}" for joint in scene.modelled]
    lines += ["", "[model]", f"effects = [{', '.join(map(_quoted, effects))}]"]
    if scene.knots:
        lines += ["", "[model.knots_deg]"]
        lines += [
            f"{joint} = [{', '.join(f'{v:.4f}' for v in np.degrees(knots))}]"
            for joint, knots in scene.knots.items()
        ]
    return "\n".join([*lines, ""])


def plain_cell(
    arm: Arm, guesses: Array, sigma: float, robot: Sequence[str], design: Sequence[str]
) -> str:
    """A cell whose model has base, tool and geometry; robot, design : lines more of these tables."""
    lines = ["schema = 1", 'name = "a day"', *_robot(arm), *robot, *_markers(guesses)]
    lines += ["[instrument]", f"sigma_mm = {sigma * 1e3:g}", "[design]", *design]
    return "\n".join([*lines, "[model]", 'effects = ["base", "tool", "geometry"]', ""])


def _table(scene: Scene, points: Array, seen: Mask, poses: Rows) -> str:
    """Rows of the visible markers of some poses, points (N, M, 3) in m, in order of time."""
    session, arm, shown = scene.session, scene.arm, scene.arm.shown(scene.session.q)
    header = ["pose", "marker", *arm.columns(), "x_mm", "y_mm", "z_mm", *_WRENCH]
    if scene.measured is not None:
        header += [f"{j.name}_{'N' if j.slides else 'Nm'}" for j in arm.joints]
    header += ["temperature_degC"] if "temperature" in scene.conditions.columns else []
    header += ["time_s"] if "time" in scene.conditions.columns else []
    header += [f"approach_{n}" for n in arm.names] if "approach" in scene.conditions.columns else []
    rows = [header]
    for i in poses:
        state = [f"{v:.4f}" for v in scene.wrench[i]]
        if scene.measured is not None:
            state += [f"{v:.4f}" for v in scene.measured[i]]
        state += (
            [f"{session.temperature[i]:.3f}"] if "temperature" in scene.conditions.columns else []
        )
        state += [f"{session.time[i]:.1f}"] if "time" in scene.conditions.columns else []
        if "approach" in scene.conditions.columns:
            state += [f"{v:.0f}" for v in session.approach[i] + 0.0]
        for marker in np.flatnonzero(seen[i]):
            point = [f"{v:.5f}" for v in points[i, marker] * 1e3]
            angles = [f"{v:.6f}" for v in shown[i]]
            rows.append([session.names[i], f"m{marker + 1}", *angles, *point, *state])
    return csv_text(rows)


def _robot(arm: Arm) -> list[str]:
    return ["[robot]", 'urdf = "robot.urdf"', f'base = "{arm.base}"', f'tip = "{arm.tip}"']


def _markers(guesses: Array) -> list[str]:
    return ["[markers_mm]", *(f"m{i} = {_mm(guess)}" for i, guess in enumerate(guesses, 1))]


def _noise(believed: Noise) -> str:
    if not believed.grows:
        return f"{believed.sigma * 1e3:.4g}"
    names = ("range_mm", "transverse_mm", "transverse_mm_per_m")
    values = (believed.along, believed.across, believed.across_per_m)
    shown = [f"{name} = {value * 1e3:.4f}" for name, value in zip(names, values, strict=True)]
    return f"{{ {', '.join(shown)} }}"


def _mm(values: object) -> str:
    return "[" + ", ".join(f"{v:.4f}" for v in np.asarray(values, dtype=float) * 1e3) + "]"


def _quoted(text: str) -> str:
    return f'"{text}"'
