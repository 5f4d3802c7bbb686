"""The picture of ``benchmarks.few_poses``: held-out error over poses, one panel for each condition."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from studies.plots.style import SERIES, styled, tidy
from studies.research.benchmarks.few_poses.tables import errors_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = dict[str, Any]


@styled
def error_by_poses(rows: Sequence[Row]) -> Figure:
    """Mean error of each estimator; where it does not always answer it has no point."""
    from matplotlib.figure import Figure

    kinds = sorted({(r["times"], r["markers"]) for r in rows})
    ways = list(dict.fromkeys(way for r in rows for way in r["errors_m"]))
    figure = Figure(figsize=(9.0, 2.6 + 2.2 * ((len(kinds) + 1) // 2)), layout="constrained")
    panels = figure.subplots(
        (len(kinds) + 1) // 2, 2, squeeze=False, sharex=True, sharey=True
    ).ravel()
    for panel, (times, markers) in zip(panels, kinds, strict=False):
        own = [r for r in rows if (r["times"], r["markers"]) == (times, markers)]
        for look, way in zip(SERIES, ways, strict=False):
            points = []
            for poses in sorted({r["poses"] for r in own}):
                found = errors_of([r for r in own if r["poses"] == poses]).get(way)
                if found is not None and found["silent"] == 0:
                    points.append((poses, found["mean_mm"]))
            panel.plot(*zip(*points, strict=True), label=way, **look.line) if points else None
        told = f"{markers} marker{'s' * (markers > 1)}, errors {times:g} x usual"
        panel.set(title=told, xscale="log", yscale="log")
        panel.set_xticks(ticks := sorted({r["poses"] for r in rows}), [str(t) for t in ticks])
        panel.minorticks_off()
        panel.yaxis.set_major_formatter("{x:g}")
        tidy(panel)
    for panel in panels[::2]:
        panel.set_ylabel("held-out error, mean [mm]")
    for panel in panels[-2:]:
        panel.set_xlabel("poses that are fitted")
    lines = {line.get_label(): line for panel in panels for line in panel.get_lines()}
    figure.legend(list(lines.values()), list(map(str, lines)), loc="outside lower center", ncols=5)
    return figure
