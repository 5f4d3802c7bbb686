"""What an identification says: how far the robot was off and is now, and each parameter."""

from __future__ import annotations

from collections.abc import Iterator

from studies.document import MRAD, Document, Figure, Section, Sentence, listed, mm, plural
from studies.identify.acceptance import accepted
from studies.identify.budget_told import budget_section
from studies.identify.drift_told import drift_section
from studies.identify.errors_told import told_errors
from studies.identify.of_type import told_of_type
from studies.identify.parameters_told import told_parameters
from studies.identify.record import IdentifyRecord
from studies.systematic import lacks
from studies.targets import over_the_workspace


def told(record: IdentifyRecord) -> Document:
    """Errors before and after, what moved meanwhile, the parameters, and the accuracy elsewhere."""
    workspace = Figure(lambda: over_the_workspace(record.at_targets))
    return Document(
        tuple(_headline(record)),
        (
            Section("errors", "Errors before and after", tuple(told_errors(record))),
            *drift_section(record),
            Section("parameters", "What was identified", tuple(told_parameters(record))),
            *_of_type(record),
            Section("workspace", "Accuracy to expect elsewhere", (workspace,)),
            *budget_section(record.budget, record.targets, record.noise.missing),
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
    noise = record.noise
    rest = (
        "that is, if nothing were missing" if noise.missing else "what the model lacks comes on top"
    )
    yield Sentence(
        f"The uncertainty of the parameters leaves {mm(record.task_rms_mm)} RMS elsewhere, "
        f"{mm(record.task_worst_mm)} at worst ({record.targets}); {rest}."
    )
    lacking = 0.0 if record.budget is None else record.budget.of("model")
    if lacking:
        yield Sentence(f"Beside it {lacks(lacking)}.", "warn")
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
