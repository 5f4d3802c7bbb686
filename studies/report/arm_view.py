"""The figure of the arm at each pose: the drawing, what turns it, and how to read it."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from markupsafe import Markup

from studies.report.arm_drawing import MARKER, START, crossed, dot, drawing, fade, path
from studies.report.arm_scene import ArmScene


def figure_html(scene: ArmScene, key: str = "arm") -> Markup:
    """The figure: drawing, controls, a line about the pose shown, legend, and the data for the script.

    key : str, begins the identifiers in it; one of its own for each figure of a page
    """
    joints, markers = scene.readout(0)
    return Markup(
        """<figure class="arm-view" id="{key}">
<div class="arm-bar" role="group" aria-label="Pose and view" hidden></div>
<div class="arm-stage">{drawing}</div>
<p class="arm-now" aria-live="polite"><b>{pose}</b> <span>{joints}</span> <span>{markers}</span></p>
<ul class="arm-legend">{legend}</ul>
<figcaption>{caption}</figcaption>
<script type="application/json">{data}</script>
</figure>"""
    ).format(
        key=key,
        drawing=drawing(scene, key),
        pose=scene.poses[0],
        joints=joints,
        markers=markers,
        legend=_legend(scene),
        caption=_caption(scene),
        data=_in_script(figure_data(scene)),
    )


def _caption(scene: ArmScene) -> str:
    """How to read the drawing."""
    parts = [
        f"Nominal arm in the base frame, floor cells {scene.around.step} mm.",
        "Markers as measured." if scene.seen == "measured" else "Markers as the cell gives them.",
    ]
    if scene.around.instrument is None and scene.seen != "measured":
        parts.append("Where the instrument stands is not given: no line of sight is checked.")
    if not scene.shaped:
        parts.append("The cell gives the arm no shape: its links are bars.")
    return " ".join(parts)


def _legend(scene: ArmScene) -> Markup:
    """Signs that occur in the drawing."""
    middle = np.array([12.0, 9.0])
    signs = [
        (path("arm-all", "M2 9h20"), "all poses"),
        (dot("arm-marker", middle, MARKER), f"marker {scene.seen}".strip()),
    ]
    if scene.hidden:
        lost = "not measured" if scene.seen == "measured" else "hidden"
        signs.append((crossed(middle), f"marker {lost}"))
    if scene.around.instrument is not None:
        signs.append((path("arm-sight", "M1 9h22"), "line of sight"))
    return Markup("").join(
        Markup('<li><svg viewBox="0 0 24 18" aria-hidden="true">{}</svg>{}</li>').format(icon, text)
        for icon, text in signs
    )


def figure_data(scene: ArmScene) -> dict[str, Any]:
    """What the script draws from, in mm and the shown units; numbers of points, not copies."""
    still = scene.still
    reasons = list(dict.fromkeys(scene.hidden.values()))
    return {
        "poses": scene.poses,
        "joints": scene.joints,
        "units": scene.units,
        "level": scene.level,
        "values": scene.values.tolist(),
        "still": scene.points[0, :still].ravel().tolist(),
        "moving": scene.points[:, still:].ravel().tolist(),
        "chain": scene.chain,
        "tip": scene.tip_axes.ravel().tolist(),
        "markers": scene.markers,
        "at": scene.marker_points,
        "reasons": reasons,
        "hidden": [[i, j, reasons.index(why)] for (i, j), why in sorted(scene.hidden.items())],
        "seen": scene.seen,
        "bodies": [[b.start, b.end, b.radius] for b in scene.bodies],
        "shaped": scene.shaped,
        "instrument": None if scene.around.instrument is None else scene.around.instrument.tolist(),
        "far": scene.around.far,
        "solids": [
            {
                "name": o.name,
                "lines": [line.tolist() for line in o.lines],
                "centre": o.centre.tolist(),
                "radius": o.radius,
                "plane": o.plane,
            }
            for o in scene.around.outlines
        ],
        "floor": scene.around.floor.tolist(),
        "foot": scene.around.foot.tolist(),
        "step": scene.around.step,
        "frame": scene.around.frame.ravel().tolist(),
        "fade": round(fade(scene), 2),
        "view": [START.azimuth, START.elevation],
    }


def _in_script(data: Any) -> Markup:
    """JSON that no text in it can end: neither ``</script>`` nor ``<!--`` nor an entity is left."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)  # noqa: S704
