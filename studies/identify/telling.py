"""What an identification says: how far the robot was off and is now, and each parameter."""

from __future__ import annotations

from studies.document import MRAD, Document, Figure, Section, Sentence, mm
from studies.identify.acceptance import accepted
from studies.identify.budget import budget_section
from studies.identify.drift import drift_section
from studies.identify.errors import told_errors
from studies.identify.of_type import told_of_type
from studies.identify.parameters import told_parameters
from studies.identify.record import IdentifyRecord
from studies.noise import lacks, unusual
from studies.targets import over_the_workspace

_WRONG_TABLE_MM = 20.0  # no arm is so wrong, and none so well placed by guesses
_OF_TYPE = "Is it as others of its type?"
_WRONG_TABLE = (
    "The readings do not fit this robot. Check units, signs and order of the joints, and the order of "
    "the rows."
)


def told(record: IdentifyRecord) -> Document:
    """Errors before and after, what moved meanwhile, the parameters, and the accuracy elsewhere."""
    kin = record.of_type
    workspace = Figure(lambda: over_the_workspace(record.at_targets))
    return Document(
        (_fell(record), *accepted(record.acceptance), _next(record)),
        (
            Section("errors", "Errors before and after", tuple(told_errors(record))),
            *drift_section(record),
            Section("parameters", "What was identified", tuple(told_parameters(record))),
            *([] if kin is None else [Section("type", _OF_TYPE, tuple(told_of_type(kin)))]),
            Section("workspace", "Accuracy to expect elsewhere", (workspace,)),
            *budget_section(record.budget, record.targets, record.noise.missing),
        ),
    )


def _fell(record: IdentifyRecord) -> Sentence:
    before, after, unit, _ = record.error
    where = "at held-out poses" if record.held_out else "at the fitted poses"
    old, new = (mm(own) if unit == "mm" else f"{MRAD(own)} {unit}" for own in (before, after))
    if after >= before:
        return Sentence(f"The error {where} did not fall: {old} before, {new} after.", "warn")
    converged = record.status == "converged"
    praised = record.status != "not_converged" and before >= 2.0 * after > 0.0
    ratio = before / after if praised else 1.0
    times = f", {ratio:.{int(ratio < 10.0)}f} times better" * praised
    said = f"The error {where} fell from {old} to {new}{times}."
    return Sentence(said, "good" if converged else "warn")


def _next(record: IdentifyRecord) -> Sentence:
    """What speaks against the result first, else the accuracy to expect."""
    before, after, unit, _ = record.error
    if unit == "mm" and min(before, after) > _WRONG_TABLE_MM:
        return Sentence(_WRONG_TABLE, "warn")
    noise, lacking = record.noise, 0.0 if record.budget is None else record.budget.of("model")
    if record.status != "converged":
        status = record.status.replace("_", " ").capitalize()
        return Sentence(f"{status}: {record.advice}.", "warn")
    if lacking:
        said = lacks(lacking)
        return Sentence(f"{said[0].upper()}{said[1:]}.", "warn")
    if after >= before and not record.noise.lacks:
        return Sentence("The nominal model is as good: there is nothing to correct.")
    if after >= before:
        said = "Do not use this model. Measure more poses, or identify fewer parameters."
        return Sentence(said, "warn")
    if noise.louder and not noise.scatters:
        return Sentence(
            f"{mm(noise.sigma_mm)} remains in each coordinate; the cell states "
            f"{mm(noise.believed_sigma_mm)}. Run `posecal diagnose`.",
            "warn",
        )
    if (scatters := unusual(noise)) is not None:
        return Sentence(scatters, "warn")
    rms, worst = mm(record.task_rms_mm), mm(record.task_worst_mm)
    only = ", if the model lacks nothing" if noise.missing else ""
    return Sentence(
        f"The parameters' uncertainty leaves {rms} RMS at the targets, {worst} at worst{only}."
    )
