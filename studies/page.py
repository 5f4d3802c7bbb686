"""The report: one page that names nothing outside itself, of results and their unchanged inputs."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup, escape

from calib.errors import CalibError
from studies import render
from studies.figures import style
from studies.results.read import Input, located, read

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from calib import Cell, Measurements
    from calib.arrays import Array
    from studies.results.base import Result

_ORDER = ("identify", "diagnose", "compensate", "enough", "changes", "compare", "design", "plan")
"""Kinds in the order in which the page shows them; the first that is there is shown open."""
_DRAWN = ("diagnose",)  # beside the first: figures take most of the time and of the size
_ADVISES = ("diagnose", "identify", "compensate", "enough", "design")
_LABELS = {
    "identify": "Identification",
    "diagnose": "Diagnosis",
    "compensate": "Corrected commands",
    "enough": "Enough poses?",
    "changes": "What moved",
    "compare": "Both methods side by side",
    "design": "Plan",
    "plan": "What the plan shows",
}
_COLOURS = {
    style.INK: "var(--ink)",
    style.SOFT: "var(--soft)",
    style.DIM: "var(--dim)",
    style.FAINT: "var(--faint)",
}
_EPOCH = 1e9  # s: times beyond count from 1970


@dataclass(frozen=True, eq=False)
class Reported:
    """A result file: its content, and its inputs, the cell first."""

    path: Path
    result: Result
    inputs: tuple[Input, ...]


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the inputs of a result add to it, as long as they are unchanged.

    tables : measured poses by whether they are held out; q : joint values, shape (m, n), rad or m
    notes : what is left out, and why
    """

    cell: Cell | None = None
    tables: Mapping[bool, Measurements] | None = None
    q: Array | None = None
    notes: tuple[str, ...] = ()


def report_page(
    paths: Sequence[Path], title: str | None, about: Mapping[str, str]
) -> tuple[str, tuple[str, ...]]:
    """The page, and notes on what had to be left out.

    title : None for the name of the cell; about : what the user says of the measurement, by label

    Raises InputError where a file is no result of posecal.
    """
    every = sorted(map(_reported, paths), key=lambda item: _place(item.result.kind))
    first: Reported = next((item for item in every if item.result.error is not None), every[0])
    of_cell = [item for item in every if item.result.of_one_cell]
    evidence = _evidence(first if first in of_cell else next(iter(of_cell), first))
    notes = (*evidence.notes, *_mixed(of_cell))
    numbers = count(1)
    draw = partial(_inline, numbers)
    arm = Markup()
    if evidence.cell is not None and evidence.q is not None:
        from studies.figures import arm as draw_arm

        caption = "The nominal arm in its base frame, faintly at all poses, strongly at the first."
        arm = Markup(draw(draw_arm(evidence.cell, evidence.q), "arm", caption))  # noqa: S704
    shown = []
    for item in every:
        text = render.markdown(
            item.result,
            page=True,
            draw=draw if item is first or item.result.kind in _DRAWN else None,
            variables=_variables(evidence) if item is first else None,
        )
        answer, advice, body = map(render.html, render.parts(text))
        shown.append((item, _label(item, every), answer, advice, body))
    by_kind = {item.result.kind: advice for item, _, _, advice, _ in reversed(shown)}
    facts = {**first.result.about, **_day(evidence), **about}
    page = render.page_template().render(
        title=title or first.result.cell or "Calibration",
        about=facts,
        first=first,
        error=first.result.error,
        advice=next((by_kind[kind] for kind in _ADVISES if kind in by_kind), ""),
        warnings=[*notes, *(w for item in every for w in item.result.warnings)],
        shown=shown,
        arm=arm,
        cell=evidence.cell,
        inputs={(one.file, one.sha256): one.state for item in every for one in item.inputs},
    )
    return page, tuple(notes)


def _place(kind: str) -> int:
    return _ORDER.index(kind) if kind in _ORDER else len(_ORDER)


def _label(item: Reported, every: Sequence[Reported]) -> str:
    """What a result is called; with its file where there are several of its kind."""
    label = _LABELS.get(item.result.kind, item.result.kind)
    several = sum(one.result.kind == item.result.kind for one in every) > 1
    return f"{label}: {item.path.name}" if several else label


def _inline(numbers: Iterator[int], figure: Figure, name: str, caption: str) -> str:
    """A figure in the colours of the page, which scrolls where it is wider."""
    drawn = style.svg(figure, f"{name}{next(numbers)}", caption)
    for colour, variable in _COLOURS.items():
        drawn = drawn.replace(colour, variable)
    drawn = re.sub(r" font-family: [^;]*;", "", drawn)  # that of the page
    width = 96.0 * figure.get_figwidth()
    return (
        f'<figure><div class="drawn" tabindex="0" role="region" aria-label="figure" '
        f'style="--width: {width:.0f}px">{drawn}</div>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


# -- inputs of the results ---------------------------------------------------------------------


def _reported(path: Path) -> Reported:
    result = read(path)
    inputs = tuple(located(path, entry.file, entry.sha256) for entry in result.inputs)
    return Reported(path, result, inputs)


def _mixed(every: Sequence[Reported]) -> Iterator[str]:
    """Files that are not the same in all results."""
    known: dict[str, tuple[str, Path]] = {}
    for item in every:
        for entry in item.inputs:
            name = Path(entry.file).name
            digest, first = known.setdefault(name, (entry.sha256, item.path))
            if digest != entry.sha256:
                yield (
                    f"{name} is another file in {item.path.name} than in {first.name}: their figures "
                    "do not belong together"
                )


def _evidence(item: Reported) -> Evidence:
    """The cell of a result and its tables, where these are unchanged."""
    from calib import load_cell, load_measurements

    source = item.inputs[0] if item.inputs else None
    if source is None or source.path is None:
        what = "the cell" if source is None else f"{source.file} is {source.state}: the cell"
        return Evidence(notes=(f"{what}, its picture and what needs the robot are left out",))
    try:
        cell = load_cell(source.path)
        if item.result.kind == "design":
            return Evidence(cell, q=_joints(cell, item))
        if item.result.kind not in ("identify", "diagnose"):
            return Evidence(cell)
        holdout = getattr(item.result, "holdout", None)  # as the user gave it
        table, *others = item.inputs[1 + len(cell.robot_files) :]
        wanted = {False: table} | {
            one.file == holdout: one for one in others if one.file == holdout
        }
        lost = tuple(
            f"{one.file} is {one.state}: figures that need it are left out"
            for one in wanted.values()
            if one.path is None
        )
        if lost:
            return Evidence(cell, notes=lost)
        tables = {
            held: load_measurements(cell, one.path, every_marker=False)
            for held, one in wanted.items()
            if one.path is not None
        }
    except CalibError as error:
        return Evidence(notes=(f"{error}: the cell is left out",))
    shown = {True: tables[False], **tables}  # a share of the one table may be held out
    return Evidence(cell, shown, tables[False].poses.q)


def _joints(cell: Cell, item: Reported) -> Array:
    """Joint values of a design, shape (m, n), rad or m. Raises InputError for other joints."""
    from calib.errors import InputError

    robot, poses = cell.robot, getattr(item.result, "poses", ())
    values = [{**pose.joints_deg, **pose.joints_mm} for pose in poses]
    if any(set(row) != set(robot.joints) for row in values):
        joints = f"these are {', '.join(robot.joints)}"
        raise InputError(item.path, "poses", "name other joints than the cell", joints)
    scale = np.where(robot.prismatic, 1e-3, np.pi / 180.0)
    return np.array([[row[joint] for joint in robot.joints] for row in values]) * scale


def _variables(evidence: Evidence) -> dict[str, dict[tuple[str, bool], float]] | None:
    """What errors may depend on: label with unit -> (pose, whether held out) -> value."""
    if evidence.cell is None or evidence.tables is None:
        return None
    robot, variables = evidence.cell.robot, dict[str, dict[tuple[str, bool], float]]()
    for held, data in evidence.tables.items():
        poses = data.poses
        columns: dict[str, Any] = {
            f"{joint} [{'mm' if slides else 'deg'}]": q * 1e3 if slides else np.degrees(q)
            for joint, slides, q in zip(robot.joints, robot.prismatic, poses.q.T, strict=True)
        }
        columns["force on the tool [N]"] = np.linalg.norm(poses.wrench[:, :3], axis=-1)
        if poses.time is not None:
            columns["time [h]"] = poses.time / 3600.0
        if poses.temperature is not None:
            columns["temperature [degC]"] = poses.temperature
        for label, values in columns.items():
            each = zip(poses.names, values.tolist(), strict=True)
            variables.setdefault(label, {}).update({(name, held): value for name, value in each})
    return {
        label: values
        for label, values in variables.items()
        if len(set(values.values())) > 1 and all(map(math.isfinite, values.values()))
    }


def _day(evidence: Evidence) -> dict[str, str]:
    """The day of the first pose, where the column time_s counts from 1970."""
    from datetime import UTC, datetime

    time = None if evidence.tables is None else evidence.tables[False].poses.time
    if time is None or not float(np.nanmin(time)) > _EPOCH:
        return {}
    return {"measured": datetime.fromtimestamp(float(np.nanmin(time)), UTC).date().isoformat()}
