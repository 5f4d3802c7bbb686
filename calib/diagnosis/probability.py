"""How likely it is that a name, or one of its class, is right: a frequency, not a p value.

A logistic model of what speaks against a name. It is fitted by maximum likelihood to some 600 names of
days whose errors follow other formulas than the catalogue's, or are in no catalogue at all
(``studies.research.benchmarks.conclusions``, parts foreign, outside and hard), and of sealed cases
(``studies.research.withheld``); ``posecal explain measured-conclusions`` has the count on fresh days.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log10

from calib.effects import Effect
from calib.effects.timed import Timed

_LEAST_P = 1e-4  # of the test of its form, below which it is as doubtful as it gets
_BEST = 0.9, 1.9  # evidence of a curve over that of the name, from nothing speaks against it to all
_AT_REST = ("base", "instrument")  # whose moments and warm-ups nothing else imitates

_SURE = 3.1
_FORM = 0.3  # a decade of the p value of its form
_CURVE = -4.6  # a curve at its place does as much again
_AGAIN = -10.5  # never chosen again without a tenth of the poses
_COMPANY = -0.9  # something else is found at its place
_PLIABLE = -2.8  # a compliance by angles follows what it likes
_MOMENT = -2.0  # so does a moment, or a time constant, chosen at a joint or a marker


@dataclass(frozen=True)
class Evidence:
    """What speaks for and against a name.

    form_p : of the test of its form; curve_ratio : evidence of the best curve at its place over its own
    again : share of the folds without which it is chosen again
    company : whether anything else is found at its place
    """

    effect: Effect
    form_p: float
    curve_ratio: float
    again: float
    company: bool

    @property
    def probability(self) -> float:
        """That the name, or one of its class, is right."""
        low, high = _BEST
        momentary = isinstance(self.effect, Timed) and self.effect.where not in _AT_REST
        against = (
            _FORM * log10(max(self.form_p, _LEAST_P))
            + _CURVE * min(max((self.curve_ratio - low) / (high - low), 0.0), 1.0)
            + _AGAIN * (1.0 - self.again)
            + _COMPANY * self.company
            + _PLIABLE * (self.effect.kind == "stiffness_vs_angle")
            + _MOMENT * momentary
        )
        return 1.0 / (1.0 + exp(-(_SURE + against)))
