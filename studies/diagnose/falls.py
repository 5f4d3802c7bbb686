"""The error after each effect that a diagnosis found, added one to the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array
from calib.diagnosis import Diagnosis
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.gap import rms, squared_errors


@dataclass(frozen=True, eq=False)
class Falls:
    """How the error falls.

    added : tuple of Candidate, the n effects in the order of their share
    rms : ndarray, shape (n + 1,), m, before and after each
    heldout : bool, whether on poses that took no part
    """

    added: tuple[Candidate, ...]
    rms: Array
    heldout: bool


def falls(result: Diagnosis) -> Falls:
    """Fit the model again with one more effect each time; by share, the largest first."""
    stage = result.stage
    data = stage.data.take(~stage.dropped) if result.heldout is None else result.heldout
    added = by_share(result)
    fits = [result.before]
    fits += [result.linear.fit([c.effect for c in added[:n]]) for n in range(1, len(added))]
    fits += [result.after] if added else []
    errors = np.array([rms(squared_errors(fit, data)) for fit in fits])
    return Falls(tuple(added), errors, result.heldout is not None)


def by_share(result: Diagnosis) -> list[Candidate]:
    """Causes and places without a name, those of the largest share of the gap first."""
    found = [(cause.share, cause.named.candidate) for cause in result.causes]
    shares = {(place.where, place.depends_on): place.share for place in result.located}
    for entry in result.outcome.entries:
        own = entry.candidate
        if not own.named:
            found.append((shares.get((own.where, own.depends_on), np.nan), own))
    return [own for _, own in sorted(found, key=lambda pair: -np.nan_to_num(pair[0], nan=-np.inf))]
