"""The figures of a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

from studies.diagnose.error_curve import error_curve
from studies.diagnose.spectra import spectra
from studies.diagnose.waterfall import waterfall
from studies.plots.style import Picture

if TYPE_CHECKING:
    from studies.diagnose.record import DiagnoseRecord


def pictures(record: DiagnoseRecord) -> Iterator[Callable[[], Picture]]:
    """How the error falls, the error of each place over what it depends on, and what repeats."""
    if record.steps is not None:
        yield partial(waterfall, record.steps, record.gap.floor_mm)
    yield from (partial(error_curve, curve) for curve in record.curves)
    if record.spectra:
        yield partial(spectra, record.spectra)
