"""``posecal design``: which poses to measure, and a proof of how good they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from studies.command import options
from studies.command.call import Call, working

if TYPE_CHECKING:
    from calib import Cell


def _criteria(_: click.Context, __: click.Parameter, start: str) -> list[str]:
    """Criteria for the completion of the shell, those of installed packages too."""
    from doe.criteria import UNASKED, catalogue

    return [name for name in catalogue() if name.startswith(start) and name != UNASKED]


# fmt: off
@click.command()
@options.cell
@options.value("-o --output plan_path", "PLAN", "Write the plan as CSV, in the order of measurement.")
@options.value("--poses", "N", "Number of poses to choose.", click.IntRange(min=1))
@options.value("--criterion", "NAME",
    "What the plan minimises. task: error at the targets. A: mean variance. "
    "D: volume of the confidence ellipsoid. Ds: the same for some parameters. c: one "
    "combination. E: the worst combination. G: the worst predicted pose. Or a criterion of an "
    "installed package.", str,
    default="task", show_default=True, shell_complete=_criteria)
@options.value("--levels", "A2=5x3", "Five levels of A2 with three poses each. Their angles are "
    "chosen, or given: A2=-140,-57,-10x3.", str)
@options.value("--candidates", "N|FILE", "Number of candidates to draw, or a table of candidates in "
    "the format of a plan. The angles of drawn ones are moved a little after the choice.", str,
    default="20000", show_default=True)
@options.value("--extend extend_path", "PLAN|TABLE", "A plan that is measured already, or a table of "
    "measured points. N new poses are added to it.")
@options.value("--discriminate", "EFFECT:WHERE,EFFECT:WHERE",
    "Choose poses that separate two effects, instead of a criterion.", str)
@options.value("--of", "NAME[,NAME]",
    "Parameters that matter. Ds, A, E: joint_compliance:A6,.. c: also NAME=FACTOR,..", str)
@options.value("--against", "PLAN", "Also judge this plan. Can be given several times.", multiple=True)
@click.option("--curve", is_flag=True, help="Also state the accuracy for other numbers of poses.")
@options.value("--reapproach", "N", "Add N repeat visits over the day, to measure the arm's "
    "repeatability.", click.IntRange(min=0))
@click.option("--repeats/--no-repeats", default=None, help="Whether a pose may be chosen twice.")
@options.value("--motions", "N", "Choose N motions in place of poses, to identify or to explain joint "
    "torques. With D (the default), A, E, c, or --discriminate TERM[:WHERE],TERM[:WHERE].",
    click.IntRange(min=1))
@options.result()
def design(
    call: Call, cell_path: Path, plan_path: Path | None, candidates: str, extend_path: Path | None,
    discriminate: str | None, of: str | None, against: tuple[Path, ...], reapproach: int | None,
    repeats: bool | None, motions: int | None, **asked: Any,
) -> None:
    """Choose the poses to measure, and prove how good this plan is.

    CELL describes the measurement cell (cell.toml). Its [design] table may give the number of poses,
    levels, obstacles and targets. Options override it.

    \b
    Example:
      posecal design cell.toml --levels A2=5x3 --criterion task -o plan.csv
    """
    import numpy as np

    import calib
    import doe
    from calib.errors import InputError
    from calib.files.write_tables import plan_csv
    from studies.results.design import DesignResult, shown_levels

    source_of = click.get_current_context().get_parameter_source
    given = source_of("criterion")
    if discriminate is not None and given == click.core.ParameterSource.COMMANDLINE:
        raise InputError("--criterion", "", "does not go with --discriminate", "give one of them")
    cell = calib.load_cell(cell_path)
    if motions is not None:
        wanted: dict[str, Any] = {"motions": motions, "discriminate": two_effects(discriminate)}
        if given == click.core.ParameterSource.COMMANDLINE:
            wanted["criterion"] = asked["criterion"]
        if source_of("candidates") == click.core.ParameterSource.COMMANDLINE:
            wanted["candidates"] = candidates_of(candidates)
        _deliver_motions(call, cell, plan_path, wanted | {"of": parted(of)}, {
            "--poses": asked["poses"], "--levels": asked["levels"], "--curve": asked["curve"],
            "--extend": extend_path, "--against": against, "--reapproach": reapproach,
            "--repeats": repeats,
        })
        return
    again = cell.design.reapproaches if reapproach is None else reapproach
    twice = cell.design.repeats if repeats is None else repeats
    cell = replace(cell, design=replace(cell.design, reapproaches=again, repeats=twice))
    source = candidates_of(candidates)
    further = (*against, extend_path, source if isinstance(source, Path) else None)
    inputs = [cell_path, *cell.robot_files, *cell.named_files, *filter(None, further)]
    call.check(inputs, plan_path)
    loaded = [calib.load_plan(cell, path) for path in against]
    with options.faults_in(cell_path), working("choosing poses"):
        found = doe.design(
            cell,
            candidates=source,
            extend=extend_path,
            discriminate=two_effects(discriminate),
            of=parted(of),
            against=dict(zip(options.plan_names(against), loaded, strict=True)),
            seed=call.seed,
            **asked,  # poses, criterion, levels, curve
        )
    result = DesignResult.of(found, cell, call.envelope(cell, inputs))
    table = plan_csv(cell, found.poses, np.array(shown_levels(found)))
    call.deliver(result, {} if plan_path is None else {plan_path: table})


# fmt: on
def _deliver_motions(
    call: Call, cell: Cell, plan_path: Path | None, asked: dict[str, Any], refused: dict[str, Any]
) -> None:
    """Choose motions, and deliver.

    asked : of ``doe.design_motions``; refused : options that go with poses alone, by name

    Raises InputError.
    """
    from calib.errors import InputError
    from calib.files.write_tables import commanded_csv
    from doe import design_motions
    from studies.results.design import MotionDesignResult, name_of

    options.refuse("--motions", refused)
    if isinstance(asked.get("candidates"), Path):
        raise InputError("--candidates", "", "is no number", "motions are drawn; give how many")
    inputs = [cell.path, *cell.robot_files]
    call.check(inputs, plan_path)
    with options.faults_in(cell.path), working("choosing motions"):
        found = design_motions(cell, seed=call.seed, **asked)
    runs = [(name_of(k), own.time, own.at(own.time)[0], own.payload.mass)
            for k, own in enumerate(found.motions)]  # fmt: skip
    text = commanded_csv(cell, runs)
    result = MotionDesignResult.of(found, call.envelope(cell, inputs))
    call.deliver(result, {} if plan_path is None else {plan_path: text})


def parted(of: str | None) -> list[str]:
    """The names of --of."""
    return [] if of is None else [name.strip() for name in of.split(",")]


def candidates_of(candidates: str) -> int | Path:
    """A number of candidates, or the table that holds them. Raises InputError."""
    from calib.errors import InputError

    try:
        number = float(candidates)
    except ValueError:
        if not candidates.strip():
            raise InputError("--candidates", "", "is empty", "give a number or a table") from None
        return Path(candidates)
    if not 1.0 <= number < 1e12 or number != round(number):
        raise InputError("--candidates", "", f"{candidates} is no count", "give 1 or more")
    return int(number)


def two_effects(text: str | None) -> tuple[str, str] | None:
    """Both effects of --discriminate. Raises InputError."""
    from calib.errors import InputError

    if text is None:
        return None
    first, _, second = (part.strip() for part in text.partition(","))
    if not first or not second or "," in second or first == second:
        what, remedy = f"{text!r} is not two effects", "write EFFECT:WHERE,EFFECT:WHERE"
        raise InputError("--discriminate", "", what, remedy)
    return first, second
