"""What is systematic, in words: what the model lacks, and a trend of the day that goes on."""

from __future__ import annotations

from studies.document import mm

_COUNTS = 0.5  # of what is expected: less hides beside the rest


def counts(lacking_mm: float, expected_mm: float | None) -> bool:
    """Whether what the model lacks is worth a sentence."""
    return lacking_mm > _COUNTS * (expected_mm or 0.0)


def lacks(lacking_mm: float) -> str:
    """That the model errs systematically, and what to do; follows a colon."""
    return f"the model has a systematic error of {mm(lacking_mm)}. Run `posecal diagnose`"


def undecided(scatter_mm: float) -> str:
    """That arm and model are not told apart, and what to do."""
    return (
        f"{mm(scatter_mm)} from pose to pose come from the arm, or from what the model lacks. "
        "Visit some poses again to know, or run `posecal diagnose`"
    )


def moves_on(by_then_mm: float, an_hour_later_mm: float | None, after_h: float | None) -> str:
    """That the readings moved through the day, for when the figures hold, and what to do.

    an_hour_later_mm : None where the readings have no time; after_h : None where nobody said it
    """
    if an_hour_later_mm is None:
        return (
            f"The readings drift by {mm(by_then_mm)} until the end: the error holds for that time. Add "
            "time_s, and [design] targets_after_h"
        )
    if after_h is None:
        return (
            f"The readings drift, by {mm(by_then_mm)} at the end of the day and "
            f"{mm(an_hour_later_mm)} an hour later: the error holds for the end. Set [design] "
            "targets_after_h, or run `posecal diagnose`"
        )
    return (
        f"The readings drift: by {mm(by_then_mm)}, {after_h:g} h after the last one. Run `posecal "
        "diagnose`, or measure when all is warm"
    )
