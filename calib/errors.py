"""What can go wrong, one class a fact. Every text says what, where, and what to do."""

from __future__ import annotations

from pathlib import Path


class CalibError(Exception):
    """Root of all errors that a user can mend; its text is one line."""


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
