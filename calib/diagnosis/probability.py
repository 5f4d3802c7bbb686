"""How likely it is that a name, or one of its class, is right: a frequency, not a p value.

A logistic model of what speaks against a name. It is fitted by maximum likelihood to some 600 names of
days whose errors follow other formulas than the catalogue's, or are in no catalogue at all
(``studies.research.benchmarks.conclusions``, parts foreign, outside and hard), and of sealed cases
(``studies.research.withheld``); ``posecal explain measured-conclusions`` has the count on fresh days.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log10

_LEAST_P = 1e-4  # of the test of its form, below which it is as doubtful as it gets
_LEAST_RATIO = 0.9  # of a curve's evidence over its own, from which on that speaks against a name
_NEARLY = 0.6, 0.9  # from which on, and in full, against what follows anything
_PLIABLE = ("stiffness_vs_angle",)
_MOMENTS = ("step", "warm_up")
_AT_REST = ("base", "instrument")  # whose moments and warm-ups nothing else imitates

_SURE = 3.24
_WEIGHTS = (
    0.25,  # a decade of the p value of its form
    -3.9,  # a curve at its place does as much again
    -11.7,  # never chosen again without a tenth of the poses
    -0.74,  # something else is found at its place
    -2.75,  # a compliance by angles follows what it likes, and a curve there nearly does as much
    -2.05,  # so does a moment, or a time constant, chosen at a joint or a marker
)


@dataclass(frozen=True)
class Evidence:
    """What speaks for and against a name.

    key : str, ``effect:where``; form_p : of the test of its form
    curve_ratio : evidence of the best curve at its place over its own
    again : share of the folds without which it is chosen again
    company : whether anything else is found at its place
    """

    key: str
    form_p: float
    curve_ratio: float
    again: float
    company: bool

    @property
    def probability(self) -> float:
        """That the name, or one of its class, is right."""
        log_odds = _SURE + sum(w * x for w, x in zip(_WEIGHTS, self.against, strict=True))
        return 1.0 / (1.0 + exp(-log_odds))

    @property
    def against(self) -> tuple[float, ...]:
        """What speaks against it, a number for each of the weights."""
        kind, where = self.key.split(":", 1)
        low, high = _NEARLY
        close = min(max((self.curve_ratio - low) / (high - low), 0.0), 1.0)
        nearly = max(close, float(self.company))
        return (
            log10(max(self.form_p, _LEAST_P)),
            min(max(self.curve_ratio - _LEAST_RATIO, 0.0), 1.0),
            1.0 - self.again,
            float(self.company),
            nearly * (kind in _PLIABLE),
            nearly * (kind in _MOMENTS and where not in _AT_REST),
        )
