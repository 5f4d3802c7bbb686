"""An instrument of kind ``camera``: its lens and where it stands."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from calib.files.schema.markers import BodyTable
from calib.files.schema.values import Number, Positive, Table

Pixels = tuple[Positive, Positive]
Coefficients = tuple[Number, Number, Number, Number] | tuple[Number, Number, Number, Number, Number]


class IntrinsicsStd(Table):
    focal_px: Positive | None = None
    center_px: Positive | None = None
    distortion: Positive | Annotated[list[Positive], Field(min_length=4, max_length=5)] | None = (
        None
    )


class CameraTable(BodyTable):
    kind: Literal["camera"]
    on: Literal["world", "tip"] = "world"
    calibration: str | None = None  # a file in place of the next three
    focal_px: Positive | Pixels = 1.0
    center_px: tuple[Number, Number] = (0.0, 0.0)
    distortion: Coefficients = (0.0, 0.0, 0.0, 0.0, 0.0)
    image_px: Pixels | None = None
    sigma_px: Positive
    free: list[Literal["focal", "center", "distortion"]] = []
    intrinsics_std: (
        IntrinsicsStd | Annotated[list[Positive], Field(min_length=1, max_length=9)] | None
    ) = None  # in a list: fx, fy, cx, cy, k1, k2, p1, p2, k3

    @model_validator(mode="after")
    def _one_lens(self) -> Self:
        own = [k for k in ("focal_px", "center_px", "distortion") if k in self.model_fields_set]
        if self.calibration is not None and own:
            raise ValueError(f"has calibration and {own[0]}; keep one of them")
        for key in ("focal_px", "center_px"):
            if self.calibration is None and key not in own:
                raise ValueError(f"lacks {key}; add it, or calibration = a YAML of OpenCV or ROS")
        return self
