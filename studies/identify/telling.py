"""What an identification says: how far the robot was off and is now, and each parameter."""

from __future__ import annotations

from collections.abc import Iterator
from operator import attrgetter, itemgetter
from typing import Any

import numpy as np

from studies.document import (
    CORRELATION,
    COUNT,
    HOURS,
    MM,
    MRAD,
    TENTH,
    THREE,
    TO_STD,
    Column,
    Detail,
    Document,
    Figure,
    P,
    Part,
    Rule,
    Section,
    Sentence,
    Table,
    listed,
    mm,
    plural,
)
from studies.identify.acceptance import accepted
from studies.identify.budget_told import budget_section
from studies.identify.drift import Drift, Motion, Rate, Reference
from studies.identify.of_type import told_of_type
from studies.identify.pictures import (
    correlation,
    distances,
    errors_over_image,
    residuals_by_pose,
)
from studies.identify.point_errors import point_errors
from studies.identify.record import (
    Absorbed,
    IdentifyRecord,
    Model,
    OfInstrument,
    Outlier,
    Parameter,
    Share,
)
from studies.noise import noise_words
from studies.record import Three
from studies.targets import over_the_workspace

_TOGETHER = 0.9  # correlation worth a line
_BY_POSE, _OPTIMISM = 1.2, 1.05  # ratios worth a line
_MOST = 8  # readings and outliers that the terminal shows
_MODELLED = ("base_drift", "tracker_drift")
_MODELS: dict[Model, str] = {
    "fitted_all": "identified, every pose",
    "fitted": "identified, without the outliers",
    "nominal": "nominal (base and markers fitted)",
    "heldout": "held out",
    "heldout_trimmed": "held out, without its outliers",
}


def told(record: IdentifyRecord) -> Document:
    """Errors before and after, what moved meanwhile, the parameters, and the accuracy elsewhere."""
    workspace = Figure(lambda: over_the_workspace(record.at_targets))
    return Document(
        tuple(_headline(record)),
        (
            Section("errors", "Errors before and after", tuple(_errors(record))),
            *_drift(record),
            Section("parameters", "What was identified", tuple(_identified(record))),
            *_of_type(record),
            Section("workspace", "Accuracy to expect elsewhere", (workspace,)),
            *budget_section(record.budget, record.targets),
        ),
    )


def _headline(record: IdentifyRecord) -> Iterator[Sentence]:
    before, after, unit = _before_and_after(record)
    where = "at poses it never saw, the robot" if record.held_out else "the robot"
    better, converged = after < before, record.status == "converged"
    figure = mm(after) if unit == "mm" else f"{MRAD(after)} {unit}"
    now = f"is now predicted to {figure}" if better else f"is predicted to {figure}, no better"
    praised = record.status != "not_converged" and before >= 2.0 * after > 0.0
    times = f", {before / after:.0f} times better" if praised else ""
    yield Sentence(
        f"{record.rank} of {len(record.parameters)} parameters identified from "
        f"{plural(record.poses, 'reading')}, {plural(record.points, 'point')}: {where} was off by "
        f"{mm(before) if unit == 'mm' else f'{MRAD(before)} {unit}'} and {now}{times}.",
        "good" if better and converged else "warn",
    )
    if not better:
        said = "Do not use the identified model: measure more poses, or identify fewer parameters."
        yield Sentence(said, "warn")
    if not converged:
        status = record.status.replace("_", " ").capitalize()
        yield Sentence(f"{status}: {record.advice}.", "warn")
    yield Sentence(
        f"The uncertainty of the parameters leaves {mm(record.task_rms_mm)} RMS elsewhere, "
        f"{mm(record.task_worst_mm)} at worst ({record.targets}); what the model lacks comes on top."
    )
    noise = record.noise
    if noise.source == "residual" and not noise.scatters:
        yield Sentence(
            f"The points scatter by {mm(noise.sigma_mm)} in each coordinate where the instrument "
            f"should by {mm(noise.believed_sigma_mm)}: the model lacks something, or the noise is not "
            "as stated; posecal diagnose asks.",
            "warn",
        )
    if record.outliers:
        names = listed([entry.pose for entry in record.outliers])
        yield Sentence(f"Left out of the fit as outliers: {names}.", "warn")
    yield from accepted(record.acceptance)


def _before_and_after(record: IdentifyRecord) -> tuple[float, float, str]:
    """RMS by the nominal and by the identified model, held out where anything was, and the unit.

    In space; where no reading is a length, of the instrument that is predicted worst.
    """
    rms = record.rms_mm
    if rms.nominal is not None and rms.fitted_all is not None:
        unseen = record.nominal_at_heldout_mm
        if unseen is not None and rms.heldout is not None:
            return unseen, rms.heldout, "mm"
        return rms.nominal, rms.fitted_all, "mm"
    of = {own.instrument: own for own in record.instruments}
    worst = max(of.values(), key=lambda own: own.heldout or own.fitted_all or 0.0)
    own = [row for row in record.residuals if row.instrument == worst.instrument]
    if record.held_out:
        own = [row for row in own if row.heldout]
    both = (
        [sum(x * x for x in vector) for vector in vectors]
        for vectors in ([row.before for row in own], [row.vector for row in own])
    )
    before, after = ((sum(squares) / len(squares)) ** 0.5 for squares in both)
    return before, after, worst.unit


def _of_type(record: IdentifyRecord) -> Iterator[Section]:
    """How the robot stands to its type; nothing where the cell names none."""
    if record.of_type is not None:
        yield Section("type", "Is it as others of its type?", tuple(told_of_type(record.of_type)))


# -- errors ------------------------------------------------------------------------------------


_FIGURES: tuple[Column[Any], ...] = tuple(
    Column(title, itemgetter(k), MM, "mm") for k, title in enumerate(("RMS", "p95", "max"), 1)
)
_ERRORS = (Column("distance measured - predicted", itemgetter(0)), *_FIGURES)
_PAIRS = (
    Column("distance between two poses", itemgetter(0)),
    *_FIGURES,
    Column("pairs", itemgetter(4), COUNT),
)
_OF_INSTRUMENTS: tuple[Column[OfInstrument], ...] = (
    Column("instrument", attrgetter("instrument")),
    Column("unit", attrgetter("unit")),
    Column("nominal", attrgetter("nominal"), MRAD),
    Column("identified", attrgetter("fitted_all"), MRAD),
    Column("held out", attrgetter("heldout"), MRAD),
)
_OUTLIERS: tuple[Column[tuple[Outlier, str]], ...] = (
    Column("pose", lambda row: row[0].pose),
    Column("what became of it", lambda row: row[1]),
    Column("reason", lambda row: row[0].reason),
)


def _errors(record: IdentifyRecord) -> Iterator[Part]:
    floor = mm(3.0**0.5 * record.noise.instrument_mm)
    caption = f"Distances in space; the instrument alone would leave {floor} RMS"
    if rows := list(_models(record)):
        yield Table(_ERRORS, rows, "Errors by model", caption)
        yield Figure(lambda: distances(record))
    if len(record.instruments) > 1 or not rows:
        caption = "Root mean squares; of whole poses, the length of the translation and of the turn"
        yield Table(_OF_INSTRUMENTS, record.instruments, "Errors by instrument", caption)
    every = {**_MODELS, "fitted": _MODELS["fitted_all"]}
    pairs = [
        (every[key], own.rms, own.p95, own.max, own.pairs)
        for key, own in record.pair_distances_mm.items()
    ]
    caption = (
        "Distances between points of two poses, measured minus predicted: a check that depends on no "
        "frame, since distances are the same wherever the instrument stands"
    )
    yield Detail((Table(_PAIRS, pairs, "Distances between two poses", caption),) if pairs else ())
    yield from _outliers(record)
    if any(row.at_px is not None for row in record.residuals):
        yield Figure(lambda: errors_over_image(record))
    if not rows:
        return
    yield Figure(lambda: residuals_by_pose(record, heldout=False))
    if record.rms_mm.heldout is not None:
        yield Figure(lambda: residuals_by_pose(record, heldout=True))
    yield Detail(
        (Table(_POSES, _by_pose(record), "Errors pose by pose", of_poses=True, fold=True),)
    )


def _models(record: IdentifyRecord) -> Iterator[tuple[Any, ...]]:
    trimmed = {"fitted": record.outliers, "heldout_trimmed": record.heldout_outliers}
    for key, label in _MODELS.items():
        row = [getattr(figures, key) for figures in (record.rms_mm, record.p95_mm, record.max_mm)]
        if row[0] is not None and trimmed.get(key, True):
            yield label, *row


def _outliers(record: IdentifyRecord) -> Iterator[Part]:
    rows = [(entry, "left out of the fit") for entry in record.outliers]
    rows += [(entry, "held out") for entry in record.heldout_outliers]
    if not rows:
        yield Detail((Sentence("No pose was rejected.", "good"),))
        return
    yield Table(_OUTLIERS, rows, "Poses that stand out", "Poses that stand out", True, _MOST)
    if record.outliers_share is not None:
        yield Detail((Sentence(_shared(record.outliers_share), "warn"),))


def _shared(share: Share) -> str:
    """What outliers have in common, and what that means."""
    name = share.variable.removeprefix("q:")
    low, high = f"{share.low:.4g}", f"{share.high:.4g}"
    if share.beyond_all_others is not None:
        return (
            f"An outlier is the only pose at {name} = {high} {share.unit}, "
            f"{share.beyond_all_others:.3g} {share.unit} beyond every other: the model is extrapolated "
            "there, and may be at fault."
        )
    span = f"{low} to {high}" if low != high else low
    return (
        f"Outliers with something in common are a signal, not a fault: {share.outliers} of "
        f"{share.of_outliers} have {name} in {span} {share.unit}, where {share.poses} of "
        f"{share.of_poses} poses are (by chance {share.p:.1g}). Believe the figures over all poses, "
        "and look for what the model lacks there."
    )


_POSES: tuple[Column[Any], ...] = (
    Column("pose", itemgetter(0)),
    Column("RMS before", itemgetter(1), MM, "mm"),
    Column("RMS after", itemgetter(2), MM, "mm"),
    Column("markers seen", itemgetter(3), COUNT),
    Column("use", itemgetter(4)),
)


def _by_pose(record: IdentifyRecord) -> list[tuple[Any, ...]]:
    found = point_errors(record)
    before, after = (1e3 * found.by_pose(errors) for errors in (found.before, found.after))
    use = ["held out" if held else "fitted" for held in found.heldout]
    seen = found.seen.sum(axis=1).tolist()
    return list(zip(found.poses, before, after, seen, use, strict=True))


# -- readings that were repeated ---------------------------------------------------------------


_AGAIN: tuple[Column[tuple[Motion, Reference]], ...] = (
    Column("read again", lambda row: row[0].pose),
    Column("first", lambda row: row[1].pose),
    Column("since", lambda row: row[0].hours, HOURS, "h"),
    Column("moved x, y, z", lambda row: row[0].translation_um, THREE, "um"),
    Column("std", lambda row: _rms(row[0].translation_std_um), TENTH, "um"),
    Column("turned", lambda row: row[0].rotation_urad, THREE, "urad"),
    Column("std", lambda row: _rms(row[0].rotation_std_urad), TENTH, "urad"),
    Column("distance", lambda row: row[0].length_um, TENTH, "um"),
    Column("p", lambda row: row[0].p_value, P),
)


def _drift(record: IdentifyRecord) -> Iterator[Section]:
    """How far poses that were read again had moved; nothing without them."""
    drift = record.drift
    if drift is None:
        return
    rows = [(motion, one) for one in drift.references for motion in one.moved]
    table = Table(_AGAIN, rows, "Poses read again", of_poses=True, most=_MOST)
    yield Section("drift", "Did anything move meanwhile?", (table, *_moved(record, drift)))


def _moved(record: IdentifyRecord, drift: Drift) -> Iterator[Sentence]:
    count, p = len(drift.references), P(drift.p_value)
    of = f" ({count} repeated poses together)" if count > 1 else ""
    if drift.verdict == "steady":
        said = f"none seen: p {p}{of}, the readings differ as their noise does"
    elif drift.verdict == "drift":
        said = f"yes: p {P(drift.trend_p)} for a steady motion{of}"
    else:
        said = f"no steady one, but the readings moved more than noise: p {p}{of}"
    yield Sentence(said, "good" if drift.verdict == "steady" else "warn", "drift")
    if drift.verdict == "drift":
        yield from map(_rate, drift.rates)
    if drift.noise_factor != 1.0:
        yield Sentence(
            f"single points scatter {TENTH(drift.noise_factor)} times as much as the cell states"
        )
    if drift.verdict != "steady":
        yield from _to_do(record, drift)


def _rate(rate: Rate) -> Sentence:
    shift, turn = (
        " ".join(map(TENTH, values))
        for values in (rate.translation_um_per_h, rate.rotation_urad_per_h)
    )
    shift_std = TENTH(_rms(rate.translation_std_um_per_h))
    turn_std = TENTH(_rms(rate.rotation_std_urad_per_h))
    return Sentence(
        f"{shift} um/h and {turn} urad/h in station {rate.station} (std {shift_std} and {turn_std})"
    )


def _rms(values: Three | None) -> float | None:
    return None if values is None else float(np.sqrt(np.mean(np.square(values))))


def _to_do(record: IdentifyRecord, drift: Drift) -> Iterator[Sentence]:
    if not drift.one_side:
        yield Sentence(
            "joints came from different sides, so it may be backlash: come from one side each time"
        )
    modelled = [p.effect for p in record.parameters if p.effect in _MODELLED]
    if drift.verdict == "moved":
        yield Sentence(
            "the robot does not return, something was knocked or is loose, or readings are too few for "
            "a trend; if one row above stands out, measure again from there"
        )
    elif modelled:
        yield Sentence(f"{modelled[0]} is in the model and takes it up as far as it is steady")
    elif not drift.rates:
        yield Sentence(
            "add column time_s, and base_drift to [model] effects, or measure again once all is warm"
        )
    else:
        yield Sentence(
            "add base_drift to [model] effects (the instrument's drift looks alike), or measure again "
            "once all is warm; posecal diagnose says whether something else fits better"
        )


# -- parameters --------------------------------------------------------------------------------

_INTERVAL = Rule(TO_STD.show, absent="")
_PARAMETERS: tuple[Column[Parameter], ...] = (
    Column("effect", lambda row: row.effect),
    Column("where", lambda row: row.where),
    Column("parameter", lambda row: row.name),
    Column("value", lambda row: (row.value, row.std), TO_STD),
    Column("standard\ndeviation", lambda row: row.std and (row.std, row.std), TO_STD),
    Column("95 % interval", lambda row: row.ci95 and (*row.ci95, row.std), _INTERVAL, detail=True),
    Column("unit", lambda row: row.unit),
)
_CORRELATED: tuple[Column[tuple[str, str, float]], ...] = (
    Column("parameter", lambda row: row[0]),
    Column("parameter", lambda row: row[1]),
    Column("correlation", lambda row: row[2], CORRELATION),
)
_ABSORBED: tuple[Column[Absorbed], ...] = (
    Column("constant error", lambda row: row.id),
    Column("does the same as", lambda row: ", ".join(row.absorbed_by)),
)


def _identified(record: IdentifyRecord) -> Iterator[Part]:
    how = ", elastic parameters from differences" * record.differences
    yield Sentence(f"approach {record.approach}, method {record.method}{how}", label="solved")
    for k, words in enumerate(noise_words(record.noise)):
        yield Sentence(words, label="" if k else "noise")
    caption = (
        "Parameters of the robot. Base and tool are estimated with them, and their uncertainty is "
        "counted; 95 of 100 such intervals hold the true value, if the model is right. The factor is "
        "Student's t at the effective degrees of freedom"
    )
    robot, placed = ([p for p in record.parameters if p.placed is own] for own in (False, True))
    yield Table(_PARAMETERS, robot, "Parameters of the robot", caption, fold=False)
    where = Table(_PARAMETERS, placed, "Where base and markers are", fold=True, paper=True)
    yield Detail((where,) if placed else ())
    yield from _doubts(record)
    caption = (
        f"Pairs whose correlation is above {_TOGETHER}: their sum or difference is known better than "
        "each"
    )
    pairs = sorted(_correlated(record), key=lambda pair: -abs(pair[2]))
    table = Table(_CORRELATED, pairs, "Pairs that go together", caption)
    yield Detail((table,) if pairs else ())
    yield Detail((Figure(lambda: correlation(record)),), "Correlation of all parameters")
    absorbed = Table(_ABSORBED, record.absorbed, "Errors that no pose can tell from those above",
                     fold=True)  # fmt: skip
    yield Detail((absorbed,) if record.absorbed else ())


def _doubts(record: IdentifyRecord) -> Iterator[Sentence]:
    """What a reader of the values should know."""
    for entry in record.unidentifiable:
        yield Sentence(f"{listed(entry.names)}: {entry.reason}", "warn", "not told")
    if record.weak:
        said = f"{listed(record.weak)}: more uncertain than such errors are large"
        yield Sentence(said, "warn", "weak")
    if any(p.effect == "backlash" for p in record.parameters):
        yield Sentence(
            "half_width below zero is ordinary lost motion, the joint stops short of its motion; above "
            "zero it goes too far",
            "note",
            "sign",
        )
    few = [name for name in record.unused_poses if name not in record.before_the_first_move]
    if few:
        yield Sentence(f"{listed(few)}: too few markers for an orientation", "note", "unused")
    together = _common_error(record)
    if together > _BY_POSE:
        yield Sentence(
            "points of one pose err together: counted by pose, standard deviations are "
            f"{TENTH(together)} times these in the median (JSON: std_by_pose)",
            "note", "by pose",
        )  # fmt: skip
    worst = max((p.step_two_optimism or 0.0 for p in record.parameters), default=0.0)
    if worst > _OPTIMISM:
        yield Sentence(
            "base and tool are part of these standard deviations; taken as known, as in the paper's "
            f"step 2, they would read up to {TENTH(worst)} times smaller",
            label="step 2",
        )
    if record.absorbed:
        count = plural(len(record.absorbed), "constant error")
        yield Sentence(
            f"{count} more, which no pose can tell from those above (JSON: absorbed)",
            label="left out",
        )


def _common_error(record: IdentifyRecord) -> float:
    """Median ratio of standard deviations by pose to those by point; 1 where it cannot be told."""
    ratios = [p.std_by_pose / p.std for p in record.parameters if p.std and p.std_by_pose]
    if not ratios or record.noise.source != "residual" or record.noise.scatters:
        return 1.0
    return float(np.median(ratios))


def _correlated(record: IdentifyRecord) -> Iterator[tuple[str, str, float]]:
    """Pairs of the robot's parameters that the data hardly tell apart."""
    own = [i for i, p in enumerate(record.parameters) if not p.placed and p.std]
    for n, a in enumerate(own):
        for b in own[n + 1 :]:
            r = record.correlation[a][b]
            if r is not None and abs(r) > _TOGETHER:
                yield record.parameters[a].id, record.parameters[b].id, r
