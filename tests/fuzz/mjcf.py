"""An MJCF and a file that it may include."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.files.mjcf import load_mjcf
from tests.calib.mjcf_arms import random_mjcf
from tests.fuzz.reader import PART, parts, put


def mjcf(folder: Path, content: bytes) -> object:
    """Read the chain."""
    main, other = parts(content, 2)
    path = put(folder, "arm.xml", main)
    put(folder, "part.xml", other)
    return load_mjcf(path, "base", "tip")


_ARM = """\
<?xml version="1.0"?>
<!-- licence -->
<mujoco model="arm">
  <compiler angle="degree" autolimits="true" meshdir="meshes" eulerseq="XYZ"/>
  <default><default class="link"><joint axis="0 1 0" ref="5"/></default></default>
  <worldbody>
    <body name="base" childclass="link">
      <body name="a" pos="0 0 0.3" euler="0 10 0">
        <joint name="j1" axis="0 0 1" range="-90 90" actuatorfrcrange="-50 60"/>
        <geom size="0.1" mass="1"/><inertial pos="0 0 0.1" mass="2" diaginertia="1 1 1"/>
        <frame pos="0.1 0 0" axisangle="0 0 1 30">
          <body name="b" quat="1 0.1 0 0">
            <joint name="j2" pos="0 0 0.1"/><joint name="j3" type="slide" axis="1 0 0" range="0 1"/>
            <geom type="capsule" size="0.03 0.1" density="500"/>
            <body name="c" zaxis="0 1 1"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
            <site name="tip" pos="0 0 0.2" xyaxes="1 0 0 0 1 0"/>
          </body>
        </frame>
      </body>
    </body>
  </worldbody>
  <equality><weld body1="a" body2="b" active="false"/></equality>
  <actuator><motor joint="j1"/></actuator>
</mujoco>
"""
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
    _ARM + PART,
    _OUTER.replace('<include file="./part.xml"/>', "") + PART + _INNER,
    *(
        random_mjcf(np.random.default_rng(i), 3, tip) + PART
        for i, tip in ((1, "site"), (2, "link"))
    ),
)
