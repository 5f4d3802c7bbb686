"""What a diagnosis says: where the gap lies, what causes it, how far it shrinks, what to do next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

from studies import document as doc
from studies.diagnose.conclusion import headline, rest_words, rivals, standing_words, to_do
from studies.diagnose.pictures import error_curve, waterfall
from studies.diagnose.record import (
    CauseParameter,
    DiagnoseRecord,
    FoundCause,
    GapEntry,
    RefusedCause,
    SpectrumEntry,
    SpectrumLine,
)
from studies.document import Shown, labelled, listed, mm
from studies.entries import DetectionLimitEntry, not_asked
from studies.noise import noise_words
from studies.record import Outlier

_MOST_PARAMETERS = 8  # of one cause; sag of a whole arm has fifty
_MOST_OUTLIERS = 3  # that are worth a line each
_MOST_ALIASES = 4
_VAGUE = 1.0  # width of an interval of shares that says nothing
_LONG = 12  # letters of a place that is no longer named beside a number


def told(record: DiagnoseRecord) -> doc.Document:
    """The verdict, causes and places, the fall of the error, and what stayed unseen."""
    sections = (
        doc.Section("diagnosis", "What causes the unmodelled error", tuple(_parts(record))),
        doc.Section("unseen", "What could not be seen", tuple(_unseen(record))),
    )
    return doc.Document(tuple(headline(record)), tuple(s for s in sections if s.parts))


# -- causes and places -------------------------------------------------------------------------


def _parts(record: DiagnoseRecord) -> Iterator[doc.Part]:
    yield from labelled("remains", rest_words(record))
    yield from labelled("unseen", _could_hide(record))
    yield from labelled("noise", noise_words(record.noise))
    yield _errors(record.gap)
    for effect in record.effects:
        yield from _effect(effect)
    if record.steps is not None:
        yield doc.Figure(partial(waterfall, record.steps, record.gap.floor_mm))
    yield from (doc.Figure(partial(error_curve, curve)) for curve in record.curves)
    yield doc.Detail((doc.Table(_LINES, list(_lines(record)), "Spectrum lines of joints"),))
    yield doc.Table(_LOCATED, list(_located(record)), caption="Where the unmodelled error is")
    if record.possible:
        yield doc.Sentence("Fitted, and less likely than not to be the cause:")
        yield doc.Table(_POSSIBLE, list(_possible(record)), "Possible causes")
    if record.refused:
        yield doc.Sentence("Found, but not sure enough to be named:")
        yield doc.Table(_REFUSED, list(_refused(record.refused)), "Causes not named")
    yield doc.Table(_OUTLIERS, record.outliers, "Poses left out", most=_MOST_OUTLIERS)
    yield from _notes(record)


def _could_hide(record: DiagnoseRecord) -> Iterator[str]:
    """What would do most harm of all that would not have shown."""
    worst = record.worst_hidden
    if worst is None or record.verdict == "unknown":
        return
    left = f"at worst {mm(worst.left_mm)} RMS at the targets"
    if worst.minimum_detectable is None:
        yield f"these poses do not show {worst.key}: {left}"
    else:
        size = f"{doc.TWO(worst.minimum_detectable)} {worst.unit}"
        yield f"{worst.key} below {size} would go unnoticed: {left}"


_Errors: TypeAlias = tuple[str, float, float | None, float, str]
"""Of which poses; RMS before, after and of noise alone; what is said of the share that is gone."""


def _errors(gap: GapEntry) -> doc.Table[_Errors]:
    floor = gap.floor_mm
    rows: list[_Errors] = [("fitted poses", gap.fit_before_mm, gap.fit_after_mm, floor, "")]
    for label, before, after, closed in (
        ("held out", gap.heldout_before_mm, gap.heldout_after_mm, _closed(gap)),
        ("cross-validated", gap.crossvalidated_before_mm, gap.crossvalidated_after_mm, ""),
        ("cross-validated in time", gap.over_time_before_mm, gap.over_time_after_mm, ""),
    ):
        if before is not None:
            rows.append((label, before, after, floor, closed))
    figures = (Shown(title, doc.MM, gap.unit) for title in ("before", "after", "noise alone"))
    columns = doc.heads("RMS", *figures, "removed\n(95 % interval)")
    return doc.Table(columns, rows, "The error before and after")


def _closed(gap: GapEntry) -> str:
    if gap.closed is None:
        return "nothing to remove"
    if gap.closed_ci95 is None or gap.heldout_before_mm == gap.heldout_after_mm:
        return doc.SHARE(gap.closed)
    low, high = gap.closed_ci95
    if high - low > _VAGUE:
        return f"{doc.SHARE(gap.closed)} (too few poses)"
    return f"{doc.SHARE(gap.closed)} ({100.0 * low:.0f} to {100.0 * high:.0f})"


_VALUES = doc.columns(
    CauseParameter,
    "name",
    doc.Column("value", lambda row: (row.value, row.std), doc.TO_STD),
    doc.Column(
        "standard deviation", lambda row: (row.std, row.std) if row.std else None, doc.TO_STD
    ),
    "unit",
)


def _effect(effect: FoundCause) -> Iterator[doc.Part]:
    """A line for the cause, whose name may be long, and its parameters below it."""
    yield doc.Sentence(f"{effect.key}: {standing_words(effect)}")
    for other in effect.alike[1:]:
        yield doc.Sentence(f"or {other.key}, probability {doc.PROBABILITY(other.probability)}")
    known = [p for p in effect.parameters if p.std is not None]
    if len(known) > _MOST_PARAMETERS:
        known.sort(key=lambda p: -abs(p.value) / (p.std or 1e-300))
    yield doc.Table(_VALUES, known, f"Parameters of {effect.key}", most=_MOST_PARAMETERS)
    unknown = [p.name for p in effect.parameters if p.std is None]
    if unknown:
        yield doc.Sentence(f"not identified at these poses: {listed(unknown, 4)}")
    if effect.far_out:
        yield doc.Sentence(effect.far_out[:1].upper() + effect.far_out[1:], "warn")


_LOCATED = doc.heads(
    "where", "depends on", Shown("share of the\nunmodelled error", doc.SHARE), "cause"
)


def _located(record: DiagnoseRecord) -> Iterator[tuple[str, str, float | None, str]]:
    """Places, each with the cause that is named for it."""
    left = [*record.effects, *record.possible]
    for place in record.located:
        key = place.where, place.share_of_gap
        own = next((e for e in left if (e.where, e.share_of_gap) == key), None)
        if own is not None:
            left.remove(own)
        cause = "unknown" if own is None else own.effect
        yield place.where, place.depends_on, place.share_of_gap, cause


_POSSIBLE = doc.heads("cause", Shown("probability", doc.PROBABILITY))


def _possible(record: DiagnoseRecord) -> Iterator[tuple[str, float | None]]:
    """Each with how likely it, or one of its class, is."""
    for effect in record.possible:
        each = [one.probability for one in effect.alike or (effect,)]
        yield effect.names, sum(p for p in each if p is not None)


_REFUSED = doc.heads("cause", "why")


def _refused(entries: Sequence[RefusedCause]) -> Iterator[tuple[str, str]]:
    """Those of one reason and kind in one line."""
    groups: dict[tuple[str, str], list[str]] = {}
    for entry in entries:
        groups.setdefault((entry.effect, entry.reason), []).append(entry.where)
    for (kind, reason), where in groups.items():
        yield f"{kind}:{listed(list(dict.fromkeys(where)), 4)}", reason


_OUTLIERS = doc.columns(Outlier, "pose reason")


_LINES = doc.heads(
    "joint",
    Shown("cycles\nper turn", doc.FOUR),
    Shown("standard\ndeviation", doc.STD),
    Shown("amplitude", doc.STD, "urad"),
    "gear ratio",
    "or cycles",
)


def _lines(record: DiagnoseRecord) -> Iterator[tuple[Any, ...]]:
    for spectrum in record.spectra:
        for line in spectrum.lines:
            ratios = " or ".join(map(doc.TENTH, line.ratios))
            others = ", ".join(map(doc.TENTH, line.aliases))
            yield spectrum.joint, line.cycles, line.std, line.amplitude_urad, ratios, others


def _aliasing(spectra: Sequence[SpectrumEntry]) -> Iterator[str]:
    """What the poses cannot tell of a ripple's cycles: equal steps, and lines that might be others."""
    for spectrum in spectra:
        lines = [line for line in spectrum.lines if line.aliases]
        repeats = spectrum.repeats_1_turn
        if repeats is None and not lines:
            continue
        steps = f" in equal steps of {doc.STD(360.0 / repeats)} deg" if repeats else ""
        said = " and ".join(map(_might_be, lines)) or "gear ripples are hidden"
        yield f"{spectrum.joint}{steps}: {said}. Vary the steps"


def _might_be(line: SpectrumLine) -> str:
    named = [doc.TENTH(cycles) for cycles in line.aliases[:_MOST_ALIASES]]
    rest = len(line.aliases) - len(named)
    last = f"{rest} more" if rest else named.pop()
    others = f"{', '.join(named)} or {last}" if named else last
    return f"{doc.TENTH(line.cycles)} cycles per turn could also be {others}"


def _notes(record: DiagnoseRecord) -> Iterator[doc.Sentence]:
    """Where approaches come from, cycles that cannot be told, causes that have no columns."""
    if record.approach_derived:
        first = listed(record.not_fitted, 3)
        skipped = f"; {first} skipped: direction unknown" if first else ""
        yield doc.Sentence(f"derived from the order of the poses{skipped}", label="direction")
    yield from labelled("aliasing", _aliasing(record.spectra))
    yield from not_asked(record.not_asked)
    apart = ",".join(rivals(record)) if record.verdict == "ambiguous" else ""
    how = f"`posecal design CELL --extend DATA --poses 8 --discriminate {apart}`" if apart else ""
    yield from labelled("next", filter(None, [to_do(record), how]))


# -- what stayed unseen ------------------------------------------------------------------------


@dataclass(frozen=True)
class _Kind:
    """Causes of one kind whose sizes have one unit, the smallest first, and those never seen."""

    seen: list[DetectionLimitEntry]
    blind: list[str]

    def size(self, entry: DetectionLimitEntry) -> str:
        """Two digits, with the place where there is a choice of them."""
        choice = len(self.seen) + len(self.blind) > 1 and len(entry.where) <= _LONG
        return doc.TWO(entry.minimum_detectable) + f" ({entry.where})" * choice

    @property
    def worst(self) -> str:
        """The largest of several."""
        return self.size(self.seen[-1]) if len(self.seen) > 1 else ""


_KINDS: tuple[doc.Column[_Kind], ...] = (
    doc.Column("effect", lambda row: row.seen[0].effect),
    doc.Column("at best", lambda row: row.size(row.seen[0])),
    doc.Column("at worst", lambda row: row.worst),
    doc.Column("unit", lambda row: row.seen[0].unit),
    doc.Column("not visible at", lambda row: ", ".join(row.blind)),
)
_EACH = doc.columns(
    DetectionLimitEntry,
    "effect where",
    doc.Column(
        "smallest size", lambda row: row.minimum_detectable, doc.Rule(doc.FOUR.show, "not visible")
    ),
    "unit left_mm",
)


def _unseen(record: DiagnoseRecord) -> Iterator[doc.Part]:
    """The smallest sizes that would have been found, over the places, and what no pose shows."""
    entries = record.could_not_see
    groups: dict[tuple[str, str], list[DetectionLimitEntry]] = {}
    blind: dict[str, list[str]] = {}
    for entry in entries:
        if entry.minimum_detectable is None:
            blind.setdefault(entry.effect, []).append(entry.where)
        else:
            groups.setdefault((entry.effect, entry.unit), []).append(entry)
    if groups:
        yield doc.Sentence(
            "Detection limits: the smallest size of each cause that is found nine times in ten."
        )
    kinds = [
        _Kind(sorted(own, key=lambda e: e.minimum_detectable or 0.0), blind.get(effect, []))
        for (effect, _), own in groups.items()
    ]
    yield doc.Table(_KINDS, kinds, "Smallest sizes", fold=False)
    if entries:
        yield doc.Detail((doc.Table(_EACH, entries),), f"The same, place by place ({len(entries)})")
    nowhere = [effect for effect in blind if effect not in {effect for effect, _ in groups}]
    if nowhere:
        said = ", ".join(nowhere)
        yield doc.Sentence(f"These poses cannot show: {said}.")
