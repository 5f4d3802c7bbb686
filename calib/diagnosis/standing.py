"""How sure a cause is, and the verdict that follows from all of them and from what remains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from calib.diagnosis.named import Named
from calib.diagnosis.rest import Rest
from calib.diagnosis.shape import Doubt

VerdictName = Literal["no_gap", "explained", "ambiguous", "unknown"]
Standing = Literal["established", "likely", "one_of"]

_SURE = 0.9  # probability from which on a cause is taken for certain


def standing_of(named: Named, probability: float, doubt: Doubt, matters: bool) -> Standing:
    """How sure a cause is.

    probability : that it, or one of its class, is there
    matters : whether another form would differ where accuracy counts
    A cause is one of several where these data do not tell it from others; it is established where it
    is nearly certain, in the form of the catalogue.
    """
    if named.aliased or named.lead < _SURE:
        return "one_of"
    in_form = not doubt.stands and (doubt.tested or not matters)
    return "established" if in_form and probability * named.lead >= _SURE else "likely"


def verdict_of(standings: Sequence[Standing], rest: Rest) -> VerdictName:
    """The verdict of a diagnosis."""
    if not rest.closed:
        return "unknown"
    if not standings:
        return "no_gap"
    return "explained" if all(s == "established" for s in standings) else "ambiguous"
