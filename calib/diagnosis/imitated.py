"""What a free geometry found, and the size of a board alone would do as well.

Where boards alone give the scale, a board of another size reads as an arm of another size, so that a
free geometry takes it for its own and leaves nothing to be asked. But the sizes of all links then
differ by one share. With k geometry parameters free, one share in their place is preferred where it
costs less than Schwarz's price of the other k - 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.causes import NameEvidence
from calib.diagnosis.finding import Finding
from calib.diagnosis.stepwise import ALPHA
from calib.effects.board import BoardScale
from calib.effects.protocol import Constant


@dataclass(frozen=True, eq=False)
class Imitated:
    """A cause that the free geometry of the user's model has absorbed.

    members : tuple of (Candidate, float), it and how likely it is; value, std : SI
    p : probability of as much by chance
    """

    members: tuple[tuple[Candidate, float], ...]
    value: float
    std: float
    p: float

    @property
    def candidate(self) -> Candidate:
        """The most probable one."""
        return self.members[0][0]

    @property
    def where(self) -> str:
        """The place at which that acts."""
        return self.candidate.where


def imitated(finding: Finding) -> Iterator[Imitated]:
    """Boards whose size the geometry of the user's model stands for, the surest one."""
    from scipy.special import chdtrc

    view = finding.outcome.view
    fit = view.fit
    own = [i for e in fit.model.effects if isinstance(e, Constant) for i in fit.positions(e)]
    determined = [i for i in own if fit.span[i].any()]
    boards = [c for c in view.suspects if isinstance(c.effect, BoardScale)]
    if not boards or len(determined) < 2 or not fit.converged:
        return
    readings = replace(fit.linear, off=np.zeros(0))
    (r, J), whole = readings.independent, readings.complement
    rest = replace(readings, span=fit.span[:, ~np.any(fit.span[own], axis=0)]).complement
    without = rest.of(r + J[:, own] @ fit.values[own])
    left = float(whole.left @ whole.left)
    noise = max(left / max(fit.rows - whole.Q.shape[1], 1), 1.0)
    price = noise * float(np.log(max(fit.rows, 2)))
    shown = []
    for board in boards:
        column = rest.columns(view.rows(view.where[board.key]))[:, 0]
        if (length := float(column @ column)) > 0.0:
            shown.append((float(column @ without) ** 2 / length, board, column))
    if not shown:
        return
    fall, candidate, column = max(shown, key=lambda one: one[0])
    p = min(1.0, float(chdtrc(1, fall / noise)) * len(boards))
    alone = float(without @ without) - fall
    if fall < price or p > ALPHA or alone - left > (len(determined) - 1) * price:
        return
    length = float(column @ column)
    value, std = float(column @ without) / length, float(np.sqrt(noise / length))
    probability = NameEvidence(candidate.key, 1.0, 0.0, 1.0, False).probability
    yield Imitated(((candidate, probability),), value, std, p)
