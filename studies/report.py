"""The report: one page that names nothing outside itself, of results and their unchanged inputs."""

from __future__ import annotations

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
"""Kinds in the order in which the page shows them; the first that is there is shown open."""
_DRAWN = ("diagnose",)  # beside the first: figures take most of the time and of the size
_ADVISES = ("diagnose", "identify", "compensate", "enough", "design")
_COLOURS = {
    style.INK: "var(--ink)",
    style.SOFT: "var(--soft)",
    style.DIM: "var(--dim)",
    style.FAINT: "var(--faint)",
}
_EPOCH = 1e9  # s: times beyond count from 1970


@dataclass(frozen=True, eq=False)
class Reported:
    """A result by its name, and its inputs, the cell first."""

    name: str
    result: Result
    inputs: tuple[Input, ...] = ()

    @classmethod
    def read(cls, path: Path) -> Reported:
        """The result in a file. Raises InputError."""
        result = read(path)
        inputs = tuple(located(path, entry.file, entry.sha256) for entry in result.inputs)
        return cls(path.name, result, inputs)


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


@dataclass(frozen=True)
class Page:
    """A page as HTML, and notes on what had to be left out of it."""

    html: str
    notes: tuple[str, ...] = ()

    def write(self, path: Path | str) -> None:
        """Write the page to a file. Raises InputError."""
        from calib.files.write import write_files

        write_files({Path(path): self.html})

    def _repr_html_(self) -> str:
        return self.html


def page_of(reported: Sequence[Reported], title: str | None, about: Mapping[str, str]) -> Page:
    """The page of results.

    title : None for the name of the cell; about : what the user says of the measurement, by label
    """
    every = sorted(reported, key=lambda item: _place(item.result.kind))
    first: Reported = next((item for item in every if item.result.error is not None), every[0])
    of_cell = [item for item in every if item.result.of_one_cell]
    evidence = evidence_of(first if first in of_cell else next(iter(of_cell), first))
    notes, draw = (*evidence.notes, *_mixed(of_cell)), partial(_inline, count(1))
    shown = []
    for item in every:
        text = render.markdown(
            item.result,
            page=True,
            draw=draw if item is first or item.result.kind in _DRAWN else None,
            variables=variables_of(evidence) if item is first else None,
        )
        answer, advice, body = map(render.html, render.parts(text))
        shown.append((item, _label(item, every), answer, advice, body))
    by_kind = {item.result.kind: advice for item, _, _, advice, _ in reversed(shown)}
    html = render.page_template().render(
        style=Markup((Path(__file__).parent / "templates" / "page.css").read_text("utf-8")),  # noqa: S704
        title=title or first.result.cell or "Calibration",
        about={**first.result.about, **_day(evidence), **about},
        first=first,
        error=first.result.error,
        advice=next((by_kind[kind] for kind in _ADVISES if kind in by_kind), ""),
        warnings=list(
            dict.fromkeys((*notes, *(w for item in every for w in item.result.warnings)))
        ),
        shown=shown,
        arm=_arm(evidence, draw),
        cell=evidence.cell,
        inputs={(one.file, one.sha256): one.state for item in every for one in item.inputs},
    )
    return Page(html, tuple(notes))


def _place(kind: str) -> int:
    return [*_LABELS].index(kind) if kind in _LABELS else len(_LABELS)


def _label(item: Reported, every: Sequence[Reported]) -> str:
    """What a result is called; with its name where there are several of its kind."""
    label = _LABELS.get(item.result.kind, item.result.kind)
    several = sum(one.result.kind == item.result.kind for one in every) > 1
    return f"{label}: {item.name}" if several else label


def _arm(evidence: Evidence, draw: render.Draw) -> Markup:
    """The arm at all poses, where they are known."""
    if evidence.cell is None or evidence.q is None:
        return Markup()
    from studies.figures import arm

    caption = "The nominal arm in its base frame, faintly at all poses, strongly at the first."
    return Markup(draw(arm(evidence.cell, evidence.q), "arm", caption))  # noqa: S704


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


def _mixed(every: Sequence[Reported]) -> Iterator[str]:
    """Files that are not the same in all results."""
    known: dict[str, tuple[str, str]] = {}
    for item in every:
        for entry in item.inputs:
            name = Path(entry.file).name
            digest, first = known.setdefault(name, (entry.sha256, item.name))
            if digest != entry.sha256:
                what = f"{name} is another file in {item.name} than in {first}"
                yield f"{what}: their figures do not belong together"


def evidence_of(item: Reported) -> Evidence:
    """The cell of a result and its tables, where these are unchanged."""
    from calib import load_cell, load_measurements

    if not item.inputs:
        return Evidence()
    source, result = item.inputs[0], item.result
    if source.path is None:
        what = f"{source.file} is {source.state}: the cell"
        return Evidence(notes=(f"{what}, its picture and what needs the robot are left out",))
    try:
        cell = load_cell(source.path)
        if result.kind == "design":
            return Evidence(cell, q=_joints(cell, item))
        if result.kind not in ("identify", "diagnose"):
            return Evidence(cell)
        holdout = getattr(result, "holdout", None)  # as the user gave it
        table, *others = item.inputs[1 + len(cell.robot_files) :]
        wanted = {False: table}
        wanted |= {True: one for one in others if one.file == holdout}  # noqa: B035
        lost = [one for one in wanted.values() if one.path is None]
        if lost:
            what = ": figures that need it are left out"
            return Evidence(cell, notes=tuple(f"{one.file} is {one.state}{what}" for one in lost))
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
        raise InputError(item.name, "poses", "name other joints than the cell", joints)
    scale = np.where(robot.prismatic, 1e-3, np.pi / 180.0)
    return np.array([[row[joint] for joint in robot.joints] for row in values]) * scale


def variables_of(evidence: Evidence) -> dict[str, dict[tuple[str, bool], float]] | None:
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
        if len(set(values.values())) > 1 and np.isfinite([*values.values()]).all()
    }


def _day(evidence: Evidence) -> dict[str, str]:
    """The day of the first pose, where the column time_s counts from 1970."""
    from datetime import UTC, datetime

    time = None if evidence.tables is None else evidence.tables[False].poses.time
    if time is None or not float(np.nanmin(time)) > _EPOCH:
        return {}
    return {"measured": datetime.fromtimestamp(float(np.nanmin(time)), UTC).date().isoformat()}
