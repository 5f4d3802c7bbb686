"""What the answer says: whether to stop, what each pose to come brings, what is known worst."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from studies import document as doc
from studies.document import Shown, listed, mm, plural
from studies.enough.record import (
    EnoughRecord,
    LackingEntry,
    StateEntry,
)
from studies.noise import counts, in_its_unit, lacks, undecided

_WEAKEST = 5
_SOURCES = {
    "cell": "as the cell states",
    "replicates": "from repeated readings",
    "residual": "from the residuals so far",
}

_LACKS = {True: "what the model lacks", False: "the error at held-out poses"}
_SCATTERS = {"arm": "the arm's repeatability", "undecided": "the arm, or what the model lacks"}


def told(record: EnoughRecord) -> doc.Document:
    """The answer, and what it rests on."""
    section = doc.Section("progress", "Are the poses enough?", tuple(_parts(record)))
    return doc.Document((*_goal(record), _progress(record), *_systematic(record)), (section,))


def _progress(record: EnoughRecord) -> doc.Sentence:
    plan, now = record.plan, mm(record.now.task_rms_mm)
    if not plan.poses:
        return doc.Sentence(
            f"Expected error at the targets: {now} RMS now, from "
            f"{plural(record.now.readings, 'reading')}."
        )
    end = f", {mm(record.end.task_rms_mm)} at the end" if record.order else ""
    return doc.Sentence(
        f"{plan.measured} of {plan.poses} planned poses are measured. Expected error at the targets: "
        f"{now} RMS now{end}."
    )


def _goal(record: EnoughRecord) -> Iterator[doc.Sentence]:
    """Whether and when the goal is met, and what to do where it is not."""
    if record.goal_mm is None:
        return
    goal, fresh = f"The goal of {record.goal_mm:g} mm", record.fresh_poses_to_goal
    if record.poses_to_goal is not None:
        mood, said = _met(record, record.poses_to_goal)
        yield doc.Sentence(f"{goal} {said}.", mood)
    elif fresh is not None and not record.plan.poses:
        yield doc.Sentence(
            f"{goal} takes about {fresh} poses more. Run `posecal design CELL --extend DATA --poses "
            f"{fresh}`.",
            "warn",
        )
    elif fresh is not None:
        yield doc.Sentence(
            f"{goal} takes about {fresh} poses more than the plan has. Run `posecal design CELL "
            f"--extend PLAN --poses {fresh}`.",
            "warn",
        )
    elif _may_be_chance(record.lacking):
        yield doc.Sentence(f"{goal} is not reached yet: {_by_chance(record.lacking)}.", "warn")
    elif record.goal_beyond_reach:
        why = _beyond_reach(record.lacking)
        yield doc.Sentence(f"More poses will not reach {record.goal_mm:g} mm: {why}.", "warn")
    elif record.fresh:
        most = mm(record.fresh[-1].task_most_mm)
        yield doc.Sentence(
            f"{goal} is out of reach: {len(record.fresh)} poses more still leave up to {most}. Use "
            "more markers, a better instrument, or fewer parameters.",
            "warn",
        )
    else:
        most = mm(record.end.task_most_mm)
        said = "is not reached by the end of the plan: the error is then below"
        yield doc.Sentence(f"{goal} {said} {most}, 19 times in 20.", "warn")


def _met(record: EnoughRecord, needed: int) -> tuple[doc.Mood, str]:
    """After so many poses. Nobody may stop on a figure that holds for the end of the day alone."""
    names = ", ".join(step.pose or "" for step in record.order[:needed])
    after = f"after {needed} more: {names}" if needed else "now"
    if record.lacking.trend_mm and record.lacking.targets_after_h is None:
        return "warn", f"is reached {after}, but only if the drift stops"
    if needed:
        return "good", f"is reached {after}"
    most = mm(record.now.task_most_mm)
    return "good", f"is reached: the error is below {most}, 19 times in 20. You may stop"


def _may_be_chance(lacking: LackingEntry) -> bool:
    """Whether most of what no pose lowers is an error at held-out poses that may be chance."""
    largest = max(lacking.scatter_mm, lacking.unexplained_mm)
    return largest == lacking.unexplained_mm > 0.0 and not lacking.unexplained_surely


def _beyond_reach(lacking: LackingEntry) -> str:
    """Why no number of poses meets a goal, and what to do: the largest of what no pose lowers."""
    largest = max(lacking.scatter_mm, lacking.unexplained_mm)
    if largest == lacking.unexplained_mm:
        return lacks(largest)
    if lacking.scatter_of == "arm":
        return f"the arm itself repeats to {mm(largest)} only"
    return undecided(largest)


def _by_chance(lacking: LackingEntry) -> str:
    return (
        f"{lacking.unexplained_from} are off by {mm(lacking.unexplained_mm)} more than expected, "
        "perhaps by chance. Measure more poses and hold them out"
    )


def _systematic(record: EnoughRecord) -> Iterator[doc.Sentence]:
    """What more poses do not lower, and goes on."""
    lacking = record.lacking
    said = record.goal_beyond_reach and lacking.unexplained_mm >= lacking.scatter_mm
    worth = lacking.unexplained_surely and counts(lacking.unexplained_mm, record.now.task_rms_mm)
    if worth and not said:
        yield doc.Sentence(f"More poses will not help: {lacks(lacking.unexplained_mm)}.", "warn")
    if lacking.trend_mm:
        from calib.prediction.trend import drift_words

        after = lacking.targets_after_h
        for drift in drift_words(lacking.trend_mm / 1e3, None if after is None else 3600.0 * after):
            yield doc.Sentence(f"{drift[0].upper()}{drift[1:]}.", "warn")


def _parts(record: EnoughRecord) -> Iterator[doc.Part]:
    yield from _facts(record)
    yield doc.Table(_ORDER, list(_coming(record)), "Poses to come, the most useful first")
    yield _weakest(record)
    yield from _open(record.end.unidentifiable)


def _facts(record: EnoughRecord) -> Iterator[doc.Sentence]:
    noise = record.noise
    source = _SOURCES[noise.source]
    yield doc.Sentence(
        f"{in_its_unit(noise.sigma_mm, noise.pixel_mm)} in each coordinate, {source}",
        label="noise",
    )
    if record.reason:
        yield doc.Sentence(f"nothing can be identified yet: {record.reason}")
    yield doc.Sentence(f"{_expected(record.now)}, at {record.targets}", label="now")
    yield from _shares(record)
    yield from _seen(record)
    if record.order:
        yield doc.Sentence(_expected(record.end), label="plan's end")
        yield from _pays(record)


def _expected(state: StateEntry) -> str:
    lost = len(state.unidentifiable)
    left = f", {plural(lost, 'parameter')} not identifiable" if lost else ""
    rms, worst = mm(state.task_rms_mm), mm(state.task_worst_mm)
    return f"{rms} RMS, {worst} at worst{left}, from {plural(state.readings, 'reading')}"


def _shares(record: EnoughRecord) -> Iterator[doc.Sentence]:
    """What of the expected error more poses lower, and what not; nothing where they lower all."""
    lacking = record.lacking
    parts = {
        _SCATTERS[lacking.scatter_of]: lacking.scatter_mm,
        _LACKS[lacking.unexplained_surely]: lacking.unexplained_mm,
    }
    said = [f"{mm(value)} from {name}" for name, value in parts.items() if value]
    if said:
        yield doc.Sentence(
            f"of it {mm(record.now.from_parameters_mm)} from the parameters. More poses do not "
            f"lower the rest: {listed(said)}"
        )


def _seen(record: EnoughRecord) -> Iterator[doc.Sentence]:
    """What poses showed that the fit was without."""
    seen = record.lacking.seen
    if seen is None:
        return
    if seen.heldout_mm is not None:
        said = f"{mm(seen.heldout_mm)} RMS at the held-out poses ({mm(seen.rms_mm)} without noise)"
    else:
        said = f"{mm(seen.rms_mm)} RMS at {seen.source}, predicted from the others (without noise)"
    yield doc.Sentence(said, label="held out")


def _pays(record: EnoughRecord) -> Iterator[doc.Sentence]:
    """Up to which pose of the order more of them do more than average noise."""
    until = record.pays_until
    if until is None:
        return
    if not until:
        said = "from here on, more poses only average noise"
    elif until < len(record.order):
        said = f"the next {until} poses; later ones only average noise"
    else:
        said = "all of them do more than average noise"
    yield doc.Sentence(said, label="worth it")


_ORDER = doc.heads(
    "measure next",
    *("expected\nRMS [mm]", "worst [mm]", "19 in 20\nbelow [mm]"),
    Shown("less by", doc.PERCENT, "%"),
    Shown("not\nidentifiable", doc.NAMES),
)


def _coming(record: EnoughRecord) -> Iterator[tuple[Any, ...]]:
    """Poses to come with what is expected, and the share by which each lowers the error."""
    for k, (step, gain) in enumerate(zip(record.order, record.gains, strict=True), 1):
        name = f"{step.pose}{' goal' * (k == record.poses_to_goal)}"
        rms, worst, most = step.task_rms_mm, step.task_worst_mm, step.task_most_mm
        yield name, rms, worst, most, gain, step.unidentifiable


def _weakest(record: EnoughRecord) -> doc.Table[tuple[Any, ...]]:
    """Robot parameters with the largest standard deviation against the size of such errors."""
    both = zip(record.now.parameters, record.end.parameters, strict=True)
    robot = [known for known in both if known[0].effect not in ("base", "tool")]
    robot.sort(key=lambda known: -1e30 if known[0].share is None else -known[0].share)
    rows = [(now.id, now.std, end.std, now.unit) for now, end in robot[:_WEAKEST]]
    deviations = ("standard\ndeviation", "at the\nplan's end")
    columns = [*doc.heads("least certain", *(Shown(own, doc.STD) for own in deviations), "unit")]
    if not record.order:
        del columns[2]
    return doc.Table(columns, rows, "The least certain parameters")


def _open(names: tuple[str, ...]) -> Iterator[doc.Sentence]:
    if names:
        yield doc.Sentence(
            f"these poses do not determine {listed(names)}. Run `posecal design`", "warn", "open"
        )
