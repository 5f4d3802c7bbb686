"""The uncertainty budget in words and as a table."""

from __future__ import annotations

from collections.abc import Iterator

from studies.document import (
    FOUR,
    MM,
    SHARE,
    STD,
    TEXT,
    WHOLE,
    Column,
    Detail,
    Part,
    Rule,
    Section,
    Sentence,
    Table,
    labelled,
    listed,
    mm,
)
from studies.identify.budget import BudgetEntry, Expanded, Row

_FATES = {
    "average": "lower it",
    "base": "go into the base",
    "stays": "do not help",
    None: "",
}
_FREEDOM = Rule(lambda value: WHOLE(value), absent="known")
_OWN = Rule(lambda value: STD(value), absent="")
_UNIT = Rule(str, absent="")
_SOURCE: Column[Row] = Column("source", lambda row: row.source)
_TYPE: Column[Row] = Column("type", lambda row: row.evaluation)
_ROWS: tuple[Column[Row], ...] = (
    _SOURCE,
    _TYPE,
    Column("u", lambda row: row.standard_uncertainty, _OWN),
    Column("unit", lambda row: row.unit, _UNIT),
    Column("targets", lambda row: row.at_targets_mm, MM, "mm"),
    Column("base measured\nagain", lambda row: row.base_placed_anew_mm, MM, "mm"),
    Column("degrees of\nfreedom", lambda row: row.degrees_of_freedom, _FREEDOM),
    Column("share", lambda row: row.share, SHARE),
    Column("more poses", lambda row: _FATES[row.poses], TEXT),
)
_EVALUATED: tuple[Column[Row], ...] = (
    _SOURCE,
    Column("of", lambda row: row.instrument),
    _TYPE,
    Column("distribution", lambda row: row.distribution),
    Column("stated", lambda row: row.stated, _OWN),
    Column("divisor", lambda row: row.divisor, FOUR),
    Column("unit", lambda row: row.unit, _UNIT),
    Column("sensitivity", lambda row: row.sensitivity_mm, _OWN, "mm/unit"),
    Column("one reading", lambda row: row.at_one_reading_mm, MM, "mm"),
)
_CAPTION = (
    "What one standard uncertainty of each source does to the points at the targets, RMS. Also "
    "with the base measured again there, as a user does who measures his own frame: what moves all "
    "targets together is gone then. Errors along one line are covered by Student's t times u, "
    "errors in space by less."
)


def budget_section(budget: BudgetEntry | None, targets: str, missing: bool) -> Iterator[Section]:
    """How sure a point at a target is; nothing for results of earlier versions.

    missing : whether the model surely lacks something
    """
    if budget is not None:
        title = "How sure is a point at a target?"
        yield Section("budget", title, tuple(_parts(budget, targets, missing)))


def _parts(budget: BudgetEntry, targets: str, missing: bool) -> Iterator[Part]:
    only = ", if the model lacks nothing" if missing else ""
    yield Sentence(
        f"errors up to {_covered(budget.calibration)}, from the parameters{only}", label="95 %"
    )
    if any(row.part_of != "calibration" for row in budget.rows):
        yield Sentence(f"errors up to {_covered(budget.total)}, with all sources below")
    yield Sentence(targets, label="targets")
    yield Table(_ROWS, budget.rows, "Uncertainty budget", _CAPTION)
    yield Detail((Table(_EVALUATED, budget.rows, "How each source was evaluated", fold=True),))
    common = [row for row in budget.rows if row.instrument]
    said = {
        fate: listed([row.source for row in common if row.poses == fate])
        for fate in ("average", "base", "stays")
    }
    words = {
        "average": "more poses average out",
        "base": "mostly a shift or turn of the whole frame",
        "stays": "more poses do not lower",
    }
    yield from labelled("common", (f"{words[k]}: {own}" for k, own in said.items() if own))
    if not common:
        yield Sentence(
            "errors that all readings share: none is stated. Those of a tracker (scale, zero point, "
            "circles, air) go into [instrument.common]",
            "note", "not counted",
        )  # fmt: skip


def _covered(found: Expanded) -> str:
    """Both figures with their factor, as a certificate gives them."""
    nu = found.degrees_of_freedom
    behind = "" if nu is None else f", {nu:.0f} degrees of freedom"
    return (
        f"{mm(found.expanded_mm)}, {mm(found.worst_expanded_mm)} at the worst target "
        f"(k = {found.coverage_factor:.2f}{behind})"
    )
