"""An MJCF and a file that it may include."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.files.mjcf import load_mjcf
from tests.fuzz.reader import PART, parts, put
from tests.trees import random_mjcf


def mjcf(folder: Path, content: bytes) -> object:
    """Read the chain."""
    main, other = parts(content, 2)
    path = put(folder, "arm.xml", main)
    put(folder, "part.xml", other)
    return load_mjcf(path, "base", "tip")


_OUTER = """\
<mujoco><include file="part.xml"/>
  <worldbody><body name="base"><include file="./part.xml"/><joint name="j0"/><geom size="0.1"/>
    <body name="tip"><joint name="j1"/><geom type="box" size="0.1 0.1 0.1"/></body></body></worldbody>
</mujoco>
"""
_INNER = (
    '<mujocoinclude><option timestep="0.01"/><default><geom density="9"/></default></mujocoinclude>'
)

MJCF = (
    _OUTER.replace('<include file="./part.xml"/>', "") + PART + _INNER,
    *(
        random_mjcf(np.random.default_rng(i), 3, tip) + PART
        for i, tip in ((1, "site"), (2, "link"))
    ),
)
