"""``posecal program``: what is written is read back and is the plan."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.errors import InputError
from studies.command.program import MOST_AXES, program_text
from tests.helpers import cell_of, random_robot
from tests.studies.command_line import paper_cell, run

EVIL = 'p"); halt() PTP {A1 0}; $OV_PRO=100 \\" &<>#\nHALT\r\nPTP {A1 0}\u2028\x7f\x1b[2J'
TARGET = {  # a line that drives, and the size of its numbers
    ".src": (r"^PTP \{(.*)\}$", np.pi / 180),
    ".script": (r"^  movej\(\[([^]]*)\]", 1.0),
    ".mod": (r"^    MoveAbsJ \[\[([^]]*)\],\[9E9", np.pi / 180),
    ".ls": (r"UT : 1,\n([^}]*)\n\};", np.pi / 180),
}


@pytest.mark.parametrize("ending", MOST_AXES)
def test_program_holds_the_plan(ending: str, tmp_path: Path) -> None:
    path = paper_cell(tmp_path)
    made = tmp_path / f"p{ending}"
    done = run("program", path, tmp_path / "plan.csv", "-o", made, "--json", tmp_path / "p.json")
    assert done.exit_code == 0, done.output
    cell = calib.load_cell(path)
    plan, text = calib.load_plan(cell, tmp_path / "plan.csv"), made.read_text()
    pattern, size = TARGET[ending]
    found = [re.findall(r"-?\d+\.\d+", own) for own in re.findall(pattern, text, flags=re.M)]
    np.testing.assert_allclose(size * np.array(found, float), plan.q, rtol=0, atol=1e-8)
    fields = json.loads((tmp_path / "p.json").read_text(), parse_constant=pytest.fail)
    assert fields["poses"] == list(plan.names)
    waits = len(re.findall(r"^HALT$|^  popup\(|^    Stop;$|^ *\d+:  PAUSE ;$", text, flags=re.M))
    assert waits == fields["stops"] == 2 * len(plan)  # free, and with the cell's load
    evil = replace(plan, names=(EVIL, *plan.names[1:]))
    plain, other = (program_text(ending, "p", cell, own, "plan.csv", []) for own in (plan, evil))
    assert other.isascii()
    code = [re.sub(r'"[^"]*"|[;#!] ?[A-Za-z].*', "", own).splitlines() for own in (plain, other)]
    if ending != ".ls":  # whose remarks are broken into lines
        assert other != plain
        assert code[0] == code[1]


@pytest.mark.parametrize("ending", MOST_AXES)
def test_chains_that_a_language_has_no_axes_for(ending: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rail = cell_of(random_robot(rng, 7, prismatic=[6]), np.zeros((1, 3)), ())
    plan = calib.load_plan(cell := calib.load_cell(paper_cell(tmp_path)), tmp_path / "plan.csv")
    if ending != ".script":
        longer = replace(plan, q=np.c_[0.0 * plan.q, np.full(len(plan), 0.25)])
        free = replace(rail.robot, limits=np.full((7, 2), [-9.0, 9.0]))
        assert "250.000000" in program_text(
            ending, "2", replace(rail, robot=free), longer, "plan.csv", []
        )
    for robot in (random_robot(rng, 5), random_robot(rng, 13), random_robot(rng, 6, prismatic=[0])):
        with pytest.raises(InputError, match="takes six joints that turn"):
            program_text(ending, "p", replace(rail, robot=robot), plan, "plan.csv", [])
    beyond = replace(plan, q=plan.q + 10.0)
    with pytest.raises(InputError, match="joint A1 is beyond its limits; take the pose out"):
        program_text(ending, "p", cell, beyond, "plan.csv", [])
