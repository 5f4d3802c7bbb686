"""``[robot]``: its file, ends, limits and shapes."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from calib.arm.robot import FORMS, Form
from calib.files.schema.values import NotNegative, Positive, Range, Table, Vector, plain


class CapsuleTable(Table):
    start: Vector = Field(alias="from")
    end: Vector = Field(alias="to")
    radius: Positive


class AnchorTable(Table):
    before: Vector
    after: Vector


class RobotTable(Table):
    urdf: str | None = None
    mjcf: str | None = None
    dh: str | None = None
    dh_convention: Literal["classic", "modified"] | None = None
    kinematics: str | None = None
    base: str = ""
    tip: str = ""
    repeatability_mm: NotNegative | None = None
    repeatability_urad: NotNegative | None = None
    limits_deg: dict[str, Range] = {}
    limits_mm: dict[str, Range] = {}
    capsules_mm: dict[str, list[CapsuleTable]] = {}
    compensators_mm: dict[str, AnchorTable] = {}
    gear_ratio: dict[str, Positive] = {}

    @model_validator(mode="after")
    def _one_file(self) -> Self:
        if len(self._files) != 1:
            raise ValueError(f"needs the robot's file, one of {', '.join(FORMS)}, and no second")
        if (self.dh is None) != (self.dh_convention is None):
            raise ValueError(
                "dh and dh_convention go together; write dh_convention = 'classic' or 'modified': the "
                "same numbers are another arm in the other"
            )
        for key in ("base", "tip"):
            if self.form in ("urdf", "mjcf") and not getattr(self, key):
                raise ValueError(
                    f"lacks {key}; name the {'first' if key == 'base' else 'last'} link or body"
                )
            if getattr(self, key):
                plain(getattr(self, key))
        return self

    @property
    def _files(self) -> dict[Form, str]:
        return {form: getattr(self, form) for form in FORMS if getattr(self, form) is not None}

    @property
    def form(self) -> Form:
        return next(iter(self._files))

    @property
    def file(self) -> str:
        return next(iter(self._files.values()))
