"""The residual of each joint over cycles a turn, one above the other, with the lines found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.diagnose.record import SpectrumEntry, SpectrumLine
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST = 450.0  # cycles a turn
_SLOW = 3.0  # cycles a turn up to which no gear is meant
_LETTER = 6.8  # width of a letter, cycles a turn
_CLEAR = 1.5  # times the false alarm from which on words clear its line
_ASIDE = 7.0  # a label from its line, cycles a turn
_MOST_TICKS = 5
_LOWEST = 1.0  # standard deviations
_ALONE, _SHARED = replace(style.SERIES[0], color=style.INK), style.SERIES[1:]
_OCTAVE = 2.0  # a gear errs once and twice a turn of its fast side


@style.styled
def spectra(panels: Sequence[SpectrumEntry]) -> style.Picture:
    """A row for each joint, all on one scale; lines that may be of one type of gear look alike."""
    shared = families(panels)
    looks = {
        line: look for family, look in zip(shared, cycle(_SHARED), strict=False) for line in family
    }
    figure = style.sheet(style.PANEL, 1.3 + 1.0 * len(panels))
    axes = figure.subplots(len(panels), 1, sharex=True, sharey=True, squeeze=False).ravel()
    for i, (axis, panel) in enumerate(zip(axes, panels, strict=True)):
        _draw(axis, panel, [looks.get((i, k), _ALONE) for k in range(len(panel.lines))])
    axes[0].set(xlim=(0.0, _MOST), ylim=(_LOWEST, _highest(panels)))
    axes[0].set_yscale("log")
    axes[0].minorticks_off()
    ticks = [t for t in (1, 3, 10, 30, 100, 1000) if t < _highest(panels)]
    axes[0].set_yticks(ticks if len(ticks) < _MOST_TICKS else [t for t in ticks if t % 3])
    axes[0].yaxis.set_major_formatter("{x:g}")
    axes[-1].set_xlabel("cycles in a turn of the joint [1/turn]")
    figure.supylabel("ripple [standard deviations of the noise]", fontsize=10)
    style.legend_below(figure, _key(panels, shared))
    caption = (
        "By how many standard deviations of the noise a ripple of so many cycles a turn stands out at "
        "each joint, beside all else found; chance passes the dashed line in one such figure of a "
        "hundred, and lines of one colour agree or are 2:1, as those of one type of gear do."
    )
    header = (
        "joint", "cycles [1/turn]", "standard deviation [1/turn]", "amplitude [urad]",
        "gear ratio, if twice a turn", "gear ratio, if once", "or, at these poses, cycles [1/turn]",
    )  # fmt: skip
    lines = sum(len(panel.lines) for panel in panels)
    found = f"{lines} found" if lines else "none found"
    title = f"Errors that repeat within a turn of each joint: {found}"
    return style.Picture("spectra", title, caption, figure, header, tuple(_rows(panels)))


def families(panels: Sequence[SpectrumEntry]) -> list[frozenset[tuple[int, int]]]:
    """Lines, as (panel, mark), that agree between joints within their widths, or are 2:1."""
    lines = [(i, k) for i, panel in enumerate(panels) for k in range(len(panel.lines))]
    groups = [{line} for line in lines]
    for n, one in enumerate(lines):
        for other in lines[:n]:
            if one[0] != other[0] and _akin(panels, one, other):
                joined = [g for g in groups if one in g or other in g]
                groups = [g for g in groups if g not in joined] + [set().union(*joined)]
    shared = [frozenset(group) for group in groups if len(group) > 1]
    return sorted(shared, key=lambda group: min(group))


def _akin(panels: Sequence[SpectrumEntry], one: tuple[int, int], other: tuple[int, int]) -> bool:
    low, high = sorted(panels[i].lines[k].cycles for i, k in (one, other))
    within = 0.5 * (panels[one[0]].width_1_turn + panels[other[0]].width_1_turn)
    return high - low < within or abs(high - _OCTAVE * low) < within


def _draw(axis: Axes, panel: SpectrumEntry, own: Sequence[style.Look]) -> None:
    """One joint; own : the look of each of its lines."""
    style.tidy(axis, "none")
    alarm = panel.false_alarm**0.5
    fall = np.maximum(panel.fall, _LOWEST**2)
    axis.plot(panel.cycles_1_turn, np.sqrt(fall), color=style.SOFT, linewidth=0.7)
    axis.axhline(alarm, color=style.INK, linewidth=1.1, linestyle=style.DASHED)
    axis.set_title(style.elided(panel.joint), loc="left", pad=3.0)
    repeats = panel.repeats_1_turn
    if repeats is not None:
        text = f"steps of {360.0 / repeats:.3g} deg: repeats every {repeats:.3g} cycles"
        axis.set_title(text, loc="right", pad=3.0, fontsize=9, color=style.SOFT)
    places = _places(panel)
    for mark, look, place in zip(panel.lines, own, places, strict=True):
        top = mark.fall**0.5
        drawn: Any = {"color": look.color, "marker": look.marker, "markersize": 5.5}
        axis.plot([mark.cycles] * 2, [_LOWEST, top], color=look.color, linewidth=1.6, zorder=3)
        axis.plot([mark.cycles], [top], markeredgecolor="white", linestyle="", zorder=4, **drawn)
        if place is not None:
            at, side, text = place
            height = max(top, _CLEAR * alarm)
            words = axis.text(at, height, text, ha=side, va="center", color=style.INK, fontsize=9)
            words.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.85})


def _places(panel: SpectrumEntry) -> list[tuple[float, str, str] | None]:
    """Where the words of each line stand, the strongest first; None where there is no room."""
    taken = [(mark.cycles - 0.5 * _ASIDE, mark.cycles + 0.5 * _ASIDE) for mark in panel.lines]
    found: list[tuple[float, str, str] | None] = []
    for mark in panel.lines:
        found.append(None)
        for text in (_words(mark), f"{mark.cycles:.1f}"):
            length = _LETTER * len(text)
            for start, side in ((mark.cycles + _ASIDE, "left"), (mark.cycles - _ASIDE, "right")):
                low, high = sorted((start, start + (length if side == "left" else -length)))
                room = low >= 0.0 and high <= _MOST
                if room and all(high < a or low > b for a, b in taken):
                    taken.append((low, high))
                    found[-1] = (start, side, text)
                    break
            if found[-1] is not None:
                break
    return found


def _words(mark: SpectrumLine) -> str:
    """A line with the gear ratios that it would mean, or with what else it might be."""
    if mark.aliases:
        return f"{mark.cycles:.1f}, or {len(mark.aliases)} others"
    return f"{mark.cycles:.1f}: ratio {' or '.join(f'{ratio:.1f}' for ratio in mark.ratios)}"


def _highest(panels: Sequence[SpectrumEntry]) -> float:
    """What the lines and the false alarm need; what is slow may leave the panel."""
    tops = [panel.false_alarm for panel in panels]
    for p in panels:
        tops += [fall for c, fall in zip(p.cycles_1_turn, p.fall, strict=True) if c >= _SLOW]
    tops += [mark.fall for panel in panels for mark in panel.lines]
    return 1.6 * float(np.sqrt(max(tops)))


def _key(
    panels: Sequence[SpectrumEntry], shared: Sequence[frozenset[tuple[int, int]]]
) -> list[Any]:
    alarm: Any = {"color": style.INK, "linewidth": 1.1, "linestyle": style.DASHED}
    found = [style.line_key("chance passes it in 1 figure of 100", **alarm)]
    for family, look in zip(shared, cycle(_SHARED), strict=False):
        joints = ", ".join(style.elided(panels[i].joint) for i in sorted({i for i, _ in family}))
        found.append(_entry(look, f"lines that {joints} share"))
    if sum(len(panel.lines) for panel in panels) > sum(map(len, shared)):
        found.append(_entry(_ALONE, "line of one joint"))
    return found


def _entry(look: style.Look, label: str) -> Any:
    return style.line_key(label, color=look.color, marker=look.marker, linewidth=1.6)


def _rows(panels: Sequence[SpectrumEntry]) -> Iterator[tuple[style.Cell, ...]]:
    for panel in panels:
        for mark in panel.lines:
            others = ", ".join(f"{cycles:.1f}" for cycles in mark.aliases)
            yield (panel.joint, mark.cycles, mark.std, mark.amplitude_urad, *mark.ratios, others)
        if not panel.lines:
            yield (panel.joint, *[None] * 5, "")
