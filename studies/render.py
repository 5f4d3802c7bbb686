"""A result in words: its template as Markdown, for a terminal, for a page, and for files of figures.

A template, ``templates/<kind>.md.j2``, begins with the answer, in a paragraph or two, the last of them
what to do next. Pieces within ``folded`` are folded on a page and left out on a terminal. Every value
is escaped; a number needs a rule of rounding.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template, pass_context
from markupsafe import Markup, escape

if TYPE_CHECKING:
    from jinja2.runtime import Context
    from matplotlib.figure import Figure
    from rich.console import Console

    from studies.results.base import NotAsked, Result

Draw: TypeAlias = Callable[["Figure", str, str], str]
"""Figure, name, caption -> what stands in their place."""
_SPECIAL = re.compile(r"([\\`*_\[\]<>&|~#$!])")
_MOST_DIGITS = 12
_PLACES = 3  # of an effect, that are named one by one

# -- numbers -----------------------------------------------------------------------------------


def short(value: float | None, digits: int = 3) -> str:
    """A number of so many digits, without an exponent where it can be avoided; "-" for None.

    >>> short(1234.5), short(0.01234), short(3.0), short(None), short(0.0)
    ('1234', '0.0123', '3.00', '-', '0')
    """
    if value is None or not math.isfinite(value):
        return "-"
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if not -5 < size < 6:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(0, digits - 1 - size)}f}"


def mm(value: float | None) -> str:
    """A length; its RMS of a hundred points is known to three digits.

    >>> mm(0.01234), mm(None)
    ('0.0123 mm', 'open')
    """
    return "open" if value is None else f"{short(value)} mm"


def to_std(value: float | None, std: float | None) -> str:
    """A value to two digits of its standard deviation.

    >>> to_std(1.23456, 0.0123), to_std(1234.5678, None), to_std(17802.3, 6078.0)
    ('1.235', '1234.568', '17800')
    """
    if value is None:
        return "-"
    digits = 1 - math.floor(math.log10(std)) if std and std > 0.0 else 3
    return f"{round(value, digits):.{min(max(digits, 0), _MOST_DIGITS)}f}"


def share(value: float | None) -> str:
    """A part of a whole, in per cent; what is hardly there is not called nothing."""
    if value is not None and 0.0 < value < 0.005:
        return "< 1 %"
    return "-" if value is None else f"{100.0 * value:.0f} %"


def probability(value: float | None) -> str:
    """A probability to two digits after the point."""
    return "-" if value is None else f"{value:.2f}" if value >= 0.005 else "< 0.01"


def plural(count: int, what: str) -> str:
    """A number of things.

    >>> plural(1, "pose"), plural(3, "pose")
    ('1 pose', '3 poses')
    """
    return f"{count} {what}{'s' * (count != 1)}"


def listed(names: Sequence[str], most: int = 8) -> str:
    """Names with commas, the first few of many.

    >>> listed(["a", "b"]), listed(list("abcdefghij"), 3)
    ('a, b', 'a, b, c and 7 more')
    """
    if len(names) <= most:
        return ", ".join(names)
    return f"{', '.join(names[:most])} and {len(names) - most} more"


def both(parts: Sequence[str]) -> str:
    """Parts of a sentence: ``a, b and c``."""
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def by_reason(entries: Iterable[NotAsked]) -> list[tuple[str, str]]:
    """Reasons why causes were not asked, with these; many places of an effect by its name alone."""
    reasons: dict[str, dict[str, list[str]]] = {}
    for entry in entries:
        effect, _, where = entry.effect.partition(":")
        reason = entry.reason.partition(" cannot act: ")[2] or entry.reason
        reasons.setdefault(reason, {}).setdefault(effect, []).append(where)
    return [
        (
            reason,
            ", ".join(e if len(w) > _PLACES else f"{e}:{','.join(w)}" for e, w in effects.items()),
        )
        for reason, effects in reasons.items()
    ]


def code(text: str) -> Markup:
    """A command; what it names cannot end it."""
    return Markup(f"`{text.replace('`', '')}`")  # noqa: S704


# -- templates ---------------------------------------------------------------------------------


def plain(value: Any) -> Any:
    """A value within Markdown: names as they are, a number only by a rule."""
    if hasattr(value, "__html__"):
        return value
    if isinstance(value, float):
        raise TypeError(f"{value} stands in a template without a rule of rounding")
    text = "-" if value is None else re.sub(r"\s+", " ", str(value))
    return Markup(_SPECIAL.sub(r"\\\1", text))  # noqa: S704


@pass_context
def _folded(
    context: Context, title: str, caller: Callable[[], str], terminal: bool = False
) -> Markup:
    """A piece that a page folds; terminal : whether the terminal shows it."""
    if not context["page"]:
        return Markup(f"\n## {title}\n\n{caller()}\n") if terminal else Markup()  # noqa: S704
    inner = caller().strip()
    if not inner:
        return Markup()
    return Markup(f"\n<details><summary>{escape(title)}</summary>\n\n{inner}\n\n</details>\n")  # noqa: S704


@pass_context
def _figure(context: Context, name: str, *more: Any, caller: Callable[[], str]) -> Markup:
    """A figure by the name of its function, with its caption; nothing where nobody draws."""
    draw = context["draw"]
    if draw is None:
        return Markup()
    caption = " ".join(caller().split())
    drawn = getattr(import_module("studies.figures"), name)(context["r"], *more)
    return Markup() if drawn is None else Markup(f"\n{draw(drawn, name, caption)}\n")  # noqa: S704


@cache
def environment() -> Environment:
    """All templates; a name that is not defined is an error."""
    made = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        finalize=plain,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    rules = (short, mm, to_std, share, probability, plural, listed, both, by_reason, code)
    made.filters |= {rule.__name__: rule for rule in rules}
    made.globals |= {"folded": _folded, "figure": _figure}
    return made


def markdown(result: Result, *, page: bool = False, draw: Draw | None = None) -> str:
    """A result as Markdown.

    page : whether everything is said, also what is folded there
    draw : figure, name, caption -> what stands in their place; None draws nothing
    """
    template = environment().get_template(f"{result.kind}.md.j2")
    text = template.render(r=result, page=page, draw=draw)
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


def parts(text: str) -> tuple[str, str, str]:
    """The answer of a result, its last paragraph, which says what to do next, and all else."""
    head = re.split(r"^(?=[#|<-])", text, maxsplit=1, flags=re.MULTILINE)
    answer, _, advice = head[0].strip().rpartition("\n\n")
    return answer or advice, advice if answer else "", "".join(head[1:])


def figures(result: Result, folder: Path) -> dict[Path, str | bytes]:
    """Every figure of a result as SVG, by its file."""
    from studies.figures.style import svg

    files: dict[Path, str | bytes] = {}

    def draw(figure: Figure, name: str, caption: str) -> str:
        number = sum(path.stem.startswith(name) for path in files)
        stem = f"{name}_{number + 1}" if number else name
        files[folder / f"{stem}.svg"] = svg(figure, stem, caption)
        return ""

    markdown(result, page=True, draw=draw)
    return files


# -- targets -----------------------------------------------------------------------------------

_WIDTH = 100  # of lines in files, pipes and interpreters


def print_markdown(text: str, *, stderr: bool = False) -> None:
    """Print Markdown on standard output, or on standard error where that carries the JSON."""
    from rich.console import Console

    console = Console(stderr=stderr, highlight=False, markup=False, emoji=False)
    console.file.write(terminal(text, console))


def terminal(text: str, console: Console | None = None) -> str:
    """Markdown as a terminal shows it; without one as plain text."""
    from rich.console import Console, ConsoleOptions
    from rich.markdown import Markdown, TableElement

    class Folding(TableElement):
        """A table whose long names go on in the next line; none is cut."""

        def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Any]:
            for table in super().__rich_console__(console, options):
                for column in getattr(table, "columns", ()):
                    column.overflow = "fold"
                yield table

    class Document(Markdown):
        elements = {**Markdown.elements, "table_open": Folding}  # noqa: RUF012

    console = console or Console(file=io.StringIO(), highlight=False, markup=False, emoji=False)
    if not console.is_terminal:
        console.width = _WIDTH
    with console.capture() as held:
        console.print(Document(text, hyperlinks=False))
    lines = "\n".join(line.rstrip() for line in held.get().strip().splitlines())
    return re.sub(r"\n{3,}", "\n\n", lines) + "\n"


def page_template() -> Template:
    """The frame of a page."""
    return environment().overlay(finalize=None).get_template("page.html.j2")


def html(text: str) -> Markup:
    """Markdown as HTML; wide tables scroll in a box, and long names in them may break."""
    from markdown_it import MarkdownIt

    made = MarkdownIt("commonmark", {"html": True}).enable("table").render(text)
    box = '<div class="wide" tabindex="0" role="region" aria-label="table"><table>'
    made = made.replace(' style="text-align:left"', "").replace(
        ' style="text-align:right"', " class=r"
    )
    made = re.sub(
        r"(?<=<td>)[^<]+", lambda cell: re.sub("[_@:](?=[\\w-])", r"\g<0><wbr>", cell[0]), made
    )
    made = made.replace("<table>", box).replace("</table>", "</table></div>")
    return Markup(made)  # noqa: S704 - every value in it was escaped
