"""What could be changed where no pose tells causes apart: each change as a situation of its own.

No list says which cause has which remedy: each change is tried after the plan, and the causes compared
again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np

from calib.arm.se3 import so3_exp
from calib.arrays import Array, IntArray, stacked
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.detection_limit import detectable
from calib.diagnosis.screen import field
from calib.diagnosis.stage import positions
from calib.diagnosis.stepwise import ALPHA
from calib.effects.base import Base
from calib.effects.link_growth import translations
from calib.effects.readings import ReadingEffect
from calib.model import Model
from calib.model.covariance import identifiable
from calib.threads import one_blas_thread
from doe.ahead.conditions import TipLoad
from doe.ahead.foresee import PowerAnalysis, told_apart
from doe.ahead.situation import Situation, situation_of

_HEAVIER = 2.0
_ASIDE = 0.1  # of the arm's reach: how far a load moves to the side
_WARMER = 10.0  # K
_TILT = np.radians(10.0)
_LIGHT = 0.1  # of the arm's own mass: a load where none is known
_UNKNOWN_ARM = 5.0  # kg: the same where the URDF has no masses
_SECOND = "second station"
_PULL = 200.0  # N
_MOST = 3  # that are named
_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class Change:
    """A change of the conditions.

    name : str, short; says : str, what to do, with its size
    situation : Situation, of the readings to come
    """

    name: str
    says: str
    situation: Situation


def changes(situation: Situation) -> Iterator[Change]:
    """Every change that makes sense in a cell, the easy ones first."""
    says = "choose as many poses again, for this pair alone"
    yield Change("more_poses", says, situation)
    conditions = situation.conditions
    if conditions.motion is not None and not conditions.sides:
        says = "reach every pose from both sides, all joints rising and all joints falling"
        yield Change("reverse_approach", says, situation.under(sides=(1.0, -1.0)))
    yield from _loads(situation)
    yield _pulled(situation)
    if conditions.temperature is not None:
        says = f"let the arm warm by {_WARMER:.0f} K, then go on"
        warm = conditions.temperature + _WARMER
        yield Change("warm_up", says, situation.under(temperature=warm))
    yield _station(situation)
    yield from _link_masses(situation)
    yield _tilted(situation)


def easiest(found: Iterable[_T], name: Callable[[_T], str]) -> tuple[_T, ...]:
    """The first few, one of a name."""
    best: dict[str, _T] = {}
    for one in found:
        best.setdefault(name(one), one)
    return tuple(best.values())[:_MOST]


def _loads(situation: Situation) -> Iterator[Change]:
    loads = situation.conditions.loads
    present = [load for load in loads if not load.free]
    load = present[-1] if present else _light(situation)
    aside = _ASIDE * situation.model.robot.reach * np.eye(3)[1]
    mass = load.mass_under(situation.model.gravity)
    shown = f"{1e3 * aside[1]:.0f} mm to the side (y of the tip)"
    offered = [(load.shifted(aside), f"hang the load of {mass:.3g} kg {shown}")]
    if present:
        heavy = load.scaled(_HEAVIER)
        limit = "check the arm's payload, which the cell does not give"
        offered.insert(0, (heavy, f"hang {_HEAVIER * mass:.3g} kg at the same point; {limit}"))
    else:
        offered.insert(0, (load, f"hang {mass:.3g} kg at the tip, which no reading has so far"))
    for other, says in offered:
        yield Change("another_load", says, situation.under(loads=(*loads, other)))


def _pulled(situation: Situation) -> Change:
    """Forces across gravity, which turns no vertical axis."""
    nothing = np.zeros(3)
    across = np.linalg.svd(situation.model.gravity[None])[2][1:]
    pulls = (TipLoad(_PULL * way, nothing, nothing, 0.0, nothing) for way in across)
    says = f"pull at the tip with {_PULL:.0f} N, level, in two directions across each other"
    loads = (*situation.conditions.loads, *pulls)
    return Change("sideways_pull", says, situation.under(loads=loads))


def _light(situation: Situation) -> TipLoad:
    """A load for an arm that carried none."""
    load = situation.cell.load
    if load is not None:
        mass, at = load.mass, np.asarray(load.com)
    else:
        own = float(situation.model.robot.masses.sum())
        mass, at = (_LIGHT * own if own else _UNKNOWN_ARM), np.zeros(3)
    return TipLoad(mass * situation.model.gravity, at, np.zeros(3), 0.0, np.zeros(3))


def _station(situation: Situation) -> Change:
    """A second instrument: it shares the base's motion with the first, and none of its own."""
    second, conditions = _placed_anew(situation), situation.conditions
    if conditions.time is not None:
        length = (conditions.time - conditions.start) / max(1, conditions.each)
        second = second.under(pace=max(conditions.pace, length / _POSES))
    own = tuple(
        e for e in situation.model.effects if isinstance(e, ReadingEffect) and "time" in e.uses
    )
    says = "measure from another instrument that stands elsewhere, for as long again"
    return Change("another_station", says, replace(second, silent=own))


_POSES = 8  # poses over which a second session is spread


def _link_masses(situation: Situation) -> Iterator[Change]:
    """A known body halfway along each of the two longest links that a joint carries."""
    model = situation.model
    robot = model.robot
    ahead = translations(robot)[1:]
    mass = _LIGHT * float(robot.masses.sum()) or _UNKNOWN_ARM
    longest = np.argsort(-np.linalg.norm(ahead, axis=1))[:2]
    for link in np.sort(longest):
        # In the axes of the frame that moves with the joint.
        at = 0.5 * robot.origins[link + 1, :3, 3]
        total = robot.masses[link] + mass
        coms, masses = robot.coms.copy(), robot.masses.copy()
        coms[link] = (robot.masses[link] * coms[link] + mass * at) / total
        masses[link] = total
        heavier = replace(robot, masses=masses, coms=coms)
        says = f"clamp a known mass of {mass:.3g} kg halfway along the link of {robot.joints[link]}"
        changed = replace(situation, model=replace(model, robot=heavier))
        yield Change("mass_on_link", says, changed)


def _tilted(situation: Situation) -> Change:
    """Gravity from another side: the base stands anew, so its placement is unknown again."""
    R = so3_exp(np.array([_TILT, 0.0, 0.0]))
    anew = _placed_anew(situation)
    loads = tuple(replace(h, force=R @ h.force, moment=R @ h.moment) for h in anew.conditions.loads)
    turned = replace(anew.model, gravity=R @ anew.model.gravity)
    changed = replace(anew.under(loads=loads), model=turned)
    says = f"mount the base tilted by {np.degrees(_TILT):.0f} deg"
    return Change("tilted_base", says, changed)


def _placed_anew(situation: Situation) -> Situation:
    """The same with the base somewhere unknown in the frame of the readings to come."""
    model, conditions = situation.model, situation.conditions
    here: list[Base] = [
        e for e in model.effects if isinstance(e, Base) and e.station == conditions.station
    ]
    count = len(conditions.stations)
    base = Base(_SECOND, count, here[0].of) if here else Base(_SECOND, count)
    start = situation.values[model.slices[model.effects.index(here[0])]] if here else np.zeros(6)
    moved = situation.under(station=count, stations=(*conditions.stations, _SECOND))
    values = np.concatenate([situation.values, start])
    return replace(moved, model=model.with_effects((*model.effects, base)), values=values)


_WORTH = 5.0  # times its smallest size at which a cause must be told apart for a change to be named


@one_blas_thread
def remedies_of(found: PowerAnalysis) -> tuple[tuple[Change, ...], ...]:
    """Changes by which each group of confounded causes would be told apart, the easy ones first.

    A change counts if every two of the group are told apart from five times their smallest size on.
    """
    view, groups = found.view, found.confounded
    if not groups:
        return ()
    every = [found.seen[i].candidate for group in groups for i in group]
    model, values = view.model.extended(view.values, [c.effect for c in every])
    at = [positions(view.whole.model, effect) for effect in model.effects]
    rows = view.rows[:, np.concatenate(at)]
    situation = situation_of(replace(view.whole, model=model, values=values), view.data)
    q = situation.feasible(int(view.data.poses.configuration.max()) + 1, seed=0)
    named: list[list[Change]] = [[] for _ in groups]
    for change in changes(situation):
        allowed = change.situation.allowed(q)
        if not len(allowed):
            continue
        further = change.situation.in_order(allowed)
        # What only the further readings have is nothing to the plan.
        more = np.pad(rows, ((0, 0), (0, further.shape[-1] - rows.shape[1])))
        both = np.concatenate([more, stacked(further)])
        modelled = np.delete(np.arange(both.shape[1]), np.s_[len(view.values) : rows.shape[1]])
        for group, own in zip(groups, named, strict=True):
            members = [found.seen[i].candidate for i in group]
            if _worst_times(change.situation.model, both, modelled, members, view.asked) < _WORTH:
                own.append(change)
    return tuple(easiest(own, lambda change: change.name) for own in named)


def _worst_times(
    model: Model, rows: Array, modelled: IntArray, members: Sequence[Candidate], asked: int
) -> float:
    """Multiple of its smallest size from which on the worst of a group is told from the others."""
    sizes, ids = model.sizes[modelled], [model.parameters[i].id for i in modelled]
    kept = modelled[identifiable(rows[:, modelled], sizes, tuple(ids)).kept]
    at = [np.setdiff1d(positions(model, c.effect), model.tunings) for c in members]
    ends = np.cumsum([0, *map(len, at)])
    view = field(rows[:, kept], rows[:, np.concatenate(at)], np.zeros(len(rows)))
    columns = [np.arange(a, b) for a, b in pairwise(ends)]
    seen = [
        detectable(view, own, asked * c.tried, ALPHA)
        for own, c in zip(columns, members, strict=True)
    ]
    if not all(one.directions for one in seen):
        return np.inf
    plausible = [np.array([p.size for p in c.amounts]) for c in members]
    return float(told_apart(view, columns, plausible, [one.needed for one in seen])[1].max())
