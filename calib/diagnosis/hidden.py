"""What a diagnosis could not have seen: how large each cause must be to be found."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.contest import Outcome
from calib.diagnosis.power import detectable
from calib.diagnosis.rounds import ALPHA

_NEVER = 1e3  # plausible sizes: what must be larger to be found is not visible


@dataclass(frozen=True)
class Hidden:
    """The size (SI) that an effect must have to be found; infinite where no size would do."""

    effect: str
    where: str
    smallest: float
    unit: str
    scale: float


def hidden(outcome: Outcome, entered: Collection[str]) -> tuple[Hidden, ...]:
    """What every cause that did not enter would have to be to be found, nine times in ten.

    entered : keys of those that did
    """
    found = []
    suspects = outcome.suspects
    for candidate in suspects:
        if not candidate.named or candidate.echo or candidate.key in entered:
            continue
        columns, parameters = outcome.view.where[candidate.key], candidate.amounts
        asked = len(suspects) * candidate.tried
        sizes = detectable(outcome.last, columns, asked, ALPHA).smallest.tolist()
        size, parameter = min(
            zip(sizes, parameters, strict=True), key=lambda pair: pair[0] / pair[1].size
        )
        effect = candidate.effect
        size = size if size < _NEVER * parameter.size else np.inf
        found.append(Hidden(effect.kind, effect.where, size, parameter.unit, parameter.scale))
    return tuple(found)
