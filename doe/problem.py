"""The design problem of a cell: model, candidates, rules and criterion, ready to be solved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.build import build, parse_effect, refuse_idle_effects
from calib.cell import Cell
from calib.covariance import identifiable
from calib.effects.tool import Tool
from calib.errors import CalibError
from calib.model import Model
from calib.poses import IntArray, Poses, poses_at
from calib.se3 import Array
from calib.statics import loads_of
from calib.targets import targets_of
from doe.allowed import Allowed
from doe.blocks import Blocks
from doe.constraints import Constraint, constraints_of
from doe.criteria import CRITERIA, Criterion, Question
from doe.information import Regressor
from doe.levels import Levels
from doe.pool import Chunk, Pool, drawn, judge, rounded

RIDGE = 1e-10
"""Information that every plan has, in units of the pool's mean: singular plans get a tiny value."""
_PROBE, _PROBE_PER_LEVEL, _LONGEST_PROBE = 2000, 20, 65_536
_REGION = 200
_OUTSIDE = 1e-4  # rad or m: rounding of limits


class CannotIdentify(CalibError):
    """No plan of this cell determines every parameter."""

    def __init__(self, names: tuple[str, ...], text: str) -> None:
        self.names = names
        super().__init__(text)


@dataclass(frozen=True, eq=False)
class Wish:
    """What a user asks of a plan.

    poses : int, how many are to be chosen
    criterion : str, a key of ``doe.criteria.CRITERIA``
    levels : Levels or None
    of : tuple of str: effects or parameters that matter, or ``name=factor`` for a combination
    rivals : two effects to be told apart, ``effect:where``, or None
    fixed : Poses measured in any case, or None
    repeats : bool
    at_markers : bool, the error at the targets counts at the markers; None: if they are unknowns, else
        at the tip's origin
    """

    poses: int
    criterion: str
    levels: Levels | None = None
    of: tuple[str, ...] = ()
    rivals: tuple[str, str] | None = None
    fixed: Poses | None = None
    repeats: bool = False
    at_markers: bool | None = None


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything but the candidates.

    cell : Cell; with the rivals in its model where there are some
    wish : Wish
    regressor : Regressor, in coordinates in which the mean information of a probe is the identity
    constraints : tuple of Constraint
    criterion : Criterion
    targets, target_weights : Poses and ndarray, shape (K,), summing to one
    """

    cell: Cell
    wish: Wish
    regressor: Regressor
    constraints: tuple[Constraint, ...]
    criterion: Criterion
    targets: Poses
    target_weights: Array

    @property
    def model(self) -> Model:
        """The model that is to be identified."""
        return self.regressor.model

    @cached_property
    def fixed(self) -> Array:
        """Information of what is measured in any case, shape (p, p), made positive definite."""
        p = self.regressor.T.shape[1]
        M = RIDGE * np.eye(p)
        if self.wish.fixed is not None:
            M = M + self.information(self.wish.fixed.q).sum(axis=0)
        return M

    def information(self, q: Array) -> Array:
        """Information matrix of configurations, hidden markers left out, shape (m, p, p)."""
        from doe.constraints import scene_of, visible

        return self.regressor.information(q, visible(scene_of(self.cell, q)))

    def blocks(self, pool: Pool) -> Blocks:
        """Information of a pool beside what is fixed."""
        return Blocks(pool.packed, self.fixed)

    def rules(self, level: IntArray) -> Allowed:
        """Which sets of candidates make a plan, for candidates at these levels."""
        levels = self.wish.levels
        if levels is None:
            counts = np.array([self.wish.poses])
            return Allowed(level, np.zeros(1), counts, 1, repeats=self.wish.repeats)
        counts = np.full(len(levels.values), levels.per_level)
        return Allowed(
            level, levels.values, counts, levels.used, levels.separation, self.wish.repeats
        )

    @cached_property
    def target_rows(self) -> Array:
        """Rows of the targets, (K, r, p), m per y, the mean over markers in them."""
        return target_rows(self.regressor, self.targets, self.at_markers)

    @property
    def at_markers(self) -> bool:
        """Whether the error at the targets counts at the markers."""
        return counts_at_markers(self.model, self.wish)


def counts_at_markers(model: Model, wish: Wish) -> bool:
    """As wished, else whether the markers are unknowns."""
    known = not any(isinstance(e, Tool) for e in model.effects)
    return not known if wish.at_markers is None else wish.at_markers


def target_rows(regressor: Regressor, targets: Poses, at_markers: bool) -> Array:
    """``J`` at target poses, shape (K, rows, p), m per y, the mean over the markers in it."""
    model = replace(regressor.model)
    if not at_markers:
        model = replace(model, marker_names=("tip",), markers=np.zeros((1, 3)))
    _, J = model.jacobian(np.zeros(len(model.parameters)), targets)
    rows = J.reshape(len(targets), -1, J.shape[-1]) @ regressor.T
    return np.asarray(rows / np.sqrt(len(model.markers)))


def problem_of(cell: Cell, wish: Wish, seed: int = 0) -> Problem:
    """Set up the model, its coordinates and the criterion.

    Raises CalibError: unknown effects, targets outside the limits, no feasible candidate, parameters
    that no plan determines (CannotIdentify), a criterion that lacks what it needs.
    """
    if wish.rivals is not None:
        cell = _with_rivals(cell, wish.rivals)
    constraints = constraints_of(cell)
    model = build(cell, _angles(cell, wish, seed)).model
    regressor = Regressor(cell, model, np.diag(model.sizes))
    probe, seen = _probe(regressor, constraints, wish, seed)
    try:
        refuse_idle_effects(cell, model, _loaded(cell, probe))
    except CalibError as error:
        raise CannotIdentify((), str(error)) from None
    rows = regressor.rows(probe, seen)
    _check_identifiable(cell, model, rows, wish)
    regressor = replace(regressor, silent=_silent(cell, rows))
    regressor = regressor.whitened((np.swapaxes(rows, -1, -2) @ rows).mean(axis=0))
    targets, weights = targets_of(cell)
    _check_targets(cell, targets)
    weights = weights / weights.sum()
    question = Question(
        model,
        regressor.T,
        _subset(model, wish),
        _direction(model, wish),
        lambda: target_rows(regressor, targets, counts_at_markers(model, wish)),
        weights,
        regressor.information(probe[:_REGION], seen[:_REGION]),
        None if wish.rivals is None else _rival_rows(model, wish.rivals),
    )
    criterion = CRITERIA[wish.criterion].of(question)
    return Problem(cell, wish, regressor, constraints, criterion, targets, weights)


def no_candidate(count: int, removed: dict[str, int], where: str = "") -> str:
    """Why nothing is left to choose from."""
    causes = sorted(((n, name) for name, n in removed.items() if n), reverse=True)
    said = ", ".join(f"{name} removed {n}" for n, name in causes) or "nothing was drawn"
    return f"no feasible candidate{where}: of {count}, {said}; relax what removed most"


def _loaded(cell: Cell, q: Array) -> Poses:
    from calib.api import readings

    return readings(cell, poses_at(q))


def _probe(
    regressor: Regressor, constraints: tuple[Constraint, ...], wish: Wish, seed: int
) -> tuple[Array, NDArray[np.bool_]]:
    """Feasible configurations of every level and their visible markers: what the cell is like."""
    levels = wish.levels
    count = 1 if levels is None else len(levels.values)
    found: list[Chunk] = []
    per_level, tried = np.zeros(count, dtype=int), 0
    for q in drawn(regressor.cell, _LONGEST_PROBE, levels, seed + 1):
        found.append(judge(regressor, constraints, levels, q))
        tried += len(q)
        per_level += np.bincount(found[-1].level, minlength=count)
        every = levels is None or not levels.chosen or per_level.min() >= _PROBE_PER_LEVEL
        if per_level.sum() >= _PROBE and every:
            break
    needed = per_level if levels is not None and levels.chosen else per_level.sum(keepdims=True)
    for level in np.flatnonzero(needed == 0)[:1]:
        names = dict.fromkeys(name for part in found for name in part.fallen)
        none = np.zeros(count, dtype=int)
        fallen = {
            name: sum((part.fallen.get(name, none) for part in found), none) for name in names
        }
        if len(needed) == 1:
            raise CalibError(no_candidate(tried, {n: int(f.sum()) for n, f in fallen.items()}))
        removed = {name: int(counts[level]) for name, counts in fallen.items()}
        where = at_level(regressor.cell, wish, int(level))
        raise CalibError(no_candidate(tried // count, removed, where))
    return (
        np.concatenate([part.q for part in found]),
        np.concatenate([part.visible for part in found]),
    )


def at_level(cell: Cell, wish: Wish, level: int) -> str:
    """Words for one level, none without levels."""
    if wish.levels is None:
        return ""
    value, joint = wish.levels.values[level], wish.levels.joint
    slides = cell.robot.prismatic[joint]
    shown = f"{value * 1e3:g} mm" if slides else f"{np.degrees(value):g} deg"
    return f" at {cell.robot.joints[joint]} = {shown}"


def _angles(cell: Cell, wish: Wish, seed: int) -> Poses:
    """Poses from which angle-dependent effects take their knots: the levels, else the whole range."""
    probe = np.concatenate(list(drawn(cell, _PROBE, wish.levels, seed + 1)))
    ends = rounded(cell, cell.robot.sample_limits().T)
    if wish.levels is not None:
        ends[:, wish.levels.joint] = wish.levels.values[[0, -1]]
    return poses_at(np.concatenate([probe, ends]))


def _with_rivals(cell: Cell, rivals: tuple[str, str]) -> Cell:
    present = {
        (name, where) for name, places in map(parse_effect, cell.effects) for where in places or ()
    }
    everywhere = {name for name, places in map(parse_effect, cell.effects) if places is None}
    added = []
    for text in rivals:
        name, places = parse_effect(text)
        if places is None or len(places) != 1:
            raise CalibError(f"rival {text!r} needs one place, as in joint_compliance:A2")
        if name not in everywhere and (name, places[0]) not in present:
            added.append(text)
    return replace(cell, effects=(*cell.effects, *added))


def _rival_rows(model: Model, rivals: tuple[str, str]) -> tuple[IntArray, IntArray]:
    found = []
    for text in rivals:
        name, places = parse_effect(text)
        rows = [
            i
            for i, p in enumerate(model.parameters)
            if p.effect == name and p.where == (places or ("",))[0]
        ]
        if not rows:
            raise CannotIdentify(
                (text,),
                f"{text}: the rest of the model moves the markers alike; no pose tells it apart",
            )
        found.append(np.array(rows))
    return found[0], found[1]


def _silent(cell: Cell, rows: Array) -> bool:
    """Whether the free readings carry nothing; they are the first half of the rows."""
    return cell.load is not None and not rows[:, : rows.shape[1] // 2].any()


def _check_identifiable(cell: Cell, model: Model, rows: Array, wish: Wish) -> None:
    m, count, p = rows.shape
    extra = 0 if wish.fixed is None else len(wish.fixed)
    silent = _silent(cell, rows)
    equations = (wish.poses + extra) * (count // 2 if silent else count)
    if equations < p:
        least = -(-p // (count // 2 if silent else count)) - extra
        raise CalibError(
            f"{wish.poses} poses give {equations} equations for {p} parameters; "
            f"ask for at least {least} poses, or take effects out of [model] effects"
        )
    scaled = rows.reshape(-1, p) * np.sqrt((wish.poses + extra) / m)
    ids = tuple(parameter.id for parameter in model.parameters)
    found = identifiable(scaled, np.ones(p), ids)
    if found.unidentifiable:
        lost = [name for entry in found.unidentifiable for name in entry.names]
        reason = found.unidentifiable[0].reason
        raise CannotIdentify(
            tuple(lost),
            f"no plan determines {', '.join(lost)}: {reason}; {_help(cell, model, lost)}",
        )


def _help(cell: Cell, model: Model, lost: Sequence[str]) -> str:
    elastic = any("compliance" in name or "stiffness" in name for name in lost)
    out = "take it out of [model] effects"
    if not elastic:
        return f"{out}, free more joints, or add markers"
    loads = loads_of(
        model.robot, poses_at(np.zeros((1, cell.robot.dof))), cell.payload, cell.gravity
    )
    if cell.load is None and loads.absent:
        return f"{out}, or give a [load]"
    return f"{out}, or move the load off the joint's axis: [load] com_mm, a force across gravity"


def _check_targets(cell: Cell, targets: Poses) -> None:
    low, high = cell.robot.limits.T
    outside = (targets.q < low - _OUTSIDE) | (targets.q > high + _OUTSIDE)
    for i, j in np.argwhere(outside)[:1]:
        slides = cell.robot.prismatic[j]
        unit, name = (1e-3, "mm") if slides else (np.pi / 180.0, "deg")
        raise CalibError(
            f"target {targets.names[i]}: {cell.robot.joints[j]} at {targets.q[i, j] / unit:.2f} {name} "
            f"is outside its limits {low[j] / unit:.2f} .. {high[j] / unit:.2f}; move it inside"
        )


def _matches(model: Model, text: str) -> list[int]:
    name, _, where = text.partition(":")
    return [
        i
        for i, p in enumerate(model.parameters)
        if text == p.id or (p.effect == name and (not where or p.where == where))
    ]


def _subset(model: Model, wish: Wish) -> IntArray | None:
    if not wish.of or wish.criterion == "c":
        return None
    rows: list[int] = []
    for text in wish.of:
        rows += _known(model, text)
    return np.unique(rows)


def _direction(model: Model, wish: Wish) -> Array | None:
    """Factors of the combination, for parameters in their units."""
    if not wish.of or wish.criterion != "c":
        return None
    direction = np.zeros(len(model.parameters))
    for text in wish.of:
        name, _, factor = text.partition("=")
        try:
            number = float(factor or 1.0)
        except ValueError:
            raise CalibError(
                f"--of {text!r}: {factor!r} is not a number; write NAME=FACTOR"
            ) from None
        rows = _known(model, name)
        if len(rows) != 1:
            raise CalibError(
                f"--of {name!r} names {len(rows)} parameters; a combination takes single ones"
            )
        direction[rows[0]] = number
    return direction


def _known(model: Model, text: str) -> list[int]:
    rows = _matches(model, text)
    if not rows:
        known = ", ".join(p.id for p in model.parameters)
        raise CalibError(f"--of {text!r} is no parameter or effect of the model; there are {known}")
    return rows
