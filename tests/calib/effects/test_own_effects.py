"""An effect of the user's own, in an installed package of theirs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import ClassVar

import pytest

import calib
from calib import effects, plugins
from calib.arrays import Array
from calib.effects.joint import DriveError
from calib.effects.protocol import Unknown
from calib.errors import CalibError
from calib.poses import Poses
from tests.calib.diagnosis.test_diagnose import measured


@dataclass(frozen=True, eq=False)
class WarmEncoder(DriveError):
    """A joint's zero that follows the temperature."""

    kind: ClassVar[str] = "warm_encoder"
    uses: ClassVar[tuple[str, ...]] = ("temperature",)
    unknowns: ClassVar[tuple[Unknown, ...]] = (("slope", "urad/K", 1e-5),)

    def shares(self, poses: Poses) -> Array:
        return poses.warming[:, None]


@pytest.fixture
def announced(monkeypatch: pytest.MonkeyPatch) -> None:
    _announce(monkeypatch, "warm_encoder", f"{__name__}:WarmEncoder")


def _announce(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    def found(group: str) -> list[EntryPoint]:
        return [EntryPoint(name, value, group)]

    monkeypatch.setattr(plugins, "entry_points", found)
    effects.catalogue.cache_clear()


@pytest.fixture(autouse=True)
def _forget() -> Iterator[None]:
    yield
    effects.catalogue.cache_clear()


@pytest.mark.long
@pytest.mark.usefixtures("announced")
def test_it_is_identified_and_diagnosed_by_its_name() -> None:
    cell, data, _ = measured("warm_encoder:A3", [20e-6], seed=3)
    found = calib.diagnose(cell, data)
    (cause,) = found.causes
    assert (cause.named.candidate.key, found.verdict) == ("warm_encoder:A3", "explained")
    assert cause.named.candidate.depends_on == "temperature"
    assert abs(cause.values[0] - 20e-6) < 4.0 * cause.std[0]


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("backlash", f"{__name__}:WarmEncoder", "is taken"),
        ("warm", f"{__name__}:nothing", "fails to load"),
        ("warm", "pathlib:Path", "no subclass"),
        ("warm", f"{__name__}:WarmEncoder", "calls itself"),
    ],
)
def test_what_is_no_effect_is_refused(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, words: str
) -> None:
    _announce(monkeypatch, name, value)
    with pytest.raises(CalibError, match=words):
        effects.catalogue()
