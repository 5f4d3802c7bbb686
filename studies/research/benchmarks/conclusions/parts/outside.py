"""One cause a day that no catalogue holds: nothing is right but to say where it is, and no name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from studies.research.benchmarks.conclusions.days import Day, by_turns
from studies.research.benchmarks.conclusions.parts.foreign import plain_day
from studies.research.benchmarks.conclusions.sizing import (
    NoSuchDay,
    Visibility,
    drawn_noncentrality,
)
from studies.research.benchmarks.conclusions.true_causes import TrueCause
from studies.research.withheld.actions import Action, State
from studies.research.withheld.causes import outside_of
from studies.research.withheld.match import HELD
from studies.research.withheld.outside import OUTSIDE
from studies.research.withheld.scene import Scene

KINDS = tuple(
    kind
    for kind in OUTSIDE
    if kind not in (*HELD, "marker_load")  # no load is hung on these days
)
_DRIVES = ("creep", "hardening_drive")


def _draw(rng: np.random.Generator, kind: str, scatters: bool) -> Day:
    day, still = plain_day(rng, kind, scatters)
    cause = _cause(rng, day.scene, kind)
    visible = Visibility(day.scene, day.mechanism, still)
    cause = visible.sized(cause, drawn_noncentrality(rng))
    return replace(day, causes=(cause,), noncentrality=(visible.alone(cause),))


def _cause(rng: np.random.Generator, scene: Scene, kind: str) -> TrueCause:
    """As the sealed cases draw it. Raises NoSuchDay where this arm cannot have it."""
    soft = any(joint.compliance for joint in scene.arm.joints)
    if (kind in _DRIVES and not soft) or (kind.startswith("marker") and len(scene.markers) == 1):
        raise NoSuchDay
    drawn = outside_of(rng, scene, kind)

    def act(scene: Scene, state: State) -> Action:
        return OUTSIDE[kind].act(scene, state, drawn.where, drawn.values)

    return TrueCause(kind, drawn.where, act, ())


draw = by_turns(KINDS, _draw)
