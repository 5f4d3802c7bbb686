"""The line that each mistake of a person gets, and how often a healthy day is called one.

    python -m studies.research.benchmarks.mistakes [--days 240] [--only zero] [--json FILE]

Each mistake is made on the files of a good day (``benchmarks.day``, the truth is MuJoCo's) or of a
small robot, and what the command line then says is searched for the place and the remedy. A healthy day
has another truth, of numpy alone: any arm, few poses, one marker, a link 0.1 m off. It is asked as it
is, and again as if all its poses were far off, which no healthy day is. So are the real days of
POSECAL_DATA.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from calib.files.write import json_text, write_files
from studies.command.options import one_line_faults
from studies.research.benchmarks.day import Setting, draw_day, write_day
from studies.research.benchmarks.mistakes.drawn import Mistake, mistakes
from studies.research.benchmarks.mistakes.healthy import drawn, real
from studies.research.benchmarks.mistakes.heard import heard

_POSES, _MARKERS = 40, 3
_BEGINS = ("warning:", "posecal:", "note ")
_FULL = 85  # characters of a line that was wrapped


@dataclass(frozen=True)
class Row:
    """What one mistake was told.

    line : the words about it; place, remedy, ended : whether they are said, and the status is right
    """

    did: str
    call: str
    status: int
    line: str
    place: bool
    remedy: bool
    ended: bool


def row_of(mistake: Mistake) -> Row:
    """Make the mistake in a fresh folder, and hear."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_day(folder, draw_day(Setting(mistake.arm, 1e-5, 1, _POSES, _MARKERS), 1, 0))
        mistake.edit(folder)
        if mistake.before:
            heard(mistake.before, folder)
        said = heard(mistake.call, folder)
    text = said.text.replace(f"{name}/", "")
    return Row(
        mistake.did,
        f"posecal {mistake.call}",
        said.status,
        _line(said.err if said.status else f"{said.err}\n{said.out}", mistake.place),
        bool(re.search(mistake.place, text)),
        bool(re.search(mistake.remedy, text)),
        bool(said.status) is mistake.refused and said.status in (0, 2),
    )


def _line(text: str, place: str) -> str:
    """The paragraph that names the place, else the first one. Lines as long as the page go on."""
    parts: list[str] = []
    full = False
    for line in text.splitlines():
        if (full and not line.startswith(_BEGINS)) or line.startswith("  "):
            parts[-1:] = [f"{parts[-1] if parts else ''} {line.strip()}".strip()]
        else:
            parts.append(line.strip())
        full = len(line) > _FULL
    parts = [" ".join(part.split()) for part in parts if part]
    return next((own for own in parts if re.search(place, own)), (parts or [""])[0])


def _table(rows: list[Row]) -> Iterator[str]:
    yield "| what was done | said | status | place | remedy |"
    yield "|---|---|---|---|---|"
    for row in rows:
        line = row.line.replace("|", "/")
        marks = ["yes" if own else "no" for own in (row.place, row.remedy)]
        ended = f"{row.status}{'' if row.ended else ' (wrong)'}"
        yield f"| {row.did} | {line} | {ended} | {' | '.join(marks)} |"


@click.command(help=__doc__, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--days", type=click.IntRange(min=0), default=240, show_default=True)
@click.option("--only", default="", help="Mistakes whose name holds this.")
@click.option("--json", "json_path", type=click.Path(path_type=Path, dir_okay=False))
@one_line_faults
def main(days: int, only: str, json_path: Path | None) -> None:
    """Print the table and the counts."""
    rows = [row_of(own) for own in mistakes() if only in own.did]
    for line in _table(rows):
        click.echo(line)
    right = sum(row.place and row.remedy and row.ended for row in rows)
    click.echo(f"\nplace, remedy and status right: {right} of {len(rows)}")
    false = [(name, said) for name, said in map(drawn, range(days)) if said]
    measured = list(real()) if days else []
    click.echo(f"drawn healthy days called a mistake: {len(false)} of {days}")
    click.echo(
        f"real tables called a mistake: {sum(bool(s) for _, s in measured)} of {len(measured)}"
    )
    for name, said in [*false, *((n, s) for n, s in measured if s)]:
        click.echo(f"  {name}: {'; '.join(said)}")
    if json_path is not None:
        found = {"mistakes": [vars(row) for row in rows], "drawn": false, "real": measured}
        write_files({json_path: json_text(found)})


if __name__ == "__main__":
    main()
