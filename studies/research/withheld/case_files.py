"""A case as the files that a user would bring, rounded as they show it."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from studies.research.withheld.draw import Case
from studies.research.withheld.noise import Noise
from studies.research.withheld.scene import Scene
from studies.research.withheld.texts import urdf


def write_case(folder: Path, case: Case) -> None:
    """Write cell.toml, robot.urdf, measurements.csv and heldout.csv into a new folder."""
    folder.mkdir(parents=True)
    held = case.scene.session.held
    texts = {
        "cell.toml": cell_text(folder.name, case.scene),
        "robot.urdf": urdf(case.scene.arm, case.scene.weighs),
        "measurements.csv": table_text(case, np.flatnonzero(~held)),
        "heldout.csv": table_text(case, np.flatnonzero(held)),
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
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
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
            writer.writerow([session.names[i], f"m{marker + 1}", *angles, *point, *state])
    return stream.getvalue()


def _noise(believed: Noise) -> str:
    if not believed.grows:
        return f"{believed.sigma * 1e3:.4g}"
    names = ("range_mm", "transverse_mm", "transverse_mm_per_m")
    values = (believed.along, believed.across, believed.across_per_m)
    shown = [f"{name} = {value * 1e3:.4f}" for name, value in zip(names, values, strict=True)]
    return f"{{ {', '.join(shown)} }}"


def _mm(values: object) -> str:
    return "[" + ", ".join(f"{v:.4f}" for v in np.asarray(values, dtype=float) * 1e3) + "]"
