"""How an instrument errs: at each reading by itself, and at all of them together."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from calib.files.schema.values import NotNegative, Number, Positive, Table


class PolarSigma(Table):
    range_mm: Positive
    transverse_mm: Positive
    range_mm_per_m: NotNegative = 0.0
    transverse_mm_per_m: NotNegative = 0.0


class MpeSigma(Table):
    mpe_mm: Positive
    mpe_mm_per_m: NotNegative = 0.0
    divisor: Positive


def _kind_of_sigma(value: Any) -> str:
    if isinstance(value, dict):
        return (
            "mpe"
            if any(str(key).startswith("mpe") or key == "divisor" for key in value)
            else "polar"
        )
    return "number"


Sigma = Annotated[
    Annotated[Positive, Tag("number")]
    | Annotated[PolarSigma, Tag("polar")]
    | Annotated[MpeSigma, Tag("mpe")],
    Discriminator(_kind_of_sigma),
]


DIVISORS = {"normal": 2.0, "rectangular": 3.0**0.5, "triangular": 6.0**0.5, "arcsine": 2.0**0.5}
"""By which a limit becomes one standard uncertainty (JCGM 100, 4.3); a normal one may have its own."""


class LimitTable(Table):
    limit: Positive
    distribution: Literal["normal", "rectangular", "triangular", "arcsine"] = "rectangular"
    divisor: Positive | None = None
    degrees_of_freedom: Annotated[Number, Field(ge=1)] | None = None

    @model_validator(mode="after")
    def _own_divisor(self) -> Self:
        if self.divisor is not None and self.distribution != "normal":
            raise ValueError(
                f"divisor of a {self.distribution} distribution is {DIVISORS[self.distribution]:.4g}; "
                "take it out, or write distribution = 'normal'"
            )
        return self


def _kind_of_common(value: Any) -> str:
    return "table" if isinstance(value, dict) else "number"


Uncertainty = Annotated[
    Annotated[NotNegative, Tag("number")] | Annotated[LimitTable, Tag("table")],
    Discriminator(_kind_of_common),
]
"""One standard uncertainty, or a limit with its distribution."""


class CommonTable(Table):
    scale_um_m: Uncertainty | None = None
    r0_um: Uncertainty | None = None
    transverse_um: Uncertainty | None = None
    transverse_um_m: Uncertainty | None = None
    eccentricity_urad: Uncertainty | None = None
    temperature_degC: Uncertainty | None = None  # noqa: N815
    pressure_hPa: Uncertainty | None = None  # noqa: N815
    level_urad: Uncertainty | None = None
