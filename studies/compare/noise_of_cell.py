"""How readings err by the numbers of a cell that was made without a text."""

from __future__ import annotations

from calib.cell import Cell, Repeatability
from calib.instruments import Instrument, Pose, Tracker
from studies.compare.noise_of_text import Alike, ByBeam, Errs, OfBody, StatedNoise


def noise_of(cell: Cell) -> StatedNoise:
    """How instruments and arm err by the numbers of a cell that has no text."""
    stands = {
        i.name: i.stands
        for i in cell.instruments
        if isinstance(i, Tracker) and i.stands is not None
    }
    arm = cell.repeatability or Repeatability(0.0, 0.0)
    errs = {i.name: _errs(i) for i in cell.instruments}
    return StatedNoise(errs, stands, (arm.translation, arm.rotation))


def _errs(instrument: Instrument) -> Errs:
    match instrument:
        case Pose():
            return OfBody(instrument.covariance)
        case Tracker(noise=own):
            return ByBeam((own.along, own.along_per_m), (own.across, own.across_per_m))
    sigma: float = getattr(instrument, "sigma")  # noqa: B009 - of every other kind
    return Alike(sigma)
