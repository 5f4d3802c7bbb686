"""The noise of a result: of the instrument, of the arm, and what differs from pose to pose."""

from __future__ import annotations

from typing import Literal, Self

from calib.cell import Repeatability
from calib.identification.noise import NoiseLevel
from calib.identification.variances import VarianceEstimate
from calib.model import Model
from calib.observations.scatter import Scatter, pose_to_pose
from studies.results.base import (
    MICRO,
    MM,
    Entry,
    Maybe,
    MaybePositive,
    NotNegative,
    Owner,
    Positive,
)

_LOUD = 4.0  # times the stated noise: no instrument exceeds it by that much


class NoiseScale(Entry):
    """An instrument of several whose noise is so many times the stated one."""

    instrument: str
    times: Positive


class Noise(Entry):
    """Standard deviations of a coordinate of the tip, or of a component of its rotation.

    ``repeatability`` is new at each approach, ``configuration`` differs from pose to pose and comes
    again at the same joints; None where the data cannot tell. Without repeated approaches and without a
    figure in the cell, ``configuration`` holds both.

    configuration_of : whose it is (:mod:`calib.observations.scatter`); None where it was not judged
    usual_mm : best and worst repeatability that data sheets state of arms of this size
    pixel_mm : of a pixel at the points read, where no reading is a length
    noise_scales : of several instruments those whose noise is other than the cell states
    degrees_of_freedom : of what ``source`` names, None where the noise counts as known
    """

    sigma_mm: NotNegative
    believed_sigma_mm: Positive
    source: Literal["cell", "replicates", "residual"]
    repeatability_mm: NotNegative | None
    repeatability_urad: NotNegative | None
    configuration_mm: NotNegative | None
    configuration_urad: NotNegative | None
    instrument_seen: bool | None
    configuration_of: Owner | None
    usual_mm: tuple[NotNegative, NotNegative] | None
    pixel_mm: MaybePositive
    noise_scales: tuple[NoiseScale, ...]
    degrees_of_freedom: Maybe

    @classmethod
    def of(
        cls,
        noise: NoiseLevel,
        levels: VarianceEstimate | None,
        scatter: Scatter | None,
        model: Model,
        footprint: float,
    ) -> Self:
        """The noise of a fit.

        footprint : m, to one unit of the readings (:meth:`calib.model.Model.footprint`)
        """
        judged = pose_to_pose(levels, scatter, model.robot.reach)
        arm, rest = judged.arm, judged.rest
        if rest is None and levels is not None and scatter is not None:
            rest = Repeatability(0.0, 0.0)
        restated = noise.source == "cell" and noise.stated != noise.believed
        return cls(
            sigma_mm=noise.sigma * footprint * MM,
            believed_sigma_mm=noise.stated * footprint * MM,
            source="residual" if restated else noise.source,
            repeatability_mm=None if arm is None else arm.translation * MM,
            repeatability_urad=None if arm is None else arm.rotation * MICRO,
            configuration_mm=None if rest is None else rest.translation * MM,
            configuration_urad=None if rest is None else rest.rotation * MICRO,
            instrument_seen=scatter is not None and levels is not None and levels.instrument_seen,
            configuration_of=judged.of,
            usual_mm=(judged.usual.best * MM, judged.usual.worst * MM),
            pixel_mm=None if model.readout.channels.metric else footprint * MM,
            noise_scales=tuple(
                NoiseScale(instrument=name, times=scale * noise.factor)
                for name, scale in model.noise_scales.items()
            ),
            degrees_of_freedom=noise.dof,
        )

    @property
    def scatters(self) -> bool:
        """Whether the arm errs beside the instrument."""
        both = self.repeatability_mm or self.repeatability_urad
        return bool(both or self.configuration_mm or self.configuration_urad)

    @property
    def louder(self) -> bool:
        """Whether the residual is larger than the noise as stated."""
        return self.source == "residual" and self.sigma_mm > self.believed_sigma_mm

    @property
    def lacks(self) -> bool:
        """Whether more is left than the instrument's noise as stated."""
        return self.louder or self.scatters

    @property
    def missing(self) -> bool:
        """Whether the residual shows that the model lacks something."""
        alone = self.louder and not self.scatters and not self.instrument_seen
        return self.configuration_of == "model" or alone

    @property
    def instrument_mm(self) -> float:
        """What residuals are compared with: repeated readings, else the instrument as stated."""
        measured = self.sigma_mm if self.source != "residual" else 0.0
        return measured or self.believed_sigma_mm

    @property
    def unusual(self) -> bool:
        """Whether the arm comes back to a pose worse than the worst data sheet says."""
        if self.usual_mm is None or self.configuration_of != "arm":
            return False
        return (self.repeatability_mm or 0.0) > self.usual_mm[1]

    @property
    def loud(self) -> float | None:
        """How many times the stated noise is exceeded, where it is by far."""
        factor = self.sigma_mm / self.believed_sigma_mm
        return factor if factor >= _LOUD else None
