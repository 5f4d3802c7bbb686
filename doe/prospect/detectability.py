"""What a plan can see of one cause: the size that is found, or why none is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.statics import loads_of
from calib.arrays import Array
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.detection_limit import Detectable, detectable
from calib.diagnosis.rounds import ALPHA
from calib.diagnosis.screen import field
from calib.effects.protocol import Effect, ElasticEffect, LoadEffect, Parameter
from doe.prospect.view import View

_STILL_M = 1e-10  # largest movement of the markers by what moves nothing


@dataclass(frozen=True, eq=False)
class Detectability(Detectable):
    """What a plan can see of one cause.

    moved : ndarray, shape (k,), m, RMS displacement of the markers by the smallest size
    reason : str, why it is hidden, empty if it is not
    """

    candidate: Candidate
    moved: Array
    reason: str

    @property
    def key(self) -> str:
        """``effect:where``."""
        return self.candidate.key

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Unknowns of the cause."""
        return self.candidate.amounts

    @property
    def sizes(self) -> Array:
        """Plausible sizes of the parameters, shape (k,), SI."""
        return np.array([p.size for p in self.parameters])

    @property
    def lead(self) -> int:
        """Position of the parameter whose smallest size is least beside what is plausible."""
        return int(np.argmin(self.smallest / self.sizes))


def detectability_of(view: View, position: int) -> Detectability:
    """What can be seen of one suspect."""
    candidate, columns = view.suspects[position], view.columns[position]
    seen = detectable(view.field, columns, view.asked * candidate.tried, ALPHA)
    moved, finite = np.full(len(columns), np.inf), np.isfinite(seen.smallest)
    moved[finite] = seen.smallest[finite] * view.moved[columns][finite]
    reason = "" if seen.directions else _why_hidden(view, position)
    return Detectability(**vars(seen), candidate=candidate, moved=moved, reason=reason)


def _why_hidden(view: View, position: int) -> str:
    """It moves nothing, or what the model has moves the markers alike."""
    effect, columns = view.suspects[position].effect, view.columns[position]
    sizes = np.array([p.size for p in view.suspects[position].amounts])
    if (view.moved[columns] * sizes).max() < _STILL_M:
        return _why_still(effect, view)
    kinds = _imitators(view, position)
    together = f"{', '.join(kinds[:-1])} and {kinds[-1]} together" if len(kinds) > 1 else kinds[0]
    return f"{together} {'move' if len(kinds) > 1 else 'moves'} the markers in the same way"


def _why_still(effect: Effect, view: View) -> str:
    if effect.uses:
        return f"{' and '.join(effect.uses)} never changes at these poses"
    model, poses = view.model, view.data.poses
    if isinstance(effect, LoadEffect) and not len(model.where(ElasticEffect)):
        return "nothing in the model is elastic"
    if not isinstance(effect, ElasticEffect | LoadEffect):
        return "it moves no marker at these poses"
    if loads_of(model.robot, poses, model.payload, model.gravity).absent:
        return "nothing loads the arm"
    elastic = isinstance(effect, ElasticEffect)
    return "no load acts on it at these poses" if elastic else "nothing elastic feels it"


def _imitators(view: View, position: int) -> list[str]:
    """Kinds of modelled effect without which the cause would be seen, else all."""
    own = [view.model.parameters[i].effect for i in view.kept]
    kinds, columns = list(dict.fromkeys(own)), view.columns[position]
    N, X = view.rows[:, view.kept], view.field.columns[:, columns]
    found = []
    for kind in kinds:
        others = N[:, [k != kind for k in own]]
        if field(others, X, np.zeros(len(X))).directions(np.arange(len(columns))).shape[1]:
            found.append(kind)
    return found or kinds
