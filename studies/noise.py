"""The noise of a result, level by level, and what is systematic: its entry, and how both are told."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Literal

from studies.document import FOUR, MM, mm
from studies.record import Entry, MaybePositive, NotNegative, Owner, Positive

if TYPE_CHECKING:
    from calib.identification.noise import NoiseLevel
    from calib.model import Model
    from calib.scatter import Scatter, VarianceEstimate

_COUNTS = 0.5  # of what is expected: less hides beside the rest
_HEARD = 0.1  # of the stated noise
_SAME = 1e-3  # of the stated noise
_MM, _URAD = 1e3, 1e6


class NoiseScale(Entry):
    """An instrument of several whose noise is so many times the stated one."""

    instrument: str
    times: Positive


class NoiseEntry(Entry):
    """Standard deviations of a coordinate of the tip, or of a component of its rotation.

    ``repeatability`` is new at each approach, ``configuration`` differs from pose to pose and comes
    again at the same joints; None where the data cannot tell. Without poses that were approached again,
    and without a figure in the cell, configuration holds both.

    configuration_of : whose it is (:mod:`calib.scatter.owner`); None where nobody judged it
    usual_mm : between what arms of this size repeat by data sheets
    pixel_mm : of a pixel at the points read, where no reading is a length; lengths are then those of
        pixels at the points
    noise_scales : of several instruments those whose noise is other than the cell states
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

    @property
    def scatters(self) -> bool:
        """Whether the arm errs beside the instrument."""
        return any(
            (
                self.repeatability_mm,
                self.repeatability_urad,
                self.configuration_mm,
                self.configuration_urad,
            )
        )

    @property
    def lacks(self) -> bool:
        """Whether more is left than the instrument's noise as stated: the diagnosis may know why."""
        return self.louder or self.scatters

    @property
    def louder(self) -> bool:
        """Whether the residual is larger than the noise as stated."""
        return self.source == "residual" and self.sigma_mm > self.believed_sigma_mm

    @property
    def missing(self) -> bool:
        """Whether the residual speaks for something that the model lacks, and not for who reads."""
        alone = self.louder and not self.scatters and not self.instrument_seen
        return self.configuration_of == "model" or alone

    @property
    def instrument_mm(self) -> float:
        """What residuals are held against.

        That of repeated readings where they tell it, else the instrument's as stated: what the
        residuals themselves say would make any of them look right.
        """
        told = self.sigma_mm if self.source != "residual" else 0.0
        return told or self.believed_sigma_mm


def noise_fields(
    noise: NoiseLevel,
    levels: VarianceEstimate | None,
    scatter: Scatter | None,
    model: Model,
    footprint: float,
) -> dict[str, Any]:
    """What an identification or a diagnosis found, level by level, as fields of :class:`NoiseEntry`.

    footprint : m, to one unit of the readings (:meth:`calib.model.Model.footprint`)
    """
    from calib.cell import Repeatability
    from calib.scatter.owner import pose_to_pose

    found = pose_to_pose(levels, scatter, model.robot.reach)
    fixed = found.rest
    if fixed is None and levels is not None and scatter is not None:
        fixed = Repeatability(0.0, 0.0)
    shown: dict[str, Any] = {}
    for name, own in (("repeatability", found.arm), ("configuration", fixed)):
        shown[f"{name}_mm"] = None if own is None else own.translation * _MM
        shown[f"{name}_urad"] = None if own is None else own.rotation * _URAD
    told = noise.source == "cell" and noise.stated != noise.believed
    return {
        **shown,
        "sigma_mm": noise.sigma * footprint * _MM,
        "believed_sigma_mm": noise.stated * footprint * _MM,
        "source": "residual" if told else noise.source,
        "noise_scales": [
            {"instrument": name, "times": s * noise.factor}
            for name, s in model.noise_scales.items()
        ],
        "pixel_mm": pixel_mm(model, footprint),
        "instrument_seen": scatter is not None and levels is not None and levels.instrument_seen,
        "configuration_of": found.of,
        "usual_mm": (found.usual.best * _MM, found.usual.worst * _MM),
    }


def pixel_mm(model: Model, footprint: float) -> float | None:
    """Millimetres of a pixel at the points read; None beside any length.

    footprint : m, to one unit of the readings (:meth:`calib.model.Model.footprint`)
    """
    return None if model.readout.channels.metric else footprint * _MM


def in_its_unit(sigma_mm: float, pixel_mm: float | None) -> str:
    """A deviation in the unit that the instrument reads, and what that is at the points."""
    if pixel_mm is None:
        return mm(sigma_mm)
    return f"{FOUR(sigma_mm / pixel_mm)} px ({mm(sigma_mm)} at the points)"


def noise_words(noise: NoiseEntry) -> list[str]:
    """Lines on the noise of a result."""
    each = [
        f"noise of {own.instrument}: {own.times:.1f} times as stated"
        for own in noise.noise_scales
        if abs(own.times - 1.0) >= _HEARD
    ]
    return [_instrument(noise), *each, *_arm(noise), *_untold(noise)]


def _instrument(noise: NoiseEntry) -> str:
    sigma = in_its_unit(noise.sigma_mm, noise.pixel_mm)
    pixel = noise.pixel_mm
    believed = (
        MM(noise.believed_sigma_mm)
        if pixel is None
        else f"{FOUR(noise.believed_sigma_mm / pixel)} px"
    )
    stated = f"the cell states {believed}"
    if not noise.scatters:
        source = {
            "cell": "as the cell states",
            "replicates": f"from repeated readings; {stated}",
            "residual": f"from what is left; {stated}",
        }[noise.source]
        return f"{sigma} in each coordinate, {source}"
    same = abs(noise.sigma_mm - noise.believed_sigma_mm) <= _SAME * noise.believed_sigma_mm
    source = "as the cell states" if same else stated
    return f"instrument {sigma} in each coordinate ({source})"


def _arm(noise: NoiseEntry) -> Iterator[str]:
    if not noise.scatters:
        return
    again = noise.repeatability_mm is not None
    if again:
        both = _both(noise.repeatability_mm, noise.repeatability_urad)
        yield f"arm {both}, {'from visit to visit' if noise.missing else 'its repeatability'}"
    if noise.configuration_mm or noise.configuration_urad:
        of_model = again or noise.configuration_of == "model"
        what = (
            "which the model does not explain"
            if of_model
            else "of the arm, or of what the model lacks"
        )
        both = _both(noise.configuration_mm, noise.configuration_urad)
        yield f"{both} from pose to pose, {what}"
    if noise.configuration_of == "model" and not again and noise.usual_mm is not None:
        low, high = noise.usual_mm
        yield f"data sheets of arms of this size state {mm(low)} to {mm(high)} of repeatability"


def _both(moved_mm: float | None, turned_urad: float | None) -> str:
    parts = [mm(moved_mm)] if moved_mm else []
    parts += [f"{FOUR(turned_urad / 1e3)} mrad"] if turned_urad else []
    return " and ".join(parts or ["0 mm"])


def _untold(noise: NoiseEntry) -> Iterator[str]:
    """What these data cannot tell apart, where there is something to tell."""
    if noise.instrument_seen is None:
        return
    if not noise.instrument_seen and (noise.scatters or noise.louder):
        yield (
            "these data cannot tell the instrument from the arm. Measure more markers, or read poses "
            "twice"
        )
    elif noise.repeatability_mm is None and noise.configuration_mm and not noise.missing:
        yield "these data cannot tell the arm from the model. Visit some poses again"


def counts(lacking_mm: float, expected_mm: float | None) -> bool:
    """Whether what the model lacks is worth a sentence."""
    return lacking_mm > _COUNTS * (expected_mm or 0.0)


def lacks(lacking_mm: float) -> str:
    """That the model errs systematically, and what to do; follows a colon."""
    return f"the model has a systematic error of {mm(lacking_mm)}. Run `posecal diagnose`"


def undecided(scatter_mm: float) -> str:
    """That arm and model are not told apart, and what to do."""
    return (
        f"{mm(scatter_mm)} from pose to pose come from the arm, or from what the model lacks. "
        "Visit some poses again to know, or run `posecal diagnose`"
    )


def unusual(noise: NoiseEntry) -> str | None:
    """That the arm comes back to a pose worse than arms do, and what to do; None where it does not.

    An error that depends on the load looks like that, where poses are read free and loaded.
    """
    again = noise.repeatability_mm
    if again is None or noise.usual_mm is None or noise.configuration_of != "arm":
        return None
    worst = noise.usual_mm[1]
    if again <= worst:
        return None
    return (
        f"Readings at one pose differ by {mm(again)}; data sheets say {mm(worst)}. "
        "Run `posecal diagnose`."
    )
