"""What is believed of what a search found, and the noise that it leaves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.diagnosis.contest import Outcome
from calib.diagnosis.gap import Gap, gap_of
from calib.diagnosis.named import Named
from calib.diagnosis.refused import Refused, believed
from calib.diagnosis.searched import Searched
from calib.diagnosis.sparing import sparing
from calib.diagnosis.stage import Fit, Stage
from calib.identification.noise_level import NoiseLevel, noise_level, of_levels
from calib.noise import counted
from calib.poses import Measurements


@dataclass(frozen=True, eq=False)
class Finding:
    """What is believed of what a search found.

    before, after : Fit, exact, of the user's model and with all that is believed
    """

    search: Searched
    outcome: Outcome
    named: tuple[Named, ...]
    before: Fit
    after: Fit
    refused: tuple[Refused, ...]

    @cached_property
    def noise(self) -> NoiseLevel:
        """What the readings err by beside all that is believed."""
        return _noise(self.search.stage, self.after, self.search.factor)

    @property
    def counted(self) -> Measurements:
        """The readings that were fitted."""
        return self.search.stage.data.take(~self.search.stage.dropped)

    @property
    def floor(self) -> float:
        """3-D root mean square of the noise alone, m per point."""
        channels = self.search.stage.model.readout.channels
        return float(np.sqrt(channels.numbers_each(self.counted.seen))) * self.noise.sigma

    @property
    def scale(self) -> float:
        """Actual over the standard deviation that the stage weighs by."""
        if self.noise.source == "cell" or self.after.mixing is not None:
            return 1.0
        return self.noise.factor / self.search.factor

    def gap(self, heldout: Measurements | None, by_time: bool = False) -> Gap:
        """How far the error shrinks."""
        return gap_of(self.before, self.after, self.counted, heldout, self.floor, by_time)


def finding_of(search: Searched) -> Finding:
    """What of it deserves its name, fitted in full."""
    stage, linear = search.stage, search.linear

    def exact(fit: Fit) -> Fit:
        return stage.exact(sparing(linear, fit))

    outcome, named, after, refused = believed(linear, search.outcome, exact)
    return Finding(search, outcome, named, stage.exact(outcome.before), after, refused)


def _noise(stage: Stage, fit: Fit, factor: float) -> NoiseLevel:
    """Noise from the residual of the final model, the stated one or the repeats' where they agree."""
    kept = ~stage.dropped
    cost = float((fit.r**2).sum())
    weights = stage.weights[kept] * factor
    dof = int(counted(weights).sum()) - fit.spent
    lengths = stage.model.readout.channels.lengths
    alone = noise_level(cost * factor**2, dof, stage.data.take(kept), weights, lengths)
    if alone.source == "residual" and fit.levels is not None and fit.levels.instrument_only:
        # What the markers of one reading say of each other repeats in every reading.
        return replace(alone, source="replicates")
    if fit.mixing is None or fit.levels is None:
        return alone
    found = of_levels(fit.levels, alone)
    return replace(found, factor=found.factor * factor)
