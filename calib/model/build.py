"""From a cell and the poses in hand to the model with its active effects."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from calib.arm.statics import loads_of
from calib.arrays import Array
from calib.cell import Cell
from calib.effects import ENDS, GROUPS, Context, Effect, catalogue
from calib.effects.context import ARM, turning_joints
from calib.effects.geometry import Geometry
from calib.effects.protocol import Constant, ElasticEffect, LoadEffect, PoseEffect
from calib.effects.readings import ReadingEffect
from calib.effects.tool_base import Tool, sought
from calib.effects.tuned import amid
from calib.errors import EffectCannotAct, UnknownEffect
from calib.model import Model
from calib.model.reduction import Dropped, irreducible
from calib.model.sizes import elementary, stated
from calib.poses import Poses

_MOST_KNOTS = 8  # distinct angles up to this number become knots of their own
_SAME_ANGLE = 1e-3  # rad: angles closer than this are one level
_PROBED = 200  # poses at which it is tried whether an effect acts
_MOVES_NOTHING = 1e-10  # m: largest movement of a marker by an effect that does not act
_MOST_NAMED = 4  # absorbing parameters that a refusal names
_COVARIATES = {
    "temperature": ("the poses have no temperature", "add column temperature_degC"),
    "time": ("the poses have no time", "add column time_s"),
    "approach": (
        "nothing says from which side the joints came",
        "add columns approach_<joint>, or give measured poses in their order",
    ),
    "motion": ("nothing says how far the joints went before", "give measured poses in their order"),
    "torque": ("the poses have no torques that the arm measured", "add columns <joint>_Nm"),
}


@dataclass(frozen=True, eq=False)
class Built:
    """A model and how it came about.

    model : Model, with an irreducible set of constant parameters
    dropped : tuple of Dropped, constants that others absorb; full : Model, with these as well
    """

    model: Model
    dropped: tuple[Dropped, ...]
    full: Model


def parse_effect(text: str, key: str = "[model] effects") -> tuple[str, tuple[str, ...] | None]:
    """``name`` or ``name:where[,where]`` -> name and places, None for everywhere.

    key : str, of the cell file, where it stands
    Raises UnknownEffect, naming the closest known one.
    """
    name, colon, rest = text.partition(":")
    name = name.strip()
    if name not in catalogue():
        hint = _hint(name, catalogue(), "known")
        raise UnknownEffect(f"unknown effect {name!r} in {key}; {hint}")
    return name, tuple(place.strip() for place in rest.split(",")) if colon else None


def _hint(name: str, known: Iterable[str], what: str) -> str:
    close = difflib.get_close_matches(name, known, n=1)
    return f"did you mean {close[0]!r}?" if close else f"{what} are: {', '.join(known)}"


def parse_excluded(text: str, context: Context) -> tuple[str, ...]:
    """What ``name`` or ``name:where[,where]`` in ``[diagnosis] exclude`` rules out: causes one by one.

    Raises UnknownEffect, naming the closest known effect or place.
    """
    key = "[diagnosis] exclude"
    name, places = parse_effect(text, key)
    if name in GROUPS:
        raise UnknownEffect(f"{name!r} in {key} is no cause; it belongs to [model] effects")
    known = catalogue()[name].places(context)
    for where in places or ():
        if where not in known:
            hint = _hint(where, known, "places")
            raise UnknownEffect(f"{name} has no place {where!r} in {key}; {hint}")
    return (name,) if places is None else tuple(f"{name}:{where}" for where in places)


def place_effect(
    name: str, where: str, context: Context, parameters: Sequence[str] | None = None
) -> Effect:
    """An effect of the catalogue at a place; with the parameters of a result, where they are given.

    Raises UnknownEffect where the robot has no such place, EffectCannotAct where something that the
    effect needs is missing.
    """
    kind, joints = catalogue()[name], context.robot.joints
    if parameters is not None:
        context = replace(context, parameters=tuple(parameters))
    places, turning = kind.places(context), turning_joints(context)
    on_joints = not places or any(place in joints for place in places)
    if where not in places and not (on_joints and where in joints):
        known = ", ".join(places) or "none on this robot"
        what = f"{name} has no place {where!r} in [model] effects"
        raise UnknownEffect(f"{what}; places are: {known}")
    if where in joints and where not in (*places, *turning) and places == turning:
        remedy = "name a joint that turns"
        raise EffectCannotAct(f"{name}:{where}", f"{where} is a prismatic joint", remedy)
    effect = kind.at(context, where)
    for covariate in kind.uses:
        if covariate in context.lacking:
            raise EffectCannotAct(f"{name}:{where}", *_COVARIATES[covariate])
    if parameters is None or not isinstance(effect, Geometry | Tool):
        return effect
    names = [p.name for p in effect.parameters]
    return effect.only(tuple(names.index(name) for name in parameters if name in names))


def default_knots(q: Array) -> Array:
    """Angles at which ``stiffness_vs_angle`` gets coefficients, shape (k,), rad, ascending.

    q : ndarray, shape (m,), rad, the angles in hand; their own where they are few, else five evenly
    """
    q = np.sort(q)
    starts = np.flatnonzero(np.diff(q, prepend=-np.inf) > _SAME_ANGLE)
    if len(starts) <= _MOST_KNOTS:
        return np.array([level.mean() for level in np.split(q, starts[1:])])
    return np.linspace(q[0], q[-1], 5)


def context_of(cell: Cell, poses: Poses | None) -> Context:
    """What the effects may ask for: the cell, and knots from the poses where it gives none."""
    knots = dict(cell.knots)
    for index, joint in enumerate(cell.robot.joints):
        if joint not in knots and poses is not None and len(poses):
            knots[joint] = default_knots(poses.q[:, index])
        elif joint not in knots and joint in cell.design.levels:
            levels = cell.design.levels[joint].values
            if levels is not None:
                knots[joint] = levels
    own = {field.name: getattr(cell, field.name) for field in fields(Cell)} | {"knots": knots}
    if poses is None:
        return Context(**own, measured_load=cell.load is not None)
    return Context(
        **own,
        stations=poses.stations,
        measured_load=bool(poses.wrench.any() or poses.load_mass.any()),
        lacking=lacking(poses),
        clock_unit=poses.clock_unit,
    )


def lacking(poses: Poses) -> frozenset[str]:
    """What effects may ask for and the poses do not have."""
    missing = frozenset(name for name in _COVARIATES if getattr(poses, name) is None)
    return missing if poses.order is None else missing - {"time"}


def build(cell: Cell, poses: Poses | None = None) -> Built:
    """The model of a cell for the poses in hand: a plan's or a data set's.

    Raises UnknownEffect, EffectCannotAct where an effect lacks what it needs.
    """
    cell.check_poses()
    context = context_of(cell, poses)
    effects = placed_effects(cell, context)
    standing = {e.where for e in effects if e.kind == "base"}
    effects = [*(base for base in sought(context) if base.where not in standing), *effects]
    full = model_of(cell, effects)
    built = Built(*irreducible(full), full)
    _refuse_absorbed(_placed(cell, context), full, built)
    if isinstance(cell.size_prior, str):
        return built
    prior = stated(elementary(built.model, full), cell.size_prior)
    return replace(built, model=replace(built.model, prior=prior))


def placed_effects(cell: Cell, context: Context) -> list[Effect]:
    """What ``[model] effects`` says, before any constant is left out for others that absorb it.

    Raises UnknownEffect, EffectCannotAct where an effect lacks what it needs.
    """
    effects: list[Effect] = []
    for text in cell.effects:
        name, places = parse_effect(text)
        if name in ENDS and places is not None:
            raise UnknownEffect(f"{name!r} takes no places, found {text!r}; write {name!r}")
        # The arm as a whole is what its links are one by one.
        taken = {ARM} | {e.where for e in effects if _same_unknown(e.kind, name)}
        for where in places or [w for w in catalogue()[name].places(context) if w not in taken]:
            if any(e.kind == name and e.where == where for e in effects):
                raise UnknownEffect(f"{name}:{where} stands twice in [model] effects")
            effects.append(place_effect(name, where, context))
    return effects


def is_constant(kind: str) -> bool:
    """Whether an effect is a displacement that is the same at every pose."""
    return kind in catalogue() and issubclass(catalogue()[kind], Constant)


def model_of(cell: Cell, effects: Sequence[Effect]) -> Model:
    """The cell's robot, markers and instruments with these effects, none of them left out."""
    return Model(
        cell.robot,
        cell.marker_names,
        cell.markers,
        tuple(effects),
        cell.payload,
        cell.gravity,
        cell.instruments,
        lengths=cell.known_distances,
        marker_frames=cell.marker_frames,
    )


def _refuse_absorbed(placed: set[tuple[str, str]], full: Model, built: Built) -> None:
    """An effect that the user placed and that others stand for whole must not vanish in silence.

    Of a group's places some may: the reduction is to choose among them.
    """
    absorbed = {d.id: d.absorbed_by for d in built.dropped}
    ids_of: dict[tuple[str, str], list[str]] = {}
    for effect in full.effects:
        ids = ids_of.setdefault(_cause(effect.kind, effect.where), [])
        ids += [p.id for p in effect.parameters]
    for (kind, where), ids in ids_of.items():
        if (kind, where) in placed and all(i in absorbed for i in ids):
            others = list(dict.fromkeys(name for i in ids for name, _ in absorbed[i]))
            raise EffectCannotAct(f"{kind}:{where}" if where else kind, *_absorbed_by(others))


def _absorbed_by(others: Sequence[str]) -> tuple[str, str]:
    """Why an effect shows nothing of its own, and what to do."""
    if not others:
        return (
            "it moves nothing that is read against the instrument that reads it",
            "take it out of [model] effects, or read it from the world",
        )
    more = len(others) - _MOST_NAMED
    named = ", ".join(others[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
    return (
        f"{named} {'move' if len(others) > 1 else 'moves'} the markers in the same way",
        "take it out of [model] effects, or take out the other",
    )


def _placed(cell: Cell, context: Context) -> set[tuple[str, str]]:
    """(effect, where) of all effects that the cell names with a place, or that have only one."""
    causes = set()
    for name, places in map(parse_effect, cell.effects):
        known = catalogue()[name].places(context)
        single = known if len(known) == 1 and name not in GROUPS else ()
        causes |= {_cause(name, where) for where in places or single}
    return causes


def _cause(kind: str, where: str) -> tuple[str, str]:
    """(effect, where), of a group as a whole without where."""
    return kind, "" if kind in GROUPS else where


def _same_unknown(kind: str, other: str) -> bool:
    """Whether one needs nothing of the other beside it; what constants absorb, the reduction says."""
    if kind == other or is_constant(kind) or is_constant(other):
        return kind == other
    known = catalogue()
    return other in known[kind].parts or kind in known[other].parts


def refuse_idle_effects(cell: Cell, model: Model, poses: Poses) -> None:
    """Refuse effects that the user placed and that no poses of this kind would show.

    Effects named for everywhere may stand idle at some places, and so may those of single joints; what
    they lack is reported with the parameters that cannot be identified.

    Raises EffectCannotAct.
    """
    kinds = (ElasticEffect, LoadEffect, PoseEffect, ReadingEffect)
    acting = (e for e in model.effects if isinstance(e, kinds))
    part = model.with_effects(tuple(amid(e, poses) for e in acting))
    if not part.effects:
        return
    placed = _placed(cell, context_of(cell, poses))
    soft = part.initial
    elastic = part.where(ElasticEffect)
    soft[elastic] = part.sizes[elastic]
    few = poses.take(np.unique(np.linspace(0, len(poses) - 1, _PROBED).astype(int)))
    _, J = part.jacobian(soft, few)
    moved = np.abs(J).max(axis=(0, 1, 2)) * part.sizes
    for effect, columns in part.parts:
        if (effect.kind, effect.where) in placed and moved[columns].max() < _MOVES_NOTHING:
            _refuse_idle(effect, part, poses)


def _refuse_idle(effect: Effect, model: Model, poses: Poses) -> None:
    """Why an effect moves nothing; ``model`` holds what is not constant in the user's model.

    Raises EffectCannotAct, but for a joint that these poses happen not to move or to stress.
    """
    name = f"{effect.kind}:{effect.where}"
    bends = isinstance(effect, ElasticEffect | LoadEffect)
    if isinstance(effect, LoadEffect) and not len(model.where(ElasticEffect)):
        remedy = "add joint_compliance, or take it out of [model] effects"
        raise EffectCannotAct(name, "nothing in the model is elastic", remedy)
    if bends and loads_of(model.robot, poses, model.payload, model.gravity).absent:
        remedy = "give wrench columns (fz_N ..), [payload], or link masses in the robot's file"
        raise EffectCannotAct(name, "nothing loads the arm", remedy)
    remedy = "load the arm so that it is stressed" if bends else "move more joints"
    if effect.uses:
        remedy = f"measure where {' and '.join(effect.uses)} differs"
    elif effect.where in model.robot.joints:
        return
    reason = "it moves no marker at any of these poses"
    raise EffectCannotAct(name, reason, f"take it out of [model] effects, or {remedy}")
