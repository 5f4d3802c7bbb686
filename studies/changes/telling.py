"""What a comparison of two days says: did anything move, what does that do, what may be behind it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from studies import document as doc
from studies.changes.record import CauseExplanation, ChangedParameter, ChangesRecord
from studies.document import Shown, labelled, listed, mm, plural
from studies.entries import CauseEntry, gathered
from studies.plots import style
from studies.plots.errors import before_and_after
from studies.record import IntervalEntry, intervals

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
    change, p = record.change_rms_mm, record.test.p
    chance = f"p = {doc.P(p)}" if p > 1e-300 else "p below 1e-300"
    between = f"{record.before} and {record.after}"
    if record.status == "unchanged":
        yield doc.Sentence(f"Nothing moved between {between} ({chance}).", "good")
        room = f"A change below {mm(change.high)} RMS at the targets would go unnoticed"
        beyond = "an effect outside the model may be larger"
        if record.outside_mm is not None:
            beyond = f"outside the model, {mm(record.outside_mm)} more"
        yield doc.Sentence(f"{room}; {beyond}.")
    else:
        yield doc.Sentence(
            f"Something moved between {between} ({chance}): {_shown(change)} RMS.",
            "warn",
        )
        yield _cause(record)
    yield _tolerance(record)


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
    yield doc.Figure(lambda: errors_at_targets(record))


_NARROWEST = 3.0  # standard deviations to either side
_MOVED = style.Look("the robot itself moved", style.BLUE, "o", "", "", "●")
_TOLERANCE = style.Look("tolerance", style.INK, "", "-.", "", "")
_LINEAR = 5.0  # standard deviations; beyond, the scale is logarithmic


@style.styled
def changed_parameters(record: ChangesRecord) -> style.Picture:
    """Each difference in its standard deviations, those that surely moved apart."""
    known = [p for p in record.parameters if p.std]
    ratio = np.array([p.change / p.std for p in known if p.std])
    at, moved = np.arange(len(known)), np.array([p.moved for p in known], dtype=bool)
    figure = style.sheet(style.PANEL, max(2.4, 1.2 + 0.19 * len(known)))
    panel = figure.subplots()
    style.tidy(panel, "x")
    band = panel.axvspan(-2.0, 2.0, color=style.FAINT, linewidth=0, zorder=0)
    band.set_label("two standard deviations")
    panel.axvline(0.0, color=style.SOFT, linewidth=0.8)
    handles: list[Any] = []
    for chosen, color, mark, label in (
        (~moved, style.BLUE, "o", "not moved for sure"), (moved, style.VERMILLION, "^", "moved")
    ):  # fmt: skip
        if chosen.any():
            handles += panel.plot(ratio[chosen], at[chosen], color=color, marker=mark, linestyle="",
                                  label=label)  # fmt: skip
    handles.append(band)
    panel.set_xscale("symlog", linthresh=_LINEAR)
    reach = max(1.15 * float(np.abs(ratio).max(initial=0.0)), _NARROWEST)
    panel.set_xlim(-reach, reach)
    _plain_ticks(panel)
    panel.set_yticks(at, style.brief([p.id for p in known]), fontsize=9)
    panel.set(xlabel="after - before [standard deviations]", ylim=(len(known) - 0.4, -0.6))
    style.legend_below(figure, handles)
    caption = (
        "By how much each parameter differs between the two results, in standard deviations of the "
        "difference; the band is two of them, the scale logarithmic beyond five. Parameters are "
        "correlated: what moved is told by all of them together."
    )
    rows: tuple[tuple[style.Cell, ...], ...] = tuple(
        (p.id, p.change, p.std, p.unit, p.family_p, "moved" if p.moved else "") for p in known
    )
    header = ("parameter", "after - before", "standard deviation", "unit", "p over all", "")
    title = (
        f"{int(moved.sum()) or 'No'} of {len(known)} parameters moved for sure: after minus before"
    )
    return style.Picture("changed_parameters", title, caption, figure, header, rows)


def _plain_ticks(panel: Axes) -> None:
    """Numbers at zero, where the scale turns logarithmic, and at a few powers of ten beyond.

    At each step of one or two where it does not.
    """
    low, high = panel.get_xlim()
    if high <= _LINEAR:
        panel.set_xticks(np.arange(-4.0, 5.0, 2.0 if high > _NARROWEST else 1.0))
        panel.set_xlim(low, high)
    else:
        decades = math.floor(math.log10(max(-low, high, _LINEAR)))
        far = [10.0**k for k in range(decades, 1 if decades > 1 else 0, -max(1, decades // 3))]
        far.append(_LINEAR)  # ten is too near to it where there is more
        ticks = [0.0, *far, *(-tick for tick in far)]
        panel.set_xticks([tick for tick in ticks if low <= tick <= high])
    panel.xaxis.set_major_formatter("{x:g}")
    panel.minorticks_off()


def errors_at_targets(record: ChangesRecord) -> style.Picture:
    """The error at each target with the earlier values, and what the robot itself moved by."""
    targets = sorted(record.at_targets, key=lambda target: -target.kept_mm.value)
    off = style.Look(f"off today with {record.before}", style.VERMILLION, "^", "", "", "▲")
    series = [(off, [t.kept_mm for t in targets]), (_MOVED, [t.change_mm for t in targets])]
    figure = before_and_after(
        [target.pose for target in targets],
        [(look, intervals(errors)) for look, errors in series],
        "error at the target [mm]",
        of="target, the worst first",
        level=None if record.tolerance_mm is None else (_TOLERANCE, record.tolerance_mm),
    )
    caption = (
        "By how much each target is missed on the later day with the earlier calibration, and how far "
        "the robot itself moved there between the days, with 95 % intervals."
    )
    rows: tuple[tuple[style.Cell, ...], ...] = tuple(
        (t.pose, t.kept_mm.value, t.kept_mm.low, t.kept_mm.high, t.change_mm.value,
         t.change_mm.low, t.change_mm.high)
        for t in targets
    )  # fmt: skip
    header = ("target", "kept [mm]", "from [mm]", "to [mm]", "moved [mm]", "from [mm]", "to [mm]")
    title = f"Error at each target today, with {record.before} and by the robot itself"
    return style.Picture("changes_at_targets", title, caption, figure, header, rows)
