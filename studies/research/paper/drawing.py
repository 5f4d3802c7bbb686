"""Line drawings in space: an orthographic view, nearer things drawn over farther ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arm.se3 import rotate, so3_exp
from calib.arrays import Array
from studies.plots.style import BLUE, GREEN, INK, VERMILLION
from studies.report.arm_drawing import Viewpoint

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AXES = (("x", VERMILLION), ("y", GREEN), ("z", BLUE))
LIGHT, BODY = "0.95", "0.86"
_TURN = np.linspace(0.0, 2.0 * np.pi, 73)


class Drawing:
    """A panel without axes, to one scale, seen from a viewpoint. Points are (3,) or (k, 3), m."""

    def __init__(self, panel: Axes, view: Viewpoint) -> None:
        panel.set_aspect("equal")
        panel.set_axis_off()
        self.panel, self.view = panel, view

    def line(self, points: Array, lift: float = 0.0, **style: Any) -> None:
        """A polyline (k, 3) m; lift brings it forward in the drawing order."""
        at = self.view.flat(points)
        order = self.view.order(points) + lift
        self.panel.plot(*at.T, **{"color": INK, "linewidth": 1.0, "zorder": order, **style})

    def arrow(self, start: Array, end: Array, lift: float = 0.0, **style: Any) -> None:
        """An arrow from start to end (3,) m."""
        points = np.array([start, end])
        a, b = self.view.flat(points)
        look: Any = {
            "arrowstyle": "-|>,head_width=0.16,head_length=0.36",
            "shrinkA": 0.0,
            "shrinkB": 0.0,
        }
        look |= {"color": INK, "linewidth": 1.2} | style
        note = self.panel.annotate(
            "", xy=tuple(b), xytext=tuple(a), arrowprops=look, annotation_clip=False
        )
        note.set_zorder(self.view.order(points) + lift)
        self.panel.update_datalim([a, b])

    def label(self, point: Array, text: str, shift: tuple[float, float], **style: Any) -> None:
        """Text beside a point, shifted by points of type; above everything."""
        side = "center" if abs(shift[0]) < 3.0 else "left" if shift[0] > 0.0 else "right"
        level = "center" if abs(shift[1]) < 7.0 else "bottom" if shift[1] > 0.0 else "top"
        box: Any = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8}
        look: Any = {
            "fontsize": 9,
            "ha": side,
            "va": level,
            "zorder": 100.0,
            "color": INK,
            "bbox": box,
        }
        self.panel.annotate(
            text,
            tuple(self.view.flat(point)),
            shift,
            textcoords="offset points",
            annotation_clip=False,
            **(look | style),
        )

    def symbol(self, point: Array, text: str, shift: tuple[float, float], **style: Any) -> None:
        """A label of ours in mathematical type; names of the user's are never read as mathematics."""
        self.label(point, text, shift, parse_math=True, **style)

    def frame(
        self,
        T: Array,
        size: float,
        name: str = "",
        shift: tuple[float, float] = (-6, -9),
    ) -> None:
        """Axes x, y, z of a frame (4, 4), named at their ends; seen end on they are left out."""
        for (axis, color), direction in zip(AXES, T[:3, :3].T, strict=True):
            end = T[:3, 3] + size * direction
            if np.linalg.norm(self.view.flat(direction)) < 0.15:
                continue
            self.arrow(T[:3, 3], end, lift=1.0, color=color, linewidth=1.5)
            along = 7.0 * self.view.flat(direction) / np.linalg.norm(self.view.flat(direction))
            place = (float(along[0]), float(along[1]))
            self.label(end, axis, place, color=color, ha="center", va="center", bbox=None)
        if name:
            self.label(T[:3, 3], name, shift)

    def ball(self, centre: Array, radius: float, color: str, **style: Any) -> None:
        """A sphere as a disc with a highlight."""
        from matplotlib.patches import Circle

        x, y = self.view.flat(centre)
        order = self.view.order(centre) + style.pop("lift", 0.5)
        look = {"facecolor": color, "edgecolor": INK, "linewidth": 0.8} | style
        self.panel.add_patch(Circle((x, y), radius, zorder=order, **look))
        self.panel.add_patch(
            Circle(
                (x - 0.3 * radius, y + 0.3 * radius), 0.26 * radius, color="white", linewidth=0,
                zorder=order, alpha=0.8,
            )
        )  # fmt: skip

    def tube(self, points: Array, radii: Array | tuple[float, float], **style: Any) -> None:
        """A link: two points (2, 3) m with rounded ends of two radii [m], as an outline."""
        ends = self.view.flat(points)
        circle = np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)
        cloud = np.concatenate([end + r * circle for end, r in zip(ends, radii, strict=True)])
        self._outline(cloud, self.view.order(points) + style.pop("lift", 0.0), style)

    def cylinder(
        self,
        centre: Array,
        axis: Array,
        radius: float,
        height: float,
        **style: Any,
    ) -> None:
        """A drum about an axis (3,), centred, with its nearer face."""
        axis = axis / np.linalg.norm(axis)
        side = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
        side /= np.linalg.norm(side)
        rim = radius * (
            np.outer(np.cos(_TURN), side) + np.outer(np.sin(_TURN), np.cross(axis, side))
        )
        near = axis if axis @ self.view.axes[2] >= 0.0 else -axis
        faces = [centre + rim + s * 0.5 * height * near for s in (-1.0, 1.0)]
        order = self.view.order(centre) + style.pop("lift", 0.0)
        self._outline(self.view.flat(np.concatenate(faces)), order, style)
        self._outline(self.view.flat(faces[1]), order + 1e-3, {"facecolor": LIGHT, **style})

    def plate(self, corners: Array, **style: Any) -> None:
        """A flat polygon (k, 3) m."""
        from matplotlib.patches import Polygon

        order = style.pop("zorder", self.view.order(corners))
        look = {"facecolor": BODY, "edgecolor": INK, "linewidth": 0.8} | style
        self.panel.add_patch(Polygon(self.view.flat(corners), closed=True, zorder=order, **look))

    def ground(self, points: Array, margin: float) -> None:
        """The floor z = 0 below some points (k, 3) m."""
        (left, near, _), (right, far, _) = points.min(axis=0) - margin, points.max(axis=0) + margin
        corners = np.array([[left, near], [right, near], [right, far], [left, far]])
        corners = np.column_stack([corners, np.zeros(4)])
        self.plate(corners, facecolor="0.975", edgecolor="0.8", zorder=0.5)

    def arc(
        self,
        centre: Array,
        start: Array,
        axis: Array,
        angle: float,
        **style: Any,
    ) -> Array:
        """The arc of a joint angle [rad] with an arrow from a vector start (3,) m; its middle."""
        axis = axis / np.linalg.norm(axis)
        turns = so3_exp(np.linspace(0.0, angle, 41)[:, None] * axis)
        points: Array = centre + rotate(turns, start)
        self.line(points[:-2], lift=1.5, **style)
        self.arrow(points[-4], points[-1], lift=1.5, **style)
        middle: Array = points[20]
        return middle

    def _outline(self, cloud: Array, order: float, style: dict[str, Any]) -> None:
        from matplotlib.patches import Polygon
        from scipy.spatial import ConvexHull

        look = {"facecolor": BODY, "edgecolor": INK, "linewidth": 0.8} | style
        self.panel.add_patch(
            Polygon(cloud[ConvexHull(cloud).vertices], closed=True, zorder=order, **look)
        )
