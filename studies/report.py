"""The report: one page that names nothing outside itself, of results and their unchanged inputs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path

from markupsafe import Markup, escape
from matplotlib.figure import Figure

from calib import Cell, load_cell
from calib.errors import CalibError
from calib.files.write import write_files
from studies import render
from studies.figures import arm, style
from studies.results.base import Result
from studies.results.parts import joint_array
from studies.results.read import Input, located, read

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


@dataclass(frozen=True)
class Page:
    """A page as HTML, and notes on what had to be left out of it."""

    html: str
    notes: tuple[str, ...] = ()

    def write(self, path: Path | str) -> None:
        """Write the page to a file. Raises InputError."""
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
    cell, notes = cell_of(first if first in of_cell else next(iter(of_cell), first))
    notes, draw = (*notes, *_mixed(of_cell)), partial(_inline, count(1))
    shown = []
    for item in every:
        text = render.markdown(
            item.result,
            page=True,
            draw=draw if item is first or item.result.kind in _DRAWN else None,
        )
        answer, advice, body = map(render.html, render.parts(text))
        shown.append((item, _label(item, every), answer, advice, body))
    by_kind = {item.result.kind: advice for item, _, _, advice, _ in reversed(shown)}
    html = render.page_template().render(
        style=Markup((Path(__file__).parent / "templates" / "page.css").read_text("utf-8")),  # noqa: S704
        title=title or first.result.cell or "Calibration",
        about={**first.result.about, **about},
        first=first,
        error=first.result.error,
        advice=next((by_kind[kind] for kind in _ADVISES if kind in by_kind), ""),
        warnings=list(
            dict.fromkeys((*notes, *(w for item in every for w in item.result.warnings)))
        ),
        shown=shown,
        arm=_arm(cell, first.result, draw),
        cell=cell,
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


def _arm(cell: Cell | None, result: Result, draw: render.Draw) -> Markup:
    """The arm at all poses of a result that has some."""
    poses = getattr(result, "poses" if result.kind == "design" else "conditions", ())
    q = None if cell is None else joint_array(cell.robot, poses)
    if cell is None or q is None:
        return Markup()
    caption = "The nominal arm in its base frame, faintly at all poses, strongly at the first."
    return Markup(draw(arm(cell, q), "arm", caption))  # noqa: S704


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


def cell_of(item: Reported) -> tuple[Cell | None, tuple[str, ...]]:
    """The cell of a result, where it is unchanged, and what is left out without it."""
    if not item.inputs:
        return None, ()
    source = item.inputs[0]
    if source.path is None:
        return None, (f"{source.file} is {source.state}: the picture of the arm is left out",)
    try:
        return load_cell(source.path), ()
    except CalibError as error:
        return None, (f"{error}: the picture of the arm is left out",)
