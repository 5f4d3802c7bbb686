"""What a diagnosis says: where the gap lies, what causes it, how far it shrinks, what to do next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

from studies.causes import Sought, not_asked
from studies.diagnose.conclusion import headline, rest_words, standing_words, to_do
from studies.diagnose.error_curve import error_curve
from studies.diagnose.record import (
    DiagnoseRecord,
    FoundCause,
    GapEntry,
    LocatedPlace,
    NextPose,
    RefusedCause,
    RivalPrediction,
    SpectrumEntry,
    SpectrumLine,
    Value,
)
from studies.diagnose.spectra import spectra
from studies.diagnose.waterfall import waterfall
from studies.document import (
    FOUR,
    HUNDREDTH,
    MM,
    PROBABILITY,
    SHARE,
    STD,
    TENTH,
    TEXT,
    TO_STD,
    TWO,
    Column,
    Detail,
    Document,
    Figure,
    Part,
    Rule,
    Section,
    Sentence,
    Table,
    labelled,
    listed,
    mm,
)
from studies.joints import joint_columns
from studies.noise import noise_words
from studies.record import Outlier

_MOST_PARAMETERS = 8  # of one cause; sag of a whole arm has fifty
_MOST_OUTLIERS = 3  # that are worth a line each
_MOST_ALIASES = 4
_MOST_PAIRS = 6
_VAGUE = 1.0  # width of an interval of shares that says nothing
_LONG = 12  # letters of a place that is no longer named beside a number


def told(record: DiagnoseRecord) -> Document:
    """The verdict, causes and places, the fall of the error, what stayed unseen, and what next."""
    sections = (
        Section("diagnosis", "What causes the unmodelled error", tuple(_parts(record))),
        Section("unseen", "What could not be seen", tuple(_unseen(record))),
        Section("next", "What to measure next", tuple(_further(record))),
    )
    return Document(tuple(headline(record)), tuple(s for s in sections if s.parts))


# -- causes and places -------------------------------------------------------------------------


def _parts(record: DiagnoseRecord) -> Iterator[Part]:
    yield from labelled("remains", rest_words(record))
    yield from labelled("unseen", _could_hide(record))
    yield from labelled("noise", noise_words(record.noise))
    yield _errors(record.gap)
    for effect in record.effects:
        yield from _effect(effect)
    if record.steps is not None:
        yield Figure(partial(waterfall, record.steps, record.gap.floor_mm))
    yield from (Figure(partial(error_curve, curve)) for curve in record.curves)
    if record.spectra:
        yield Figure(partial(spectra, record.spectra))
    yield Table(_LOCATED, list(_located(record)), caption="Where the unmodelled error is")
    if record.refused:
        yield Sentence("Found, but not sure enough to be named:")
        yield Table(_REFUSED, list(_refused(record.refused)), "RefusedCause")
    yield Table(_OUTLIERS, record.outliers, "Poses left out", of_poses=True, most=_MOST_OUTLIERS)
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
        size = f"{TWO(worst.minimum_detectable)} {worst.unit}"
        yield f"{worst.key} below {size} would go unnoticed: {left}"


_Errors: TypeAlias = tuple[str, float, float | None, str]
"""Of which poses; RMS before and after; what is said of the share that is gone."""


def _errors(gap: GapEntry) -> Table[_Errors]:
    rows: list[_Errors] = [("fitted poses", gap.fit_before_mm, gap.fit_after_mm, "")]
    for label, before, after, closed in (
        ("held out", gap.heldout_before_mm, gap.heldout_after_mm, _closed(gap)),
        ("cross-validated", gap.crossvalidated_before_mm, gap.crossvalidated_after_mm, ""),
        ("cross-validated in time", gap.over_time_before_mm, gap.over_time_after_mm, ""),
    ):
        if before is not None:
            rows.append((label, before, after, closed))
    columns: tuple[Column[_Errors], ...] = (
        Column("RMS", lambda row: row[0]),
        Column("before", lambda row: row[1], MM, gap.unit),
        Column("after", lambda row: row[2], MM, gap.unit),
        Column("noise alone", lambda _: gap.floor_mm, MM, gap.unit),
        Column("removed\n(95 % interval)", lambda row: row[3]),
    )
    return Table(columns, rows, "The error before and after")


def _closed(gap: GapEntry) -> str:
    if gap.closed is None:
        return "nothing to remove"
    if gap.closed_ci95 is None or gap.heldout_before_mm == gap.heldout_after_mm:
        return SHARE(gap.closed)
    low, high = gap.closed_ci95
    if high - low > _VAGUE:
        return f"{SHARE(gap.closed)} (too few poses)"
    return f"{SHARE(gap.closed)} ({100.0 * low:.0f} to {100.0 * high:.0f})"


_VALUES: tuple[Column[Value], ...] = (
    Column("parameter", lambda row: row.name),
    Column("value", lambda row: (row.value, row.std), TO_STD),
    Column("standard deviation", lambda row: (row.std, row.std) if row.std else None, TO_STD),
    Column("unit", lambda row: row.unit, TEXT),
)


def _effect(effect: FoundCause) -> Iterator[Part]:
    """A line for the cause, whose name may be long, and its parameters below it."""
    yield Sentence(f"{effect.key}: {standing_words(effect)}")
    for other in effect.alike[1:]:
        yield Sentence(f"or {other.key}, probability {PROBABILITY(other.probability)}")
    known = [p for p in effect.parameters if p.std is not None]
    if len(known) > _MOST_PARAMETERS:
        known.sort(key=lambda p: -abs(p.value) / (p.std or 1e-300))
    yield Table(_VALUES, known, f"Parameters of {effect.key}", most=_MOST_PARAMETERS)
    unknown = [p.name for p in effect.parameters if p.std is None]
    if unknown:
        yield Sentence(f"not identified at these poses: {listed(unknown, 4)}")
    if effect.far_out:
        yield Sentence(effect.far_out[:1].upper() + effect.far_out[1:], "warn")


_LOCATED: tuple[Column[tuple[LocatedPlace, str]], ...] = (
    Column("where", lambda row: row[0].where),
    Column("depends on", lambda row: row[0].depends_on),
    Column("share of the\nunmodelled error", lambda row: row[0].share_of_gap, SHARE),
    Column("cause", lambda row: row[1]),
)


def _located(record: DiagnoseRecord) -> Iterator[tuple[LocatedPlace, str]]:
    """Places, each with the cause that is named for it."""
    left = list(record.effects)
    for place in record.located:
        key = place.where, place.share_of_gap
        own = next((e for e in left if (e.where, e.share_of_gap) == key), None)
        if own is not None:
            left.remove(own)
        yield place, "unknown" if own is None else own.effect


_REFUSED: tuple[Column[tuple[str, str]], ...] = (
    Column("cause", lambda row: row[0]),
    Column("why", lambda row: row[1]),
)


def _refused(entries: Sequence[RefusedCause]) -> Iterator[tuple[str, str]]:
    """Those of one reason and kind in one line."""
    groups: dict[tuple[str, str], list[str]] = {}
    for entry in entries:
        groups.setdefault((entry.effect, entry.reason), []).append(entry.where)
    for (kind, reason), where in groups.items():
        yield f"{kind}:{listed(list(dict.fromkeys(where)), 4)}", reason


_OUTLIERS: tuple[Column[Outlier], ...] = (
    Column("left out", lambda row: row.pose),
    Column("because", lambda row: row.reason),
)


def _aliasing(spectra: Sequence[SpectrumEntry]) -> Iterator[str]:
    """What the poses cannot tell of a ripple's cycles: equal steps, and lines that might be others."""
    for spectrum in spectra:
        lines = [line for line in spectrum.lines if line.aliases]
        repeats = spectrum.repeats_1_turn
        if repeats is None and not lines:
            continue
        steps = f" in equal steps of {STD(360.0 / repeats)} deg" if repeats else ""
        said = " and ".join(map(_might_be, lines)) or "gear ripples are hidden"
        yield f"{spectrum.joint}{steps}: {said}. Vary the steps"


def _might_be(line: SpectrumLine) -> str:
    named = [TENTH(cycles) for cycles in line.aliases[:_MOST_ALIASES]]
    rest = len(line.aliases) - len(named)
    last = f"{rest} more" if rest else named.pop()
    others = f"{', '.join(named)} or {last}" if named else last
    return f"{TENTH(line.cycles)} cycles per turn could also be {others}"


def _notes(record: DiagnoseRecord) -> Iterator[Sentence]:
    """Where approaches come from, cycles that cannot be told, causes that have no columns."""
    if record.approach_derived:
        first = listed(record.not_fitted, 3)
        skipped = f"; {first} skipped: direction unknown" if first else ""
        yield Sentence(f"derived from the order of the poses{skipped}", label="direction")
    yield from labelled("aliasing", _aliasing(record.spectra))
    yield from not_asked(record.not_asked)
    yield from labelled("next", filter(None, [to_do(record)]))


# -- what stayed unseen ------------------------------------------------------------------------


@dataclass(frozen=True)
class _Kind:
    """Causes of one kind whose sizes have one unit, the smallest first, and those never seen."""

    seen: list[Sought]
    blind: list[str]

    def size(self, entry: Sought) -> str:
        """Two digits, with the place where there is a choice of them."""
        choice = len(self.seen) + len(self.blind) > 1 and len(entry.where) <= _LONG
        return TWO(entry.minimum_detectable) + f" ({entry.where})" * choice

    @property
    def worst(self) -> str:
        """The largest of several."""
        return self.size(self.seen[-1]) if len(self.seen) > 1 else ""


_KINDS: tuple[Column[_Kind], ...] = (
    Column("effect", lambda row: row.seen[0].effect),
    Column("at best", lambda row: row.size(row.seen[0])),
    Column("at worst", lambda row: row.worst),
    Column("unit", lambda row: row.seen[0].unit),
    Column("not visible at", lambda row: ", ".join(row.blind)),
)
_EACH: tuple[Column[Sought], ...] = (
    Column("cause", lambda row: row.effect),
    Column("where", lambda row: row.where),
    Column("smallest size", lambda row: row.minimum_detectable, Rule(FOUR.show, "not visible")),
    Column("unit", lambda row: row.unit, TEXT),
    Column("leaves", lambda row: row.left_mm, MM, "mm"),
)


def _unseen(record: DiagnoseRecord) -> Iterator[Part]:
    """The smallest sizes that would have been found, over the places, and what no pose shows."""
    entries = record.could_not_see
    groups: dict[tuple[str, str], list[Sought]] = {}
    blind: dict[str, list[str]] = {}
    for entry in entries:
        if entry.minimum_detectable is None:
            blind.setdefault(entry.effect, []).append(entry.where)
        else:
            groups.setdefault((entry.effect, entry.unit), []).append(entry)
    if groups:
        yield Sentence(
            "Detection limits: the smallest size of each cause that is found nine times in ten."
        )
    kinds = [
        _Kind(sorted(own, key=lambda e: e.minimum_detectable or 0.0), blind.get(effect, []))
        for (effect, _), own in groups.items()
    ]
    yield Table(_KINDS, kinds, "Smallest sizes", fold=False)
    if entries:
        yield Detail((Table(_EACH, entries),), f"The same, place by place ({len(entries)})")
    nowhere = [effect for effect in blind if effect not in {effect for effect, _ in groups}]
    if nowhere:
        said = ", ".join(nowhere)
        yield Sentence(f"These poses cannot show: {said}.")


# -- what to measure next ----------------------------------------------------------------------

_DOUBTS: tuple[Column[RivalPrediction], ...] = (
    Column("cause", lambda row: row.rivals[0]),
    Column("or", lambda row: row.rivals[1]),
    Column("right choice\nnow", lambda row: row.probability_now, PROBABILITY),
    Column("after these\nposes", lambda row: row.probability_after, PROBABILITY),
)
_POSE: Column[NextPose] = Column("next\npose", lambda row: row.pose)
_SPLITS: Column[NextPose] = Column(
    "tells apart", lambda row: "; ".join(" from ".join(p) for p in row.splits), detail=True
)


def _further(record: DiagnoseRecord) -> Iterator[Part]:
    """Rivals with their prospects, the poses that split them, and what to do where none can."""
    doubts, poses = record.next_poses_predicted, record.next_poses
    if doubts:
        yield Table(
            _DOUBTS,
            doubts,
            "Causes that are not told apart, and how often the right one is chosen",
            most=_MOST_PAIRS,
        )
    for doubt in doubts[:_MOST_PAIRS]:
        yield from _remedies(doubt)
    if poses:
        yield Sentence("Measure these poses: they tell the causes apart.")
        columns: tuple[Column[NextPose], ...] = (
            _POSE,
            *joint_columns(poses, HUNDREDTH, detail=False),
            _SPLITS,
        )
        yield Table(columns, poses, "The next poses")
        if record.next_poses_assume:
            yield Sentence(f"Read {'; '.join(record.next_poses_assume)}.")


def _remedies(doubt: RivalPrediction) -> Iterator[Sentence]:
    pair = " or ".join(doubt.rivals)
    for remedy in doubt.interventions:
        yield Sentence(f"{pair}: {remedy.says} ({PROBABILITY(remedy.probability)})")
    if doubt.inseparable:
        yield Sentence(
            f"{pair}: observationally equivalent. No poses, loads or stations tell them apart; correct "
            "for either"
        )
