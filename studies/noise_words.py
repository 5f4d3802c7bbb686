"""The noise in words, level by level: the instrument, the arm, and what no model follows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from studies.tables import number

_SAME = 1e-3  # of the stated noise
UNFOLLOWED = (
    "the error differs from configuration to configuration and follows no column: too fine for these "
    "poses, as gear errors are; measure poses closer together, or give the gear ratios"
)
"""What ``arm`` that depends on ``pose`` means, and what to do."""


def noise_words(noise: Mapping[str, Any]) -> list[str]:
    """Lines on the noise of a result; results of earlier versions have one level only.

    Each figure is one standard deviation of a coordinate of the tip, or of a component of its rotation.
    """
    return [_instrument(noise), *_arm(noise), *_untold(noise)]


def scatters(noise: Mapping[str, Any]) -> bool:
    """Whether the arm errs beside the instrument."""
    return any(noise.get(key) for key in _KEYS)


def lacks(noise: Mapping[str, Any]) -> bool:
    """Whether more is left than the instrument's noise as stated: the diagnosis may know why."""
    return noise["source"] == "residual" or scatters(noise)


_KEYS = ("repeatability_mm", "repeatability_urad", "configuration_mm", "configuration_urad")


def _instrument(noise: Mapping[str, Any]) -> str:
    sigma, stated = noise["sigma_mm"], noise["believed_sigma_mm"]
    if not scatters(noise):
        source = {
            "cell": "as the cell states",
            "replicates": f"from repeated readings; the cell states {stated:.4f}",
            "residual": f"from what is left; the cell states {stated:.4f}",
        }[noise["source"]]
        return f"{sigma:.4f} mm in each coordinate, {source}"
    same = abs(sigma - stated) <= _SAME * stated
    source = "as the cell states" if same else f"the cell states {stated:.4f}"
    return f"instrument {sigma:.4f} mm in each coordinate ({source})"


def _arm(noise: Mapping[str, Any]) -> Iterator[str]:
    if not scatters(noise):
        return
    again = noise["repeatability_mm"] is not None
    if again:
        yield f"arm {_both(noise, 'repeatability')} from approach to approach"
    if noise["configuration_mm"] or noise["configuration_urad"]:
        what = "that no model follows" if again else "of the arm or of what the model lacks"
        yield f"{_both(noise, 'configuration')} from pose to pose {what}"


def _both(noise: Mapping[str, Any], level: str) -> str:
    moved, turned = noise[f"{level}_mm"], noise[f"{level}_urad"]
    parts = [f"{moved:.4f} mm"] if moved else []
    parts += [f"{number(turned / 1e3)} mrad"] if turned else []
    return " and ".join(parts or ["0 mm"])


def _untold(noise: Mapping[str, Any]) -> Iterator[str]:
    """What these data cannot tell apart, where there is something to tell."""
    if "instrument_seen" not in noise:
        return
    louder = noise["source"] == "residual" and noise["sigma_mm"] > noise["believed_sigma_mm"]
    if not noise["instrument_seen"] and (scatters(noise) or louder):
        yield (
            "these data cannot tell the instrument from the arm and the model: measure more markers, "
            "or read poses twice"
        )
    elif noise["repeatability_mm"] is None and noise["configuration_mm"]:
        yield "these data cannot tell the arm from the model: approach some poses again"
