"""A picture as numbered points and a list of parts: lines, dots, rods and words at them.

``arm_drawing.py`` draws it once, ``arm_view.js`` at any pose and from anywhere. Both know these parts
and what is said of them here, and nothing of arms.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TypeAlias

from calib.arrays import IntArray

Run: TypeAlias = tuple[int, ...]
"""Points by their numbers, one after the other; ``~c`` is what lies on the floor below point c."""


@dataclass(frozen=True)
class Part:
    """What stands at some points, under the class or classes ``css``.

    at : tuple of Run
    lowest : bool, only at the run that begins lowest in the drawing; of several, the widest (to a px)
    when : (marker, bool), only at the poses at which this marker is lost, or only where it is not
    """

    css: str
    at: tuple[Run, ...]
    _: KW_ONLY
    lowest: bool = False
    when: tuple[int, bool] | None = None


@dataclass(frozen=True)
class Line(Part):
    """A line through the points of each run, all in one path.

    tail : str, path data from the end of each run on, px
    every : bool, at all poses in place of the picked one; opacity : float
    """

    _: KW_ONLY
    tail: str = ""
    every: bool = False
    opacity: float = 1.0


@dataclass(frozen=True)
class Dot(Part):
    """A circle about each point of the runs, with a radius of so many mm and px."""

    _: KW_ONLY
    mm: int = 0
    px: float = 0.0


@dataclass(frozen=True)
class Rods(Part):
    """A broad line along each run, nearer ones over farther ones, in a group of their own.

    mm : tuple of int, their radii
    layers : tuple of (str, float), what each is made of: class, and px by which it is wider
    """

    mm: tuple[int, ...]
    layers: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Text(Part):
    """Words in the middle of each run; none where that is outside of the drawing.

    down : float, px
    beyond : (point, px), first moved so far, away from where this point is in the drawing
    least : float, px; none where that point is nearer than this in the drawing
    """

    words: str
    _: KW_ONLY
    down: float = 0.0
    beyond: tuple[int, float] | None = None
    least: float = 0.0


@dataclass(frozen=True, eq=False)
class Picture:
    """What is to be seen at m poses.

    title, description : str
    points : ndarray of int, shape (m, k, 3), mm
    still : int, how many points, the first ones, stand at one place at all poses
    tip : int, the point at which a pose is picked, and which stays in its place in zooming
    lost : tuple of tuple of int, the markers that are lost, for each pose
    frame : ndarray of int, shape (c, 3), mm, corners of all that the drawing must show
    parts : tuple of Part, later ones over earlier ones
    """

    title: str
    description: str
    points: IntArray
    still: int
    tip: int
    lost: tuple[tuple[int, ...], ...]
    frame: IntArray
    parts: tuple[Part, ...]
