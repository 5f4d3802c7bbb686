"""What a plan can see of one cause: the size that is found, or why none is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.statics import loads_of
from calib.arrays import Array
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.power import detection, entry_limit, needed_beyond
from calib.diagnosis.rounds import ALPHA
from calib.diagnosis.screen import VISIBLE, field
from calib.effects.protocol import Effect, ElasticEffect, LoadEffect, Parameter
from doe.foresight.view import View

_STILL_M = 1e-10  # largest movement of the markers by what moves nothing


@dataclass(frozen=True, eq=False)
class Sight:
    """What a plan can see of one cause.

    directions : int, in which it can be seen; none where it is hidden
    share : ndarray, shape (k,), of each parameter's signal that is left beside the model
    smallest : ndarray, shape (k,), SI, size of each alone that is found nine times in ten; infinite
        where no size would do
    moved : ndarray, shape (k,), m, RMS displacement of the markers by the smallest size
    limit, needed : float, score beyond which it is believed, and noncentrality that reaches it
    reason : str, why it is hidden, empty if it is not
    """

    candidate: Candidate
    directions: int
    share: Array
    smallest: Array
    moved: Array
    limit: float
    needed: float
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

    def found(self, times: Array) -> Array:
        """Probability that the cause is found at multiples of its smallest size, shape (k,)."""
        return detection(self.limit, self.directions, self.needed * np.asarray(times) ** 2)


def sight_of(view: View, position: int) -> Sight:
    """What can be seen of one suspect."""
    candidate, columns = view.suspects[position], view.columns[position]
    k = view.field.basis(columns).shape[1]
    lengths, whole = np.linalg.norm(view.field.X[:, columns], axis=0), view.field.lengths[columns]
    share = lengths / np.where(whole > 0.0, whole, 1.0)
    nowhere = np.full(len(columns), np.inf)
    in_view = share > VISIBLE
    if not k or not in_view.any():  # what is left of a combination alone is rounding
        reason = _why_hidden(view, position)
        return Sight(candidate, 0, share, nowhere, nowhere, np.inf, np.inf, reason)
    limit = entry_limit(k, view.field.rows, view.asked * candidate.tried, ALPHA)
    needed = needed_beyond(limit, k)
    smallest = np.divide(np.sqrt(needed), lengths, out=nowhere.copy(), where=in_view)
    moved = np.multiply(smallest, view.moved[columns], out=nowhere.copy(), where=in_view)
    return Sight(candidate, k, share, smallest, moved, limit, needed, "")


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
    columns, kinds = view.columns[position], list(dict.fromkeys(view.kinds))
    X, none, own = view.X[:, columns], np.zeros(len(view.X)), np.arange(len(columns))
    found = []
    for kind in kinds:
        others = view.N[:, [k != kind for k in view.kinds]]
        if field(others, X, none).basis(own).shape[1]:
            found.append(kind)
    return found or kinds
