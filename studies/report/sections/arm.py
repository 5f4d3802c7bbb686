"""The arm at each pose, with its markers and lines of sight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calib.poses import Measurements, Poses
from studies.design.record import DesignRecord
from studies.document import Raw, Section
from studies.report.arm_scene import scene
from studies.report.arm_view import figure_html
from studies.report.evidence import Evidence


def arm(evidence: Evidence) -> Section | None:
    """The measured poses where there are any, else those of the first plan."""
    if evidence.cell is None:
        return None
    shown: Poses | Measurements
    level = None
    design = evidence.first("design")
    if evidence.data:
        path, measured = next(iter(evidence.data.items()))
        shown = measured.data
    elif design is not None and design.path in evidence.plans:
        path, shown = design.path, evidence.plans[design.path]
        level = design.record.level_joint if isinstance(design.record, DesignRecord) else None
    else:
        return None
    drawn = scene(evidence.cell, _once(evidence.highlight[path], shown), level_joint=level)
    return Section("arm", "The arm at each pose", (Raw(figure_html(drawn, "arm-view")),))


def _once(highlight: Mapping[str, str], shown: Poses | Measurements) -> Poses | Measurements:
    """One pose of each configuration, under the name that the page lights."""
    poses = shown.poses if isinstance(shown, Measurements) else shown
    names = [highlight[name] for name in poses.names]
    first = np.array([names.index(name) for name in dict.fromkeys(names)])
    kept = replace(poses.take(first), names=tuple(names[i] for i in first))
    return replace(shown.take(first), poses=kept) if isinstance(shown, Measurements) else kept
