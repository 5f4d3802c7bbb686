"""Commands and options that posecal does not have, though one may look for them, and what to use."""

from __future__ import annotations

import re

INSTEAD: dict[str, str] = {
    "hand-eye": "call `posecal identify`: with a camera it gives the camera's place",
    "fleet": "call `posecal identify` for each robot in a shell loop",
    "--truth": "leave it out: readings are simulated by the model",
    "--values": "leave it out: a comparison holds at the nominal model",
    "--with": "call `posecal compare` once for each cell",
    "next": "use `posecal design CELL --extend DATA`, with `--discriminate A,B` to separate causes",
    "--next": "use `posecal design CELL --extend DATA --discriminate A,B`",
    "--figures": "read the tables: identify, diagnose, compare and design draw figures",
    "--reference-every": "visit poses again with `--reapproach N`",
    "--trend-free": "visit poses again with `--reapproach N`: they show a drift",
    "--load-blocks": "change the load at each pose",
    "--model": "take the URDF that the maker's ROS package writes from a UR's calibration.conf",
    "--polish": "leave it out: drawn candidates are polished, those of a table stay as they are",
    "--no-polish": "give the candidates as a table: they stay as they are",
    "--prove": "read the certified efficiency: the bound of the relaxation proves it",
    "--robust": "read what the loss of a pose costs, and ask for more poses with `--poses`",
    **dict.fromkeys(
        ("--names", "--marker", "--unit", "--columns", "--joint-names", "--unit-joints"),
        "give tables of pose, marker, x_mm .. and of pose, A1_deg ..",
    ),
    **dict.fromkeys(("--by-order", "--partial"), "give both tables the same poses"),
    **dict.fromkeys(
        ("--board", "--page", "--topic", "--moving", "--eye"),
        "write readings as rows: see `posecal explain columns`",
    ),
    "--calibration": "take the lens from `lenses` of --json, and write it by cv2.FileStorage",
    **dict.fromkeys(
        ("--mjcf", "--dh", "--dh-convention", "--kinematics"), "write the robot as URDF by `--urdf`"
    ),
    "--counts-per-deg": "multiply the offsets of `--zero-offsets` by the encoder's counts per degree",
    "--differences": "leave it out: free and loaded readings identify compliances beside geometry",
    "iso9283": "give `posecal identify` a --holdout: it states the error at poses of their own",
}
"""Command or option -> what to use in its place."""


def remedy(message: str) -> str | None:
    """What to use, where a message of click's says that there is no such command or option."""
    named = re.search(r"No such (?:command|option):? '?([\w-]+)", message)
    return None if named is None else INSTEAD.get(named[1])
