"""What makes a day of measurement hard, apart from its causes, and how often."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PAIRED = "paired"
READINGS = {"once": 1, "free and loaded": 2, "thrice": 3, PAIRED: 2}
"""Readings of one visit: thrice without a move between them, which shows the instrument alone; paired
is free and loaded with a hold-out always between the other readings."""
_VISITS = (0.45, 0.35, 0.20)  # shares of the first three
_POSES = {"once": (60, 150), "free and loaded": (40, 75), "thrice": (40, 50)}
_ONE_MARKER = (40, 80)


@dataclass(frozen=True)
class Conditions:
    """By default nothing makes a day hard.

    known_geometry : the model has no geometry and the truth none either
    weighs : link masses are in the URDF, and the links have them
    missing : a column that the files lack: time, temperature or approach
    range_noise : None, or whether the cell says that the noise grows with range: "said", "unsaid"
    visit : of ``READINGS``; one_marker : a single reflector
    background : fine gear ripples at all joints, each too small to be seen
    torques : the file shows measured joint torques; ratios_said : the cell gives the gear ratios
    grid : one joint stands at equal steps only
    """

    wrong_sigma: bool = False
    outliers: bool = False
    hidden: bool = False
    configurations: int = 45
    known_geometry: bool = False
    weighs: bool = True
    payload: bool = False
    missing: str | None = None
    range_noise: str | None = None
    visit: str = PAIRED
    one_marker: bool = False
    background: bool = False
    torques: bool = False
    ratios_said: bool = False
    grid: bool = False

    @property
    def columns(self) -> frozenset[str]:
        """Which of time, temperature and approach the files show."""
        return frozenset({"time", "temperature", "approach"} - {self.missing or ""})


def draw_conditions(rng: np.random.Generator) -> Conditions:
    """Those of the first families."""
    missing = str(rng.choice(["time", "temperature", "approach"]))
    return Conditions(
        wrong_sigma=rng.random() < 0.25,
        outliers=rng.random() < 0.15,
        hidden=rng.random() < 0.20,
        configurations=15 if rng.random() < 0.12 else 45,
        known_geometry=rng.random() < 0.15,
        weighs=rng.random() > 0.08,
        payload=rng.random() < 0.35,
        missing=missing if rng.random() < 0.15 else None,
        range_noise=_range_noise(rng, 0.85),
    )


def draw_real_conditions(rng: np.random.Generator) -> Conditions:
    """Those of arms as real ones are, each by itself in fixed shares."""
    visit = str(rng.choice(list(_POSES), p=_VISITS))
    one_marker = rng.random() < 0.12
    low, high = _ONE_MARKER if one_marker and visit == "once" else _POSES[visit]
    missing = (None, "time", "temperature", "approach")[
        int(rng.choice(4, p=[0.7, 0.2, 0.05, 0.05]))
    ]
    return Conditions(
        wrong_sigma=rng.random() < 0.10,
        outliers=rng.random() < 0.10,
        hidden=not one_marker and rng.random() < 0.15,
        configurations=int(rng.integers(low, high + 1)),
        known_geometry=rng.random() < 0.05,
        weighs=rng.random() > 0.10,
        payload=rng.random() < 0.35,
        missing=missing,
        range_noise=_range_noise(rng, 0.9),
        visit=visit,
        one_marker=one_marker,
        background=rng.random() < 0.5,
        torques=rng.random() < 0.3,
        ratios_said=rng.random() < 0.3,
        grid=rng.random() < 0.08,
    )


def _range_noise(rng: np.random.Generator, none: float) -> str | None:
    rest = (1.0 - none) / 2.0
    return (None, "said", "unsaid")[int(rng.choice(3, p=[none, rest, rest]))]
