"""The repeated readings as a short table: what moved, since when, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from calib.model import Model
from studies.tables import plain_table

_SHOWN = 2  # references whose readings are listed
_MODELLED = ("base_drift", "tracker_drift")


def drift_tables(model: Model, drift: dict[str, Any] | None) -> Iterator[RenderableType]:
    """Motion of the first references, their number, and the verdict; nothing without repeats."""
    if drift is None:
        return
    most = drift["references"][0]["readings"]
    shown = [one for one in drift["references"] if one["readings"] == most][:_SHOWN]
    yield Text("")
    yield _moved(shown)
    yield Text("\n".join(_verdict(model, drift)))


def _moved(references: list[dict[str, Any]]) -> Table:
    table = plain_table(
        ("\nread again", "left"),
        ("since\nfirst [h]", "right"),
        ("moved x, y, z\n[um]", "right"),
        ("std\n[um]", "right"),
        ("turned\n[urad]", "right"),
        ("std\n[urad]", "right"),
        ("distance\n[um]", "right"),
        ("\np", "right"),
    )
    for reference in references:
        table.add_row(f"{reference['pose']} first")
        for motion in reference["moved"]:
            turn, turn_std = motion["rotation_urad"], motion["rotation_std_urad"]
            table.add_row(
                f"{motion['pose']}{' largest' if motion['pose'] == reference['largest'] else ''}",
                "-" if motion["hours"] is None else f"{motion['hours']:.2f}",
                _three(motion["translation_um"]),
                _rms(motion["translation_std_um"]),
                "-" if turn is None else _three(turn),
                "-" if turn_std is None else _rms(turn_std),
                f"{motion['length_um']:.1f}",
                f"{motion['p_value']:.2g}",
            )
    return table


def _three(values: list[float]) -> str:
    return " ".join(f"{value:6.1f}" for value in values)


def _rms(values: list[float]) -> str:
    return f"{np.sqrt(np.mean(np.square(values))):.1f}"


def _verdict(model: Model, drift: dict[str, Any]) -> Iterator[str]:
    count, p = len(drift["references"]), drift["p_value"]
    of = f" ({count} repeated poses together)" if count > 1 else ""
    if drift["verdict"] == "steady":
        yield f"drift      none seen: p {p:.2g}{of}, the readings differ as their noise does"
    elif drift["verdict"] == "drift":
        yield f"drift      yes: p {drift['trend_p']:.2g} for a steady motion{of}"
    else:
        yield f"drift      no steady one, but the readings moved more than noise: p {p:.2g}{of}"
    if drift["verdict"] == "drift":
        for rate in drift["rates"]:
            yield (
                f"           {_three(rate['translation_um_per_h']).strip()} um/h and "
                f"{_three(rate['rotation_urad_per_h']).strip()} urad/h in station {rate['station']} "
                f"(std {_rms(rate['translation_std_um_per_h'])} and "
                f"{_rms(rate['rotation_std_urad_per_h'])})"
            )
    yield from (f"           {line}" for line in _advice(model, drift))


def _advice(model: Model, drift: dict[str, Any]) -> Iterator[str]:
    if drift["noise_factor"] != 1.0:
        yield f"single points scatter {drift['noise_factor']:.1f} times as much as the cell states"
    if drift["verdict"] == "steady":
        return
    if not drift["one_side"]:
        yield "joints came from different sides, so it may be backlash: come from one side each time"
    if drift["verdict"] == "moved":
        yield "the robot does not return, something was knocked or is loose, or readings are too few"
        yield "for a trend; if one row above stands out, measure again from there"
        return
    modelled = [e.kind for e in model.effects if e.kind in _MODELLED]
    if modelled:
        yield f"{modelled[0]} is in the model and takes it up as far as it is steady"
    elif not drift["rates"]:
        yield "add column time_s, and base_drift to [model] effects, or measure again once all is warm"
    else:
        yield "add base_drift to [model] effects (the instrument's drift looks alike), or measure"
        yield "again once all is warm; posecal diagnose says whether something else fits better"
