"""What can go wrong, one class a fact. Every text says what, where, and what to do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

_LONGEST = 1000  # characters of a text


def plain_line(text: str) -> str:
    r"""The text as one line that any terminal can show.

    What cannot be printed stands as its escape: a name from a hostile file must not move the cursor or
    turn the reading direction. What is too long loses its middle.

    >>> plain_line("pose\x1b[31m\n")
    'pose\\x1b[31m\\n'
    """
    if not text.isprintable():
        text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    if len(text) > _LONGEST:
        text = f"{text[: _LONGEST // 2]} .. {text[-_LONGEST // 2 :]}"
    return text


class CalibError(Exception):
    """Root of all errors that a user can mend; its text is one plain line."""

    def __init__(self, text: str = "") -> None:
        super().__init__(plain_line(text))

    def __reduce__(self) -> tuple[Any, ...]:
        """Errors come whole from another process, whatever their own arguments are."""
        return _again, (type(self), self.args, self.__dict__)


def _again(kind: type[CalibError], args: tuple[str, ...], facts: dict[str, Any]) -> CalibError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(facts)
    return error


class InputError(CalibError):
    """A file, or a line or key of it, cannot be used."""

    def __init__(self, file: str | Path, where: str, what: str, remedy: str = "") -> None:
        self.file, self.where, self.what, self.remedy = str(file), where, what, remedy
        place = f"{file}: {where}" if where else str(file)
        super().__init__(f"{place}: {what}" + (f"; {remedy}" if remedy else ""))


class UnknownEffect(CalibError):
    """An effect, or the place where it should act, is not known."""


class EffectCannotAct(CalibError):
    """An effect moves nothing in the data or plan at hand."""

    def __init__(self, effect: str, reason: str, remedy: str) -> None:
        self.effect, self.reason, self.remedy = effect, reason, remedy
        super().__init__(f"{effect} cannot act: {reason}; {remedy}")


class TooFewPoses(CalibError):
    """Fewer equations than parameters."""

    def __init__(self, found: int, needed: int, parameters: int, equations: int) -> None:
        self.found, self.needed = found, needed
        super().__init__(
            f"too few poses: {equations} equations from {found} poses for {parameters} parameters; "
            f"measure at least {needed} poses, or take effects out of [model] effects"
        )


class ImplausibleData(CalibError):
    """A known mistake explains the data, and no arm that errs as arms do.

    mistakes : tuple of str, several where the data do not tell; nominal, mended : float, m, by which
        the nominal arm misses the points; poses : tuple of str, where only these are concerned
    """

    def __init__(
        self,
        text: str,
        mistakes: tuple[str, ...],
        nominal: float,
        mended: float,
        poses: tuple[str, ...] = (),
    ) -> None:
        self.mistakes, self.nominal, self.mended, self.poses = mistakes, nominal, mended, poses
        super().__init__(text)


class Unsolvable(CalibError):
    """The equations have no solution in numbers."""

    def __init__(self) -> None:
        super().__init__(
            "the equations cannot be solved: the numbers are far from those of a robot; check the "
            "units of joints, points, loads and the URDF"
        )


class NoEquilibrium(CalibError):
    """The arm is too soft to stand."""

    def __init__(self, where: str = "") -> None:
        super().__init__(f"the arm finds no equilibrium{where}: its compliances are far too large")
