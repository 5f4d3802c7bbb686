"""Error of one link: a constant displacement of the frame at its end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from calib.effects.geometry import Geometry


@dataclass(frozen=True, eq=False)
class LinkGeometry(Geometry):
    """The six errors of the segment that ends at a joint, or at the tip."""

    kind: ClassVar[str] = "link_geometry"
    parts: ClassVar[tuple[str, ...]] = ()
