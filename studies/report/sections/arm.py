"""The arm at each pose, with its markers and lines of sight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.poses import Measurements, Poses
from studies.report.arm_scene import scene
from studies.report.arm_view import figure_html
from studies.report.evidence import Evidence, plan_poses
from studies.report.parts import Raw, Section


def arm(evidence: Evidence) -> Section | None:
    """The measured poses where there are any, else those of the first plan."""
    shown: Poses | Measurements | None = next(iter(evidence.data.values()), None)
    design = evidence.first("design")
    if evidence.cell is None:
        return None
    level = None
    if shown is None:
        if design is None:
            return None
        shown = plan_poses(evidence.cell, design)
        level = next(
            iter(design.fields.get("levels_deg", design.fields.get("levels_mm", {}))), None
        )
    drawn = scene(evidence.cell, _once(evidence, shown), level_joint=level)
    return Section("arm", "The arm at each pose", (Raw(figure_html(drawn, "arm-view")),))


def _once(evidence: Evidence, shown: Poses | Measurements) -> Poses | Measurements:
    """One pose of each configuration, under the name that the page lights."""
    poses = shown.poses if isinstance(shown, Measurements) else shown
    names = [evidence.lit.get(name, name) for name in poses.names]
    first = [names.index(name) for name in dict.fromkeys(names)]
    poses = replace(poses.take(np.array(first)), names=tuple(names[i] for i in first))
    return (
        replace(shown.take(np.array(first)), poses=poses)
        if isinstance(shown, Measurements)
        else poses
    )
