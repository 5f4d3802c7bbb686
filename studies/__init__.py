"""studies: what a person runs, and the results that its commands write.

    import studies

    result = studies.result_of(cell, calib.identify(cell, data, heldout=0.3))
    print(result)
    studies.page(result).write("report.html")

The way of a result:

``command/<name>.py``
    Read, ask, ``call.deliver(result)``; only click is imported at its head. Shared options stand in
    ``command/options.py``, checks and delivery in ``command/call.py``.
``results/<name>.py``
    One frozen pydantic class for each object of the JSON, fields named with their unit, filled by
    keywords in ``of``, or by the names of its fields in ``from_object``. ``posecal schema`` and reading
    back follow.
``templates/<name>.md.j2``
    What it says, as Markdown: the answer, a paragraph with what to do next, sections. ``folded`` pieces
    are for the page; ``figure`` names a function of ``figures``, drawn where the target can show it.
``render.py``
    Rules of rounding, and Markdown on a terminal (rich) and in a page (markdown-it).

To add a field: one line in its class, and one where ``of`` fills it. To add a section: lines in the
template. To add a figure: its function, and a line in ``figures/__init__.py``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calib import Cell
    from studies.report import Page
    from studies.results.base import Result

__all__ = ["page", "result_of"]


def result_of(cell: Cell, found: Any, **more: Any) -> Result:
    """What ``calib`` or ``doe`` found in a cell, as the command of the same name states it.

    found : Identification, Diagnosis, Compensation, Design, Enough or PowerAnalysis
    more : keywords of the result's ``of``

    It prints as its command does; ``to_frame``, ``to_json`` and :func:`page` hand it on.
    Raises CalibError for another object.
    """
    from studies.kinds import kind_of, result_type
    from studies.results.base import envelope

    files = [path for path in (cell.path, *cell.robot_files) if path.is_file()]
    made_from = envelope(cell.name, files, about=cell.about)
    kind: Any = result_type(kind_of(found))
    result: Result = kind.of(found, cell, made_from, **more)
    return result


def page(*results: Result, title: str | None = None, **about: str) -> Page:
    """One page of results, to write or to look at; about : who, when and with what, by label."""
    from studies.report import Reported, page_of

    return page_of([Reported(own.kind, own) for own in results], title, about)
