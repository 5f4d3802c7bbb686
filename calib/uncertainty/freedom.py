"""Degrees of freedom behind what an identification says: one rule for all who ask."""

from __future__ import annotations

WHOLE = 6
"""Numbers that the readings of one stay give of a pose that errs as a whole."""


def freedom(
    noise: float, stays: int, rank: float, *, as_a_whole: bool, numbers: int = WHOLE
) -> float:
    """Degrees of freedom behind a covariance, one at least.

    noise : of the noise level, infinite where it is known
    stays : how often the arm came to a pose whose readings count; rank : parameters that were fitted
    as_a_whole : whether poses err as a whole by what these readings show: then stays count, not points,
        less those that the parameters took up. A stay counts as one whatever it gives, as which
        variances there are is chosen by the same readings
    numbers : that a parameter may be taken from at one stay; fewer are more cautious

    >>> freedom(120.0, 25, 30, as_a_whole=False), freedom(120.0, 25, 30, as_a_whole=True)
    (120.0, 20.0)
    """
    return max(1.0, stays - rank / numbers if as_a_whole else float(noise))
