"""``[instrument]``, and ``[instruments.NAME]`` of every kind."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from calib.files.schema.camera import CameraTable
from calib.files.schema.noise import CommonTable, Sigma
from calib.files.schema.touching import DistanceTable, PlaneTable, SocketTable, SphereTable
from calib.files.schema.values import SMALLEST, Positive, Row, Table, Vector

_SYMMETRIC = 1e-6  # of the deviations


class InstrumentTable(Table):
    sigma_mm: Sigma
    position_mm: Vector | None = None
    common: CommonTable = CommonTable()


class PointsTable(InstrumentTable):
    kind: Literal["points"]


class PoseTable(Table):
    kind: Literal["pose"]
    sigma_mm: Positive | None = None
    sigma_urad: Positive | None = None
    covariance: tuple[Row, Row, Row, Row, Row, Row] | None = None  # mm and urad, body axes

    @model_validator(mode="after")
    def _one_noise(self) -> Self:
        stated = (self.sigma_mm is not None, self.sigma_urad is not None)
        if self.covariance is None and not all(stated):
            raise ValueError("needs its noise, sigma_mm and sigma_urad, or covariance")
        if self.covariance is not None:
            if any(stated):
                raise ValueError("has both sigma and covariance; keep one of them")
            _refuse_no_covariance(np.array(self.covariance))
        return self


def _refuse_no_covariance(C: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> None:
    size = np.sqrt(np.maximum(np.diag(C), 0.0))
    if not (size > 0.0).all():
        raise ValueError("covariance needs variances above zero on its diagonal")
    scaled = C / np.outer(size, size)
    if np.abs(scaled - scaled.T).max() > _SYMMETRIC:
        raise ValueError("covariance is not symmetric")
    if np.linalg.eigvalsh(scaled)[0] < SMALLEST:
        raise ValueError("covariance is not positive definite")


class AngleTable(Table):
    kind: Literal["angle"]
    sigma_urad: Positive


AnyInstrument = Annotated[
    PointsTable
    | PoseTable
    | CameraTable
    | AngleTable
    | DistanceTable
    | PlaneTable
    | SphereTable
    | SocketTable,
    Field(discriminator="kind"),
]


KINDS = frozenset({"points", "pose", "camera", "angle", "distance", "plane", "sphere", "socket"})
