"""The answer as a few lines and two short tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from studies.tables import number, plain_table

_WEAKEST = 5
_NAMED = 6
_SOURCES = {
    "cell": "as the cell states",
    "replicates": "from repeated readings",
    "residual": "from the residual of the data so far",
}


def enough_tables(fields: dict[str, Any]) -> Iterator[RenderableType]:
    """The answer first, then pose by pose, then the parameters that are known worst."""
    yield Text("\n".join([*_summary(fields), *_answer(fields)]))
    yield Text("")
    if fields["order"]:
        yield _order(fields)
        yield Text("")
    yield _weakest(fields)
    for name in fields["end"]["unidentifiable"][:_NAMED]:
        yield Text(f"open  {name}: stays so at these poses; posecal design plans some that tell it")


def _line(label: str, text: str) -> str:
    return f"{label:<10} {text}"


def _summary(fields: dict[str, Any]) -> Iterator[str]:
    plan, noise = fields["plan"], fields["noise"]
    if plan["poses"]:
        yield (
            f"{plan['measured']} of the plan's {plan['poses']} poses are measured, "
            f"{plan['to_measure']} are to come; {fields['now']['readings']} readings so far"
        )
    else:
        yield f"{fields['now']['readings']} readings, and no plan to go on with"
    yield _line(
        "noise", f"{noise['sigma_mm']:.4f} mm in each coordinate, {_SOURCES[noise['source']]}"
    )
    if fields["reason"]:
        yield _line("", f"no identification yet: {fields['reason']}")
    yield _line("now", _expected(fields["now"]) + f", at {fields['targets']}")
    yield from (_line("", text) for text in shares(fields))
    if fields["order"]:
        yield _line("plan's end", _expected(fields["end"]))


def shares(fields: dict[str, Any]) -> Iterator[str]:
    """What of the expected error more poses lower, and what not; nothing where all of it is lowered."""
    lacking = fields["lacking"]
    if not lacking["rms_mm"]:
        return
    parts = {"scatter_mm": "the arm's scatter", "unexplained_mm": "what the model lacks"}
    said = [f"{number(lacking[key])} mm {name}" for key, name in parts.items() if lacking[key]]
    yield (
        f"of it {number(fields['now']['from_parameters_mm'])} mm from the parameters, and "
        f"{' and '.join(said)}, which no more poses lower"
    )


def beyond_reach(lacking: dict[str, Any]) -> str:
    """Why no number of poses meets a goal, and what to do."""
    if lacking["scatter_mm"] >= lacking["unexplained_mm"]:
        return (
            f"the arm errs anew by {number(lacking['scatter_mm'])} mm wherever it goes; "
            "posecal diagnose tells whether a cause is behind it"
        )
    lacks = number(lacking["unexplained_mm"])
    return f"what the model lacks is {lacks} mm; posecal diagnose asks what it is"


def _expected(step: dict[str, Any]) -> str:
    lost = len(step["unidentifiable"])
    left = f", {lost} parameter{'s' * (lost > 1)} open" if lost else ""
    return (
        f"{number(step['task_rms_mm'])} mm RMS, {number(step['task_worst_mm'])} mm at worst expected"
        f"{left}"
    )


def _answer(fields: dict[str, Any]) -> Iterator[str]:
    order, goal = fields["order"], fields["goal_mm"]
    pays = fields["pays_until"]
    if goal is not None:
        yield from _goal(fields, f"{goal:g} mm: ")
    if pays is not None and order:
        yield _line(
            "pays",
            "more poses only average noise from here on"
            if not pays
            else f"each of the next {pays} does more than average noise"
            if pays < len(order)
            else "to the last: each of them does more than average noise",
        )


def _goal(fields: dict[str, Any], goal: str) -> Iterator[str]:
    needed, fresh, order = fields["poses_to_goal"], fields["fresh_poses_to_goal"], fields["order"]
    if needed == 0:
        yield _line(
            "goal",
            f"{goal}reached, you may stop now: 19 times in 20 the error is below "
            f"{number(fields['now']['task_most_mm'])} mm",
        )
    elif needed is not None:
        names = ", ".join(step["pose"] for step in order[:needed])
        yield _line("goal", f"{goal}after {needed} more: {names}")
    elif fresh is not None:
        yield _line(
            "goal", f"{goal}not by the end of the plan; with about {fresh} fresh poses more"
        )
        yield _line("", f"posecal design CELL --extend PLAN --poses {fresh} chooses them")
    elif fields["goal_beyond_reach"]:
        yield _line("goal", f"{goal}no number of poses reaches it")
        yield _line("", beyond_reach(fields["lacking"]))
    elif fields["fresh"]:
        tried = fields["fresh"][-1]
        yield _line(
            "goal",
            f"{goal}out of reach: {number(tried['task_most_mm'])} mm, 19 times in 20, with "
            f"{len(fields['fresh'])} fresh poses beyond the plan",
        )
        yield _line("", "less noise, more markers or a simpler model would help more than poses")
    else:
        yield _line(
            "goal",
            f"{goal}not by the end of the plan: 19 times in 20 the error is below "
            f"{number(fields['end']['task_most_mm'])} mm",
        )


def _order(fields: dict[str, Any]) -> Table:
    table = plain_table(
        ("\nmeasure next", "left"),
        ("task RMS\n[mm]", "right"),
        ("worst\n[mm]", "right"),
        ("19 in 20\nbelow", "right"),
        ("less by\n[%]", "right"),
        ("\nopen", "right"),
    )
    before = fields["now"]
    for k, step in enumerate(fields["order"], 1):
        less = 100.0 * (1.0 - step["task_rms_mm"] / before["task_rms_mm"])
        mark = " goal" if k == fields["poses_to_goal"] else ""
        table.add_row(
            step["pose"] + mark,
            number(step["task_rms_mm"]),
            number(step["task_worst_mm"]),
            number(step["task_most_mm"]),
            f"{less:.1f}",
            str(len(step["unidentifiable"])) if step["unidentifiable"] else "",
        )
        before = step
    return table


def _weakest(fields: dict[str, Any]) -> Table:
    """Robot parameters with the largest standard deviation against the size of such errors."""
    ends = [("plan's\nend", "right")] if fields["order"] else []
    table = plain_table(
        ("\nknown worst", "left"), ("standard\ndeviation", "right"), *ends, ("\nunit", "left")
    )
    both = zip(fields["now"]["parameters"], fields["end"]["parameters"], strict=True)
    robot = [(a, b) for a, b in both if a["effect"] not in ("base", "tool")]
    robot.sort(key=lambda pair: -1e9 if pair[0]["share"] is None else -pair[0]["share"])
    for now, end in robot[:_WEAKEST]:
        shown = (now, end)[: 1 + len(ends)]
        table.add_row(now["id"], *(_std(p["std"]) for p in shown), now["unit"])
    return table


def _std(value: float | None) -> str:
    return "open" if value is None else f"{value:.3g}"
