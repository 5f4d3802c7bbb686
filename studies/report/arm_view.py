"""The figure of the arm at each pose: the drawing, what turns it, and how to read it."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

from markupsafe import Markup

from calib.arrays import IntArray
from studies.report.arm_drawing import START, ArmPicture, DrawnPart, drawing
from studies.report.arm_parts import CROSS, MARKER, picture
from studies.report.arm_scene import ArmScene


def figure_html(scene: ArmScene, key: str = "arm") -> Markup:
    """The figure: drawing, controls, a line about the pose shown, legend, and the data for the script.

    key : str, begins the identifiers in it; one of its own for each figure of a page
    """
    joints, markers = scene.readout(0)
    shown = picture(scene)
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
        drawing=drawing(shown, key),
        pose=scene.poses[0],
        joints=joints,
        markers=markers,
        legend=_legend(scene),
        caption=_caption(scene),
        data=_in_script(figure_data(scene, shown)),
    )


def _caption(scene: ArmScene) -> str:
    """How to read the drawing."""
    parts = [f"Nominal arm in the base frame, floor cells {scene.around.step} mm."]
    if scene.reads:
        parts.append(
            "Instruments and markers as the cell gives them, or where an identification starts."
        )
    elif scene.markers:
        measured = scene.seen == "measured"
        parts.append("Markers as measured." if measured else "Markers as the cell gives them.")
    away = [f"{name} stands {far:.1f} m from the base" for name, far in scene.beyond.items()]
    parts += [f"Not in the picture: {', '.join(away)}."] if away else []
    alone = not scene.fixtures and not scene.beyond
    if scene.around.instrument is None and scene.seen != "measured" and alone:
        parts.append("Where the instrument stands is not given: no line of sight is checked.")
    if not scene.shaped:
        parts.append("The cell gives the arm no shape: its links are bars.")
    return " ".join(parts)


def _legend(scene: ArmScene) -> Markup:
    """Signs that occur in the drawing."""
    signs = [
        (_path("arm-all", "M2 9h20"), "all poses"),
        (_marker("arm-marker"), f"marker {scene.seen}".strip()),
    ]
    if scene.hidden:
        lost = "not measured" if scene.seen == "measured" else "hidden"
        crossed = _marker("arm-marker arm-hidden") + _path("arm-hidden", f"M12 9{CROSS}")
        signs.append((crossed, f"marker {lost}"))
    present = {own.kind for own in scene.fixtures}
    signs += [(icon, words) for kind, (icon, words) in _SIGNS.items() if kind in present]
    if not scene.markers:
        del signs[1]
    if scene.around.instrument is not None:
        signs.append((_path("arm-sight", "M1 9h22"), "line of sight"))
    return Markup("").join(
        Markup('<li><svg viewBox="0 0 24 18" aria-hidden="true">{}</svg>{}</li>').format(icon, text)
        for icon, text in signs
    )


def _path(css: str, data: str) -> Markup:
    return Markup('<path class="{}" d="{}"/>').format(css, data)


def _marker(css: str) -> Markup:
    return Markup('<circle class="{}" cx="12" cy="9" r="{}"/>').format(css, MARKER)


_SIGNS = {
    "camera": (
        _path("arm-camera", "M3 9L20 2V16ZM20 2V16")
        + Markup('<circle class="arm-camera" cx="3" cy="9" r="2.5"/>'),
        "camera and what it sees",
    ),
    "board": (_path("arm-board", "M4 4h16v10h-16z"), "board"),
    "frame": (_path("arm-frame", "M6 14h11M6 14v-11M6 14l8 -6"), "body that is read"),
    "socket": (Markup('<circle class="arm-socket" cx="12" cy="9" r="5"/>'), "socket"),
    "sphere": (
        Markup('<circle class="arm-sphere" cx="12" cy="9" r="7"/>'),
        "sphere that is touched",
    ),
    "touched": (_path("arm-touched", "M2 13l6 -8h14l-6 8z"), "plane that is touched"),
    "wire": (_path("arm-wire", "M2 9h20"), "bar or wire, from its anchor"),
    "instrument": (Markup('<circle class="arm-instrument" cx="12" cy="9" r="5"/>'), "instrument"),
}


def figure_data(scene: ArmScene, shown: ArmPicture) -> dict[str, Any]:
    """What the script draws from, in mm and the shown units, and what it says of each pose."""
    told = [scene.readout(i)[1] for i in range(len(scene.poses))]
    states = list(dict.fromkeys(zip(told, shown.lost, strict=True)))
    number = {state: i for i, state in enumerate(states)}
    return {
        "poses": scene.poses,
        "day": scene.day,
        "joints": scene.joint_words,
        "values": scene.values.tolist(),
        "states": states,
        "state": [number[state] for state in zip(told, shown.lost, strict=True)],
        "points": [_path_of(point) for point in shown.points.swapaxes(0, 1)],
        "tip": shown.tip,
        "frame": shown.frame.ravel().tolist(),
        "view": [START.azimuth, START.elevation],
        "parts": [_plain(part) for part in shown.parts],
    }


def _path_of(point: IntArray) -> list[int]:
    """Where a point (m, 3) is at each pose, one after the other; once, where it stands still."""
    return list((point if (point != point[0]).any() else point[0]).ravel().tolist())


def _plain(part: DrawnPart) -> dict[str, Any]:
    """A part by its kind, and what of it is not as usual."""
    said = {f.name: v for f in fields(part) if (v := getattr(part, f.name)) != f.default}
    return {"kind": type(part).__name__, **said}


def _in_script(data: Any) -> Markup:
    """JSON that no text in it can end: neither ``</script>`` nor ``<!--`` nor an entity is left."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)  # noqa: S704
