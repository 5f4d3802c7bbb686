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
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from studies.research.bench import Output, Row, bench, count, table
from studies.research.benchmarks.day import Setting, draw_day, write_day
from studies.research.benchmarks.mistakes.healthy import drawn, real
from studies.research.benchmarks.mistakes.table import MISTAKES, Mistake
from studies.research.command_line import heard

_POSES, _MARKERS = 40, 3
_BEGINS = ("warning:", "posecal:", "note ")
_FULL = 85  # characters of a line that was wrapped


def row_of(mistake: Mistake) -> Row:
    """Make the mistake in a fresh folder: the line about it, and whether what it must say is said."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_day(folder, draw_day(Setting(mistake.arm, 1e-5, 1, _POSES, _MARKERS), 1, 0))
        mistake.edit(folder)
        if mistake.before:
            heard(mistake.before, folder)
        status, out, err = heard(mistake.call, folder)
    text = " ".join(f"{err} {out}".split()).replace(f"{name}/", "")
    return {
        "did": mistake.did,
        "call": f"posecal {mistake.call}",
        "line": _line(err if status else f"{err}\n{out}", mistake.place),
        "status": status,
        "place": bool(re.search(mistake.place, text)),
        "remedy": bool(re.search(mistake.remedy, text)),
        "ended": bool(status) is mistake.refused and status in (0, 2),
    }


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


@bench(
    click.option("--only", default="", help="Mistakes whose name holds this."),
    count("--days", 240, least=0),
)
def main(days: int, only: str, seed: int) -> Output:
    """The line that each mistake gets, and how often a healthy day is called one."""
    rows = [row_of(own) for own in MISTAKES if only in own.did]
    right = sum(row["place"] and row["remedy"] and row["ended"] for row in rows)
    false = [(name, said) for name, said in (drawn(k, seed) for k in range(days)) if said]
    measured = list(real()) if days else []
    called = [(name, said) for name, said in measured if said]
    shown = [
        table(rows),
        f"\nplace, remedy and status right: {right} of {len(rows)}",
        f"drawn healthy days called a mistake: {len(false)} of {days}",
        f"real tables called a mistake: {len(called)} of {len(measured)}",
        *(f"  {name}: {'; '.join(said)}" for name, said in [*false, *called]),
    ]
    return shown, {"mistakes": rows, "drawn": false, "real": measured}


if __name__ == "__main__":
    main()
