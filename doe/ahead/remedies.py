"""What could be changed where no pose tells causes apart: each change as a forecast of its own.

No list says which cause has which remedy: each change is tried after the plan, and the causes compared
again.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias, TypeVar

import numpy as np

from calib.arm.se3 import so3_exp
from calib.arrays import Array, stacked
from calib.effects.base import Base
from calib.effects.link_growth import translations
from calib.effects.readings import ReadingEffect
from calib.model.covariance import identifiable
from calib.threads import one_blas_thread
from doe.ahead.coming import TipLoad
from doe.ahead.forecast import Forecast
from doe.ahead.foresee import CauseDetection, PowerAnalysis

_HEAVIER = 2.0
_ASIDE = 0.1  # of the arm's reach: how far a load moves to the side
_WARMER = 10.0  # K
_TILT = np.radians(10.0)
_LIGHT = 0.1  # of the arm's own mass: a load where none is known
_UNKNOWN_ARM = 5.0  # kg: the same where the URDF has no masses
_SECOND = "second station"
_PULL = 200.0  # N
_MOST = 3  # that are named
_Key = TypeVar("_Key", bound=Hashable)


Change: TypeAlias = tuple[str, str, Forecast]
"""A short name, what to do, with its size, and the forecast of readings after that."""


@dataclass(frozen=True)
class Remedy:
    """A change that tells causes apart.

    name : str, short; says : str, what to do, with its size
    probability : float, that the true cause is preferred; one where nothing more than yes was asked
    """

    name: str
    says: str
    probability: float


def changes(forecast: Forecast) -> Iterator[Change]:
    """Every change that makes sense in a cell, the easy ones first."""
    says = "choose as many poses again, for this pair alone"
    yield "more_poses", says, forecast
    conditions = forecast.conditions
    if conditions.motion is not None and not conditions.sides:
        says = "reach every pose from both sides, all joints rising and all joints falling"
        yield "reverse_approach", says, forecast.under(sides=(1.0, -1.0))
    yield from _loads(forecast)
    yield _pulled(forecast)
    if conditions.temperature is not None:
        says = f"let the arm warm by {_WARMER:.0f} K, then go on"
        warm = conditions.temperature + _WARMER
        yield "warm_up", says, forecast.under(temperature=warm)
    yield _station(forecast)
    yield from _link_masses(forecast)
    yield _tilted(forecast)


def helpful(
    forecast: Forecast,
    q: Array,
    helps: Callable[[Forecast, Array], Iterable[tuple[_Key, float]]],
    least: float,
) -> dict[_Key, tuple[Remedy, ...]]:
    """The surest few changes of each key, one of a name; where they are equal the easier ones first.

    q : ndarray, shape (m, dof), candidates; helps : callable, a changed forecast and the candidates
        that it allows -> probability that it helps each key; least : which is enough
    """
    found: dict[_Key, list[Remedy]] = {}
    for name, says, changed in changes(forecast):
        allowed = changed.allowed(q)
        for key, sure in helps(changed, allowed) if len(allowed) else ():
            if sure >= least:
                found.setdefault(key, []).append(Remedy(name, says, sure))
    return {key: _surest(own) for key, own in found.items()}


def _surest(found: Sequence[Remedy]) -> tuple[Remedy, ...]:
    best: dict[str, Remedy] = {}
    for remedy in sorted(found, key=lambda own: -round(own.probability, 2)):
        best.setdefault(remedy.name, remedy)
    return tuple(best.values())[:_MOST]


def _loads(forecast: Forecast) -> Iterator[Change]:
    loads = forecast.conditions.loads
    present = [load for load in loads if not load.free]
    load = present[-1] if present else _light(forecast)
    aside = _ASIDE * forecast.model.robot.reach * np.eye(3)[1]
    mass = load.mass_under(forecast.model.gravity)
    shown = f"{1e3 * aside[1]:.0f} mm to the side (y of the tip)"
    shifted = replace(load, lever=load.lever + aside, com=load.com + aside)
    offered = [(shifted, f"hang the load of {mass:.3g} kg {shown}")]
    if present:
        heavy = replace(
            load,
            force=_HEAVIER * load.force,
            moment=_HEAVIER * load.moment,
            mass=_HEAVIER * load.mass,
        )
        limit = "check the arm's payload, which the cell does not give"
        offered.insert(0, (heavy, f"hang {_HEAVIER * mass:.3g} kg at the same point; {limit}"))
    else:
        offered.insert(0, (load, f"hang {mass:.3g} kg at the tip, which no reading has so far"))
    for other, says in offered:
        yield "another_load", says, forecast.under(loads=(*loads, other))


def _pulled(forecast: Forecast) -> Change:
    """Forces across gravity, which turns no vertical axis."""
    across = np.linalg.svd(forecast.model.gravity[None])[2][1:]
    pulls = (TipLoad(_PULL * way) for way in across)
    says = f"pull at the tip with {_PULL:.0f} N, level, in two directions across each other"
    loads = (*forecast.conditions.loads, *pulls)
    return "sideways_pull", says, forecast.under(loads=loads)


def _light(forecast: Forecast) -> TipLoad:
    """A load for an arm that carried none."""
    load = forecast.cell.load
    if load is not None:
        mass, at = load.mass, np.asarray(load.com)
    else:
        own = float(forecast.model.robot.masses.sum())
        mass, at = (_LIGHT * own if own else _UNKNOWN_ARM), np.zeros(3)
    return TipLoad(mass * forecast.model.gravity, at)


def _station(forecast: Forecast) -> Change:
    """A second instrument: it shares the base's motion with the first, and none of its own."""
    second, conditions = _placed_anew(forecast), forecast.conditions
    if conditions.time is not None:
        length = (conditions.time - conditions.start) / max(1, conditions.each)
        second = second.under(pace=max(conditions.pace, length / _POSES))
    own = tuple(
        e for e in forecast.model.effects if isinstance(e, ReadingEffect) and "time" in e.uses
    )
    says = "measure from another instrument that stands elsewhere, for as long again"
    return "another_station", says, replace(second, silent=own)


_POSES = 8  # poses over which a second session is spread


def _link_masses(forecast: Forecast) -> Iterator[Change]:
    """A known body halfway along each of the two longest links that a joint carries."""
    model = forecast.model
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
        changed = replace(forecast, model=replace(model, robot=heavier))
        yield "mass_on_link", says, changed


def _tilted(forecast: Forecast) -> Change:
    """Gravity from another side: the base stands anew, so its placement is unknown again."""
    R = so3_exp(np.array([_TILT, 0.0, 0.0]))
    anew = _placed_anew(forecast)
    loads = tuple(replace(h, force=R @ h.force, moment=R @ h.moment) for h in anew.conditions.loads)
    turned = replace(anew.model, gravity=R @ anew.model.gravity)
    changed = replace(anew.under(loads=loads), model=turned)
    says = f"mount the base tilted by {np.degrees(_TILT):.0f} deg"
    return "tilted_base", says, changed


def _placed_anew(forecast: Forecast) -> Forecast:
    """The same with the base somewhere unknown in the frame of the readings to come."""
    model, conditions = forecast.model, forecast.conditions
    here: list[Base] = [
        e for e in model.effects if isinstance(e, Base) and e.station == conditions.station
    ]
    count = len(conditions.stations)
    base = Base(_SECOND, count, here[0].of) if here else Base(_SECOND, count)
    start = forecast.values[model.slices[model.effects.index(here[0])]] if here else np.zeros(6)
    moved = forecast.under(station=count, stations=(*conditions.stations, _SECOND))
    values = np.concatenate([forecast.values, start])
    at = np.append(np.arange(len(forecast.values)), np.full(len(start), -1))
    return moved.with_model(model.with_effects((*model.effects, base)), values, at)


_WORTH = 5.0  # times its smallest size at which a cause must be told apart for a change to be named


@one_blas_thread
def remedies_of(found: PowerAnalysis) -> tuple[tuple[Remedy, ...], ...]:
    """Changes by which each group of confounded causes would be told apart, the easy ones first.

    A change counts if every two of the group are told apart from five times their smallest size on.
    """
    groups = found.confounded
    if not groups:
        return ()
    every = [found.seen[i].candidate for group in groups for i in group]
    model, values = found.model.extended(found.values, [c.effect for c in every])
    at = np.concatenate([found.forecast.model.positions(effect) for effect in model.effects])
    forecast = found.forecast.with_model(model, values, at)
    q = forecast.feasible(int(found.data.poses.configuration.max()) + 1, seed=0)
    causes = np.arange(len(found.values), len(values))

    def told(changed: Forecast, allowed: Array) -> Iterator[tuple[int, float]]:
        rows = changed.known.independent[1], stacked(changed.in_order(allowed))
        both, p = np.concatenate(rows), len(changed.values)
        modelled = np.setdiff1d(np.arange(p), causes)
        ids = tuple(changed.model.parameters[i].id for i in modelled)
        kept = identifiable(both[:, modelled], changed.model.sizes[modelled], ids).kept
        for k, group in enumerate(groups):
            members = [found.seen[i].candidate for i in group]
            own = CauseDetection.of(changed.model, both, modelled[kept], members, found.asked)
            seen = all(limit.directions for limit in own.limits)
            yield k, float(seen and own.told_apart()[1].max() < _WORTH)

    ways = helpful(forecast, q, told, 1.0)
    return tuple(ways.get(k, ()) for k in range(len(groups)))
