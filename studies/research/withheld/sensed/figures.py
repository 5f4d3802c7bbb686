"""What is asked of cases that other instruments read."""

from __future__ import annotations

from studies.research.withheld.figures import Figure, Questions, Test

DRAWN = "other instruments"
READERS = ("world camera", "tip camera", "pose", "distance", "socket")

_FIGURES: tuple[Figure, ...] = (
    ("null", None, "false alarms", lambda j: j.alarm, (0.0, 0.04)),
    *(
        own
        for family in ("single", "instrument")
        for own in (
            (family, True, "something found", lambda j: j.gap, None),
            (family, True, "named exactly", lambda j: j.exact, None),
            (family, True, "within its class", lambda j: j.found, (0.93, 1.0)),
            (family, True, "located", lambda j: j.located, (0.93, 1.0)),
            (family, True, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
        )
    ),
)
_AGAIN = (
    ("null", "false alarms"),
    ("single, visible", "within its class"),
    ("single, visible", "located"),
    ("instrument, visible", "within its class"),
    ("instrument, visible", "located"),
)


def _read_by(kind: str) -> Test:
    return lambda j: j.conditions["reader"] == kind


SENSED = Questions(
    _FIGURES,
    {kind: _read_by(kind) for kind in READERS},
    _AGAIN,
    ("single", "instrument"),
    (1.05, 1.2),
)
