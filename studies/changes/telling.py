"""What a comparison of two days says: did anything move, what does that do, what may be behind it."""

from __future__ import annotations

from collections.abc import Iterator

from studies import document as doc
from studies.changes.pictures import changed_parameters, errors_at_targets
from studies.changes.record import CauseExplanation, ChangedParameter, ChangesRecord, DifferenceTest
from studies.document import Shown, labelled, listed, mm, plural
from studies.entries import CauseEntry, gathered
from studies.record import IntervalEntry

_MOST = 12  # parameters that are worth a line each in the terminal
_LARGE = 3.0  # standard deviations of a parameter that one result alone has
_VERDICTS: dict[str, tuple[str, doc.Mood]] = {
    "holds": ("still holds", "good"),
    "does_not": ("does not hold", "warn"),
    "cannot_be_said": ("may or may not hold", "warn"),
}


def told(record: ChangesRecord) -> doc.Document:
    """The answer, the parameters, the causes and the targets."""
    return doc.Document(
        tuple(_headline(record)),
        (
            doc.Section("changes", "What moved", tuple(_moved(record))),
            doc.Section("changes-cause", "What may be behind it", tuple(_causes(record))),
            doc.Section("changes-targets", "What it does at the targets", tuple(_targets(record))),
        ),
    )


def _headline(record: ChangesRecord) -> Iterator[doc.Sentence]:
    change, chance = record.change_rms_mm, _chance(record.test)
    between = f"{record.before} and {record.after}"
    if record.status == "unchanged":
        yield doc.Sentence(f"Nothing moved between {between} ({chance}).", "good")
        yield doc.Sentence(_hidden(record))
    else:
        yield doc.Sentence(
            f"Something moved between {between} ({chance}): {_shown(change)} RMS.",
            "warn",
        )
        yield _cause(record)
    yield _tolerance(record)


def _hidden(record: ChangesRecord) -> str:
    """What the data leave room for, inside the model and outside of it."""
    inside = f"A change below {mm(record.change_rms_mm.high)} RMS at the targets would go unnoticed"
    if record.outside_mm is None:
        return f"{inside}; an effect outside the model may be larger."
    return f"{inside}; outside the model, {mm(record.outside_mm)} more."


def _chance(test: DifferenceTest) -> str:
    """How likely so large a difference is by chance."""
    return f"p = {doc.P(test.p)}" if test.p > 1e-300 else "p below 1e-300"


def _shown(error: IntervalEntry) -> str:
    return f"{doc.MM(error.value)} mm ({doc.MM(error.low)} to {doc.MM(error.high)})"


def _cause(record: ChangesRecord) -> doc.Sentence:
    if record.cause == "unclear":
        first = next(iter(sorted(record.causes, key=lambda cause: -cause.share)), None)
        most = f"; {first.key} explains most of it, {doc.SHARE(first.share)}" if first else ""
        return doc.Sentence(f"No single cause explains it{most}.", "warn")
    first = record.causes[0]
    said = f"{words(first)} ({first.key}, probability {doc.PROBABILITY(first.probability)})"
    lead = "Most likely" if record.cause == "named" else "Several causes fit. The most likely"
    return doc.Sentence(f"{lead}: {said}.", "note")


def words(cause: CauseEntry) -> str:
    """What happened, in words.

    >>> words(CauseEntry(effect="joint_offset", where="A3"))
    'the zero of A3 slipped'
    """
    from calib.effects import catalogue

    if cause.effect == "marker":
        return f"marker {cause.where} was moved"
    kind = catalogue().get(cause.effect)
    event = kind.event if kind else ""
    return (event or f"{cause.effect} of {{}} changed").format(cause.where)


def _tolerance(record: ChangesRecord) -> doc.Sentence:
    worst = f"worst target {_shown(record.kept_worst_mm)}"
    if record.verdict is None:
        return doc.Sentence(f"Error today with {record.before}: {worst}.")
    verdict, mood = _VERDICTS[record.verdict]
    said = f"{record.before} {verdict} within {record.tolerance_mm:g} mm: {worst}."
    return doc.Sentence(said, mood)


# -- what moved --------------------------------------------------------------------------------


_PARAMETERS = doc.columns(
    ChangedParameter,
    "id",
    doc.Column("after -\nbefore", lambda p: (p.change, p.std) if p.std else None, doc.TO_STD),
    "std unit family_p",
    doc.Column("moved", lambda p: "yes" if p.moved else "", doc.TEXT),
)


def _moved(record: ChangesRecord) -> Iterator[doc.Part]:
    rows = sorted(record.parameters, key=lambda p: 2.0 if p.family_p is None else p.family_p)
    yield from _compared(record)
    yield doc.Table(_PARAMETERS, rows, "Parameters, after minus before", most=_MOST)
    yield doc.Figure(lambda: changed_parameters(record))


def _compared(record: ChangesRecord) -> Iterator[doc.Sentence]:
    """What was tested, what of it surely moved, and what takes no part and why."""
    tested = plural(record.test.rows, "combination")
    yield doc.Sentence(f"{tested} of the parameters, together", label="compared")
    moved = [p.id for p in record.parameters if p.moved]
    if moved:
        yield doc.Sentence(listed(moved), label="moved")
    elsewhere = [name.partition(":")[2] for name in record.apart if name.startswith("base:")]
    markers = [name.rpartition(":")[2] for name in record.apart if name.startswith("tool:")]
    compared = {p.effect for p in record.parameters}
    if elsewhere or "base" not in compared:
        yield doc.Sentence(
            "the instrument stood elsewhere: that looks like a knock of the robot's base",
            label="not compared",
        )
    if markers or "tool" not in compared:
        what = listed(markers) if markers else "markers"
        yield doc.Sentence(f"{what}: other names or places, so another tool, or mounted again",
                       label="" if elsewhere else "not compared")  # fmt: skip
    if record.left.grown:
        yield doc.Sentence(
            f"the fit of {record.after} leaves {mm(record.left.after_mm)} RMS, that of {record.before} "
            f"{mm(record.left.before_mm)}. If instrument and poses are alike, the model lacks "
            "something new. Run `posecal diagnose`",
            "warn",
            "model",
        )
    elif record.left.excess_mm:
        yield doc.Sentence(
            f"both fits leave {mm(record.left.excess_mm)} beyond the instrument's noise: the "
            "arm's repeatability, or errors of both days. Neither is a change",
            label="model",
        )
    open_ = [p.id for p in record.parameters if p.std is None]
    if open_:
        yield doc.Sentence(f"not determined on both days: {listed(open_)}", label="open")
    for alone in record.alone:
        mood: doc.Mood = "warn" if alone.sigmas > _LARGE else ""
        yield doc.Sentence(
            f"{alone.id} is in one result only ({alone.sigmas:.1f} standard deviations from zero). "
            "Identify both days with the same [model]",
            mood,
        )


# -- causes ------------------------------------------------------------------------------------


_CAUSES = doc.columns(
    CauseExplanation,
    "key probability share p_left",
    doc.Column("what happened", words, doc.TEXT, detail=True),
)


_SIZES = doc.heads(
    "likeliest",
    "size",
    Shown("value", doc.TO_STD),
    Shown("standard\ndeviation", doc.STD),
    "unit",
)


def _causes(record: ChangesRecord) -> Iterator[doc.Part]:
    if record.causes:
        caption = (
            "Each alone, by its marginal likelihood; what leaves more than noise explains nothing"
        )
        yield doc.Table(_CAUSES, record.causes, "Causes", caption, most=4)
    if record.cause in ("named", "ambiguous"):
        first = record.causes[0]
        rows = [
            (first.key, own.name, None if None in (own.value, own.std) else (own.value, own.std),
             own.std, own.unit)
            for own in first.sizes
        ]  # fmt: skip
        yield doc.Table(_SIZES, rows, "Its size")
        likely = [cause for cause in record.causes[1:] if cause.likely]
        yield from labelled("also", [f"{words(cause)} ({cause.key})" for cause in likely])
        same = [f"{words(cause)} ({cause.key})" for cause in record.same_as]
        yield from labelled("looks the same", same)
    if record.hidden:
        said = f"{gathered(record.hidden)}: of plausible size, these would not show here"
        yield doc.Detail((doc.Sentence(said, label="hidden"),))


# -- targets -----------------------------------------------------------------------------------


_TARGETS = doc.heads(
    "error at the targets",
    *("RMS [mm]", "from [mm]", "to [mm]"),
    *("worst [mm]", "from [mm]", "to [mm]"),
)


def _targets(record: ChangesRecord) -> Iterator[doc.Part]:
    rows = [
        (label, rms.value, rms.low, rms.high, worst.value, worst.low, worst.high)
        for label, rms, worst in (
            ("change of the robot", record.change_rms_mm, record.change_worst_mm),
            (f"error today with {record.before}", record.kept_rms_mm, record.kept_worst_mm),
        )
    ]
    today = (f"error today with {record.after}", record.renewed_rms_mm, *[None] * 5)
    caption = (
        f"With 95 % intervals, at {record.targets}. {mm(record.rest_mm)} of the error does not "
        f"come from the parameters. The worst target is {record.worst_at}"
    )
    yield doc.Table(_TARGETS, [*rows, today], "Errors at the targets", caption)
    yield doc.Figure(lambda: errors_at_targets(record), highlight=False)
