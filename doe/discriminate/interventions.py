"""What could be changed where no pose tells rivals apart: each as a situation of its own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.arm.se3 import so3_exp
from calib.arrays import Array
from calib.effects.base import Base
from calib.effects.protocol import ReadingEffect
from calib.effects.thermal_expansion import translations
from doe.discriminate.session import Hung
from doe.discriminate.situation import Situation

_HEAVIER = 2.0
_ASIDE = 0.1  # of the arm's reach: how far a load moves to the side
_WARMER = 10.0  # K
_TILT = np.radians(10.0)
_LIGHT = 0.1  # of the arm's own mass: a load where none is known
_UNKNOWN_ARM = 5.0  # kg: the same where the URDF has no masses
_SECOND = "second station"


@dataclass(frozen=True, eq=False)
class Intervention:
    """A change of the conditions.

    name : str, short; says : str, what to do, with its size
    situation : Situation, of the readings to come
    """

    name: str
    says: str
    situation: Situation


def interventions(situation: Situation) -> Iterator[Intervention]:
    """Every change that makes sense in a cell, the easy ones first."""
    says = "choose as many poses again, for this pair alone"
    yield Intervention("more_poses", says, situation)
    yield from _sides(situation)
    yield from _loads(situation)
    yield from _warm(situation)
    yield _station(situation)
    yield from _link_masses(situation)
    yield _tilted(situation)


def _sides(situation: Situation) -> Iterator[Intervention]:
    session = situation.session
    if session.motion is not None and not session.sides:
        changed = replace(situation, session=replace(session, sides=(1.0, -1.0)))
        says = "reach every pose from both sides, all joints rising and all joints falling"
        yield Intervention("reverse_approach", says, changed)


def _loads(situation: Situation) -> Iterator[Intervention]:
    session = situation.session
    present = [load for load in session.loads if not load.free]
    load = present[-1] if present else _light(situation)
    aside = _ASIDE * situation.model.robot.reach * np.eye(3)[1]
    mass = _mass(situation, load)
    shown = f"{1e3 * aside[1]:.0f} mm to the side (y of the tip)"
    offered = [(load.shifted(aside), f"hang the load of {mass:.3g} kg {shown}")]
    if present:
        heavy = load.scaled(_HEAVIER)
        limit = "check the arm's payload, which the cell does not give"
        offered.insert(0, (heavy, f"hang {_HEAVIER * mass:.3g} kg at the same point; {limit}"))
    else:
        offered.insert(0, (load, f"hang {mass:.3g} kg at the tip; the data have no load"))
    for other, says in offered:
        added = replace(session, loads=(*session.loads, other))
        yield Intervention("another_load", says, replace(situation, session=added))


def _light(situation: Situation) -> Hung:
    """A load for an arm that carried none."""
    load = situation.cell.load
    if load is not None:
        mass, at = load.mass, np.asarray(load.com)
    else:
        own = float(situation.model.robot.masses.sum())
        mass, at = (_LIGHT * own if own else _UNKNOWN_ARM), np.zeros(3)
    return Hung(mass * situation.model.gravity, at, np.zeros(3), 0.0, np.zeros(3))


def _mass(situation: Situation, load: Hung) -> float:
    pull = float(np.linalg.norm(situation.model.gravity)) or 9.80665
    return load.mass + float(np.linalg.norm(load.force)) / pull


def _warm(situation: Situation) -> Iterator[Intervention]:
    session = situation.session
    if session.temperature is not None:
        warm = replace(session, temperature=session.temperature + _WARMER)
        says = f"let the arm warm by {_WARMER:.0f} K, then go on"
        yield Intervention("warm_up", says, replace(situation, session=warm))


def _station(situation: Situation) -> Intervention:
    """A second instrument: it shares the base's motion with the first, and none of its own."""
    second = _placed_anew(situation)
    session = second.session
    if session.time is not None:
        length = (session.time - session.start) / max(1, session.each)
        pace = max(session.pace, length / _POSES)
        second = replace(second, session=replace(session, pace=pace))
    own = tuple(
        e for e in situation.model.effects if isinstance(e, ReadingEffect) and "time" in e.uses
    )
    says = "measure from another instrument that stands elsewhere, for as long as the data took"
    return Intervention("another_station", says, replace(second, silent=own))


_POSES = 8  # poses over which a second session is spread


def _link_masses(situation: Situation) -> Iterator[Intervention]:
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
        yield Intervention("mass_on_link", says, changed)


def _tilted(situation: Situation) -> Intervention:
    """Gravity from another side: the base stands anew, so its placement is unknown again."""
    R = so3_exp(np.array([_TILT, 0.0, 0.0]))
    anew = _placed_anew(situation)
    loads = tuple(replace(h, force=R @ h.force, moment=R @ h.moment) for h in anew.session.loads)
    changed = replace(
        anew,
        model=replace(anew.model, gravity=R @ anew.model.gravity),
        session=replace(anew.session, loads=loads),
    )
    says = f"mount the base tilted by {np.degrees(_TILT):.0f} deg"
    return Intervention("tilted_base", says, changed)


def _placed_anew(situation: Situation) -> Situation:
    """The same with the base somewhere unknown in the frame of the readings to come."""
    model, session = situation.model, situation.session
    here: list[Base] = [
        e for e in model.effects if isinstance(e, Base) and e.station == session.station
    ]
    count = len(session.stations)
    base = Base(_SECOND, count, here[0].of) if here else Base(_SECOND, count)
    start = situation.values[model.slices[model.effects.index(here[0])]] if here else np.zeros(6)
    return replace(
        situation,
        model=model.with_effects((*model.effects, base)),
        values=np.concatenate([situation.values, start]),
        session=replace(session, station=count, stations=(*session.stations, _SECOND)),
    )


def padded(rows: Array, situation: Situation) -> Array:
    """Rows of the data with zeros for what only a changed situation has, shape (N, p)."""
    more = len(situation.model.parameters) - rows.shape[1]
    return np.pad(rows, ((0, 0), (0, more)))
