"""How often sentences come true that the commands say to a user, over simulated days.

    python -m studies.research.benchmarks.claims [--days 20] [--only day] [--arm 6R] .. [--json FILE]

The truth is MuJoCo's (``benchmarks.day``); posecal sees files. A day of 60 poses has geometric errors,
a base anywhere, guessed markers, an instrument of 0.01 mm, and an arm that scatters by nothing or by
0.01 mm. Its first half is one day to the commands, its second half the next. On odd days the zero of
the third joint slips in between, by 10 to 100 urad.

What comes at 200 targets is where one fresh approach of each takes the arm, against the model. An
"alarm" is a change seen where there was none; a verdict of ``changes`` counts where it says one, with
a tolerance of 0.6 to 1.6 times what truly comes.

diagnosis: the gear of the third joint errs by 200 urad once a turn, that of the fifth by 2 to 60 urad.
"could hide" counts where nothing is said to be left: whether what comes is within what was named
there, beside the parameters' uncertainty.

lacking: the model lacks something: the base warms for an hour of readings and the targets come an hour
later (as the cell says, or untold); or a joint errs once a turn, or thirty to 120 times, or gives way
under weights that the cell does not know. "you may stop" is right where it is not said, or comes true
at the targets' time; "posecal diagnose" is counted as advice. On odd days each pose is approached
twice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import click
import numpy as np

from calib.files.write import json_text, write_files
from studies.command.deliver import console_for
from studies.command.options import one_line_faults
from studies.research.benchmarks.claimed import Said, said_by_diagnosis, said_in_a_day
from studies.research.benchmarks.day import ARMS
from studies.research.benchmarks.lacked import KINDS, said_where_something_lacks
from studies.research.withheld.figures import wilson
from studies.tables import plain_table

SENTENCES = {
    "design": "expected after measuring",
    "identify 95 %": "95 of 100 intervals hold the true value",
    "identify": "the parameters' uncertainty leaves .. elsewhere",
    "budget 95 %": "errors at the targets up to ..",
    "enough now": "expected now",
    "enough most": "19 times in 20 the error is below",
    "enough end": "expected at the plan's end",
    "compensate": "corrected commands are expected to miss by",
    "changes alarm": "nothing moved, where nothing did",
    "changes hidden": "what may hide in it is at most",
    "changes size": "something moved: .. (95 % interval)",
    "changes verdict": "holds, does not hold within a tolerance",
    "diagnose": "nothing is left; what could hide would leave",
}
_LACKING = {
    "most": "enough: 19 times in 20 the error is below",
    "stop": "enough: you may stop",
    "commands": "compensate: corrected commands are expected to miss by",
    "enough asks": "enough: run posecal diagnose",
    "compensate asks": "compensate: run posecal diagnose",
}
SENTENCES |= {
    f"lacking {kind} {key}": f"{kind}: {said}" for kind in KINDS for key, said in _LACKING.items()
}
_SCATTERS = (0.0, 0.01)  # mm


PARTS: dict[str, Callable[..., list[Said]]] = {
    "day": said_in_a_day,
    "diagnosis": said_by_diagnosis,
    "lacking": said_where_something_lacks,
}


def summaries(found: Sequence[Said]) -> dict[str, dict[str, Any]]:
    """Of each sentence: on how many days, how often right, and what came over what was promised."""
    own = {key: [s for s in found if s.sentence == key] for key in SENTENCES}
    return {key: _summary(said) for key, said in own.items() if said}


def _summary(said: Sequence[Said]) -> dict[str, Any]:
    judged = [s.right for s in said if s.right is not None]
    ratios = [s.came / s.promised for s in said if s.promised and s.came is not None]
    return {
        "days": len(said),
        "right": sum(judged) if judged else None,
        "ci95": wilson(sum(judged), len(judged)) if judged else None,
        "came_over_promised": float(np.sqrt(np.mean(np.square(ratios)))) if ratios else None,
    }


def _shown(key: str, own: dict[str, Any]) -> list[str]:
    right = "" if own["right"] is None else f"{own['right']} of {own['days']}"
    low, high = own["ci95"] or (0.0, 0.0)
    ratio = own["came_over_promised"]
    return [
        key.split()[0],
        SENTENCES[key],
        str(own["days"]),
        right,
        f"{100 * low:.0f} to {100 * high:.0f}" if right else "",
        "" if ratio is None else f"{ratio:.2f}",
    ]


@click.command()
@click.option("--days", type=click.IntRange(min=1), default=20, show_default=True,
              help="Days of each arm and scatter.")  # fmt: skip
@click.option("--only", multiple=True, type=click.Choice(list(PARTS)), default=tuple(PARTS),
              show_default=True)  # fmt: skip
@click.option("--arm", multiple=True, type=click.Choice(list(ARMS)), default=("6R", "7R"),
              show_default=True)  # fmt: skip
@click.option("--scatter", multiple=True, type=float, default=_SCATTERS, show_default=True,
              help="Of the arm, mm.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="All that was said.")
@one_line_faults
def main(
    days: int,
    only: tuple[str, ...],
    arm: tuple[str, ...],
    scatter: tuple[float, ...],
    seed: int,
    json_path: Path | None,
) -> None:
    """Simulate days and count which sentences came true."""
    found = [
        said
        for part, one, size in product(only, arm, scatter)
        for index in range(days)
        for said in partial(PARTS[part], seed=seed)(one, size * 1e-3, index)
    ]
    table = plain_table(
        ("command", "left"), ("says", "left"), ("days", "right"), ("came true", "right"),
        ("95 % [%]", "right"), ("came /\npromised", "right"),
    )  # fmt: skip
    told = summaries(found)
    for key, own in told.items():
        table.add_row(*_shown(key, own))
    console_for(None).print(table)
    if json_path is not None:
        rows = [asdict(said) for said in found]
        write_files({json_path: json_text({"seed": seed, "summaries": told, "said": rows})})


if __name__ == "__main__":
    main()
