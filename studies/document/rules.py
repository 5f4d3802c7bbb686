"""How values become text: every rule of rounding that a result is told by stands here, once."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

_MOST_NAMES = 8
_MOST_DIGITS = 12
LINE = 100
"""Letters of a line of sentences."""


@dataclass(frozen=True)
class Rule:
    """A value as text.

    show : value -> text; absent : what stands for None; number : whether columns of it stand right
    """

    show: Callable[[Any], str]
    absent: str = "-"
    number: bool = True

    def __call__(self, value: Any) -> str:
        """The value by the rule.

        >>> MM(0.01234), MM(None), FOUR(1234.56), STD(0.082812), PERCENT(0.1234)
        ('0.0123', '-', '1235', '0.0828', '12.3')
        """
        return self.absent if value is None else self.show(value)


def fixed(digits: int) -> Rule:
    """So many digits after the point."""
    return Rule(lambda value: f"{value:.{digits}f}")


def listed(names: Sequence[str], most: int = _MOST_NAMES) -> str:
    """Names with commas, the first few of many.

    >>> listed(["a", "b"]), listed(list("abcdefghij"), 3)
    ('a, b', 'a, b, c and 7 more')
    """
    if len(names) <= most:
        return ", ".join(names)
    return f"{', '.join(names[:most])} and {len(names) - most} more"


def fitting(forms: Iterable[str], width: int = LINE) -> str:
    """The first form that a line holds, else the last.

    >>> fitting(["a sentence", "short"], 5), fitting(["never", "fits"], 3)
    ('short', 'fits')
    """
    form = ""
    for form in forms:
        if len(form) <= width:
            break
    return form


def to_std(*values: float | None) -> str:
    """Values to two digits of the standard deviation, which stands last, joined by "to".

    >>> to_std(1.23456, 0.0123), to_std(1.2, 3.4, 0.5), to_std(1234.5678, None)
    ('1.235', '1.20 to 3.40', '1234.568')
    """
    *shown, std = values
    digits = 1 - math.floor(math.log10(std)) if std and std > 0.0 else 3
    return " to ".join(f"{value:.{min(max(digits, 0), _MOST_DIGITS)}f}" for value in shown)


TEXT = Rule(str, absent="", number=False)
COUNT = Rule(lambda value: f"{value:d}" if value else "", absent="")
NAMES = Rule(lambda names: listed(names, 2), absent="", number=False)
MM = fixed(4)
MRAD = fixed(3)
JOINT = fixed(4)
HUNDREDTH = fixed(2)
FOUR = Rule(lambda value: f"{value:.4g}")
PROVED = Rule(lambda share: f"{math.floor(share * 1e4) / 1e2:.2f} %")
"""Never rounded up."""
PERCENT = Rule(lambda share: f"{100.0 * share:.1f}")
SHARE = Rule(lambda share: f"{100.0 * share:.0f} %")
PROBABILITY = fixed(2)
STD = Rule(lambda value: f"{value:.3g}", absent="open")
TO_STD = Rule(lambda values: to_std(*values), absent="not estimated")
TENTH = fixed(1)
TWO = Rule(lambda value: f"{float(f'{value:.1e}'):g}")
HOURS = fixed(2)
WHOLE = fixed(0)
P = Rule(lambda value: f"{value:.2g}")
CORRELATION = Rule(lambda value: f"{value:+.3f}")
THREE = Rule(lambda values: " ".join(f"{value:6.1f}" for value in values))


def mm(value: float | None) -> str:
    """A length in a sentence.

    >>> mm(0.01234), mm(None)
    ('0.0123 mm', 'open')
    """
    return "open" if value is None else f"{MM(value)} mm"


def plural(count: int, what: str) -> str:
    """A number of things.

    >>> plural(1, "pose"), plural(3, "pose")
    ('1 pose', '3 poses')
    """
    return f"{count} {what}{'s' * (count != 1)}"
