"""Variances that the readings show: of the instrument, of the arm at approaches and configurations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from calib import inference
from calib.scatter.poses import Variances

ScatterLevel: TypeAlias = Literal["approach", "configuration"]
_FEWEST = 10  # rows that see the instrument alone, from which on it can be told from the arm


@dataclass(frozen=True, eq=False)
class Undetected:
    """Scatter of an arm that the readings do not show, as far as they allow it.

    variances : Variances; freedom : float, degrees of freedom of what the arm adds, one at least
    """

    variances: Variances
    freedom: float


@dataclass(frozen=True, eq=False)
class VarianceEstimate:
    """Variance components of instrument, approaches and configurations.

    variances : Variances
    levels : at which the arm's scatter pays for itself; none where the readings do not show it
    scale_estimated : bool, whether the instrument's noise is not as its maker states it
    instrument_rows : int, that nothing but the instrument moves
    approaches : bool, whether configurations were approached again: then ``approach`` is the arm's
        repeatability, else that counts with ``configuration``
    mixed : the variances in the mixed model, where a later search begins
    undetected : scatter of the arm that does not show; None where it shows, or is stated
    """

    variances: Variances
    levels: tuple[ScatterLevel, ...]
    scale_estimated: bool
    instrument_rows: int
    approaches: bool
    mixed: inference.Variances
    undetected: Undetected | None = None

    @property
    def estimated(self) -> bool:
        """Whether the readings show anything but what was known beforehand."""
        return bool(self.levels) or self.scale_estimated

    @property
    def instrument_seen(self) -> bool:
        """Whether the data tell the instrument's noise from the arm's."""
        return self.instrument_rows >= _FEWEST

    @property
    def instrument_only(self) -> bool:
        """Whether the readings say that the instrument, and nothing else, errs more than it should."""
        return self.instrument_seen and self.scale_estimated and not self.levels
