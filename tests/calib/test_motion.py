"""Motions: the regressor against MuJoCo, terms of the torque that MuJoCo put in, and real arms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import calib
from calib import Cell
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.errors import CalibError, InputError
from calib.files.motions import holds_motions, load_motions
from calib.motion.diagnose import MotionDiagnosis, TorqueGap, diagnose_motions
from calib.motion.effects import KINDS, JointMotion, presliding
from calib.motion.filtering import filtered
from calib.motion.motions import Motions, Run
from calib.motion.regressor import nominal_inertials, regressor
from studies.results.motion import MotionResult
from tests.helpers import MADE_FROM

ARM = """<mujoco model="arm"><option gravity="0.3 -0.2 -9.7"/><worldbody><body name="base">
<body name="a" pos="0 0 .3"><joint name="j1" axis="0 0 1" {j1}/>
<inertial pos=".02 .01 .1" mass="8" diaginertia=".1 .12 .08" euler="10 20 30"/>
<body name="b" pos=".1 0 .1" euler="90 0 0"><joint name="j2" axis="0 0 1" {j2}/>
<inertial pos=".2 .01 0" mass="{mass}" diaginertia=".05 .2 .2"/>
<body name="c" pos=".4 0 0"><joint name="j3" type="{third}" axis="1 0 0" {j3}/>
<inertial pos=".1 .03 .02" mass="3" diaginertia=".01 .05 .05"/>
<body name="d" pos=".3 0 0"><joint name="j4" axis="0 1 0" {j4}/>
<inertial pos=".05 .0 .03" mass="1" diaginertia=".004 .003 .004"/><site name="tip" pos=".1 0 0"/>
</body></body></body></body></body></worldbody></mujoco>"""
PLAIN = {"j1": "", "j2": "", "j3": "", "j4": "", "mass": 6.0, "third": "hinge"}


def arm(folder: Path, **changes: object) -> Path:
    path = folder / f"arm_{len(changes)}.xml"
    path.write_text(ARM.format(**(PLAIN | changes)))
    return path


def torques(path: Path, q: Array, v: Array, a: Array) -> Array:
    """Inverse dynamics of MuJoCo, friction of joints included."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, found = mujoco.MjData(model), []
    for row in zip(q, v, a, strict=True):
        data.qpos, data.qvel, data.qacc = row
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse + model.dof_frictionloss * np.sign(row[1]))
    return np.array(found)


def fourier(
    rng: np.random.Generator, joints: int, rate: float = 100.0, lasts: float = 12.0
) -> tuple[Array, ...]:
    """Time, angles, speeds and accelerations of a motion that begins and ends at rest."""
    t = np.arange(0.0, lasts, 1.0 / rate)
    fade, shape = np.sin(np.pi * t / lasts) ** 2, np.zeros((len(t), joints))
    for k in range(1, 6):
        phase = 2.0 * np.pi * k * t[:, None] / lasts + rng.uniform(0, 6.3, joints)
        shape += rng.normal(scale=0.5 / k**0.5, size=joints) * np.sin(phase)
    q = fade[:, None] * shape
    v = np.gradient(q, t, axis=0, edge_order=2)
    return t, q, v, np.gradient(v, t, axis=0, edge_order=2)


def day(truth: Path, robot: Robot, runs: int, seed: int, noise: float = 0.05) -> Motions:
    """Runs of an arm that MuJoCo knows, with noisy torques."""
    rng, found = np.random.default_rng(seed), []
    for r in range(runs):
        t, q, v, a = fourier(rng, robot.dof)
        effort = torques(truth, q, v, a) + rng.normal(scale=noise, size=q.shape)
        found.append(Run(f"run{r}", t, q, effort))
    return Motions(tuple(found))


def cell_of(path: Path) -> Cell:
    robot = Robot.from_mjcf(path, "base", "tip")
    return Cell(robot, {"m": (0.1, 0.0, 0.0)}, gravity=np.array([0.3, -0.2, -9.7]))


def diagnosed(plain: Path, truth: Path, seed: int = 1) -> MotionDiagnosis:
    """What six runs of one arm say to the file of another."""
    cell = cell_of(plain)
    return diagnose_motions(cell, day(truth, cell.robot, 6, seed))


@pytest.mark.parametrize("third", ["hinge", "slide"])
def test_the_regressor_is_mujocos_inverse_dynamics(tmp_path: Path, third: str) -> None:
    path = arm(tmp_path, third=third)
    robot = Robot.from_mjcf(path, "base", "tip")
    q, v, a = np.random.default_rng(0).normal(size=(3, 40, 4))
    Y = regressor(robot, q, v, a, np.array([0.3, -0.2, -9.7]))
    assert np.abs(Y @ nominal_inertials(robot).ravel() - torques(path, q, v, a)).max() < 1e-9


def test_losses_of_the_file_are_in_the_model(tmp_path: Path) -> None:
    path = arm(tmp_path, j2='damping="3" frictionloss="2" armature=".5"')
    found = diagnosed(path, path, 0)
    assert found.verdict == "no_gap"
    assert not found.causes


NAMED: list[tuple[dict[str, str], dict[tuple[str, str], float]]] = [
    ({"j2": 'armature=".6"'}, {("armature", "j2"): 0.6}),
    (
        {"j2": 'damping="3" armature=".6" frictionloss="1.5"'},
        {
            ("viscous_friction", "j2"): 3.0,
            ("armature", "j2"): 0.6,
            ("coulomb_friction", "j2"): 1.5,
        },
    ),
    (
        {"j1": 'frictionloss="1.5"', "j4": 'frictionloss=".7"'},
        {("coulomb_friction", "j1"): 1.5, ("coulomb_friction", "j4"): 0.7},
    ),
]


@pytest.mark.parametrize(("change", "expected"), NAMED)
def test_what_mujoco_put_in_is_named(
    tmp_path: Path, change: dict[str, str], expected: dict[tuple[str, str], float]
) -> None:
    are_named(diagnosed(arm(tmp_path), arm(tmp_path, **change)), expected)


def are_named(found: MotionDiagnosis, expected: dict[tuple[str, str], float]) -> None:
    """These causes and no others, of these sizes, each beyond doubt."""
    values = {(own.effect, own.where): own.parameters[0].value for own in found.causes}
    assert values == pytest.approx(expected, rel=0.1)
    assert all(own.standing == "established" for own in found.causes)


def test_one_term_is_named_and_the_result_is_its_json(tmp_path: Path) -> None:
    found = diagnosed(arm(tmp_path), arm(tmp_path, j3='damping="2.5"'))
    are_named(found, {("viscous_friction", "j3"): 2.5})
    made = MotionResult.of(found, MADE_FROM)
    assert MotionResult.model_validate_json(made.to_json()) == made
    assert made.gap.unit == "percent"
    names = {"floor_mm", "heldout_before_mm", "heldout_after_mm", "joints"}
    assert names <= made.gap.model_dump().keys()
    assert all(own.depends_on and own.share_of_gap for own in made.located)
    assert set(made.gap.joints) == {"j1", "j2", "j3", "j4"}
    assert "The torques need" in made.summary()


BEFORE, AFTER = np.array([-0.05, 0.3, 0.0]), np.array([0.12, 0.02, 0.0])
"""Anchors of a spring at the second joint, m, in its frame."""


def test_a_spring_between_stated_anchors_is_named(tmp_path: Path) -> None:
    """A tendon of MuJoCo."""
    stiffness, free = 3e3, 0.1
    x, y, z = BEFORE @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) + [0.1, 0.0, 0.1]
    tendon = (
        f'<tendon><spatial stiffness="{stiffness}" springlength="{free}"><site site="before"/>'
        '<site site="after"/></spatial></tendon></mujoco>'
    )
    text = ARM.format(**PLAIN).replace("</mujoco>", tendon)
    text = text.replace('<body name="b"', f'<site name="before" pos="{x} {y} {z}"/><body name="b"')
    text = text.replace('<body name="c"', '<site name="after" pos=".12 .02 0"/><body name="c"')
    (tmp_path / "sprung.xml").write_text(text)
    cell = replace(cell_of(arm(tmp_path)), anchors={"j2": np.array([BEFORE, AFTER])})
    found = diagnose_motions(cell, day(tmp_path / "sprung.xml", cell.robot, 6, 4))
    (cause,) = found.causes
    assert (cause.effect, cause.where) == ("gravity_compensator", "j2")
    spring, preload = (own.value for own in cause.parameters)
    pull = stiffness * (np.linalg.norm(AFTER - BEFORE) - free)
    assert [spring, preload] == pytest.approx([stiffness, pull], rel=0.05)


def test_a_wrong_mass_is_inertials_or_payload(tmp_path: Path) -> None:
    found = diagnosed(arm(tmp_path), arm(tmp_path, mass=7.5), 2)
    assert [own.effect for own in found.causes] == ["inertials"]
    assert found.verdict == "explained"
    assert found.crossed.after[1] < 0.1 * found.crossed.before[1]


def test_presliding_is_dahls_equation() -> None:
    """Against its differential equation, in small steps."""
    q = np.cumsum(np.random.default_rng(3).normal(scale=1e-4, size=400).cumsum() * 0.1)
    z = np.zeros(len(q))
    for i, step in enumerate(np.diff(q), 1):
        z[i], parts = z[i - 1], 2000
        for _ in range(parts):
            z[i] += 1e3 * step / parts * (1.0 - z[i] * np.sign(step))
    assert np.abs(presliding(q, 1e3) - z).max() < 1e-3


def test_columns_are_linear_terms_of_one_joint() -> None:
    """Each kind gives as many columns as it has parameters, finite everywhere."""
    q, v, a, slope, rigid, *spring = np.random.default_rng(4).normal(size=(7, 60))
    joint = JointMotion(q, v, a, slope, rigid, 50.0, np.transpose(spring))
    for kind in KINDS:
        for variant in kind.variants:
            columns = kind(variant).columns(joint)
            assert columns.shape == (60, len(kind.unknowns))
            assert np.isfinite(columns).all()


def test_filtering_gives_derivatives() -> None:
    t, q, v, a = fourier(np.random.default_rng(5), 2)
    got = filtered(Run("r", t, q, q))
    at = np.searchsorted(t, got.time)
    assert np.abs(got.v - v[at]).max() < 2e-3 * np.abs(v).max()
    assert np.abs(got.a - a[at]).max() < 2e-2 * np.abs(a).max()


# -- tables --------------------------------------------------------------------------------------


def written(folder: Path, motions: Motions, lines: list[str] | None = None) -> Path:
    """The table of the arm's motions; lines : others in place of its rows."""
    joints = ("j1", "j2", "j3", "j4")
    head = ["session", "time_s", *(f"{j}_rad" for j in joints), *(f"{j}_Nm" for j in joints)]
    rows = [
        ",".join([run.name, *(f"{x:.8g}" for x in (t, *q, *e))])
        for run in motions.runs
        for t, q, e in zip(run.time, run.q, run.effort, strict=True)
    ]
    path = folder / "motion.csv"
    path.write_text("\n".join([",".join(head), *(rows if lines is None else lines)]) + "\n")
    return path


def test_a_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    cell = cell_of(arm(tmp_path))
    motions = day(arm(tmp_path), cell.robot, 2, 6)
    file = written(tmp_path, motions)
    assert holds_motions(file)
    for one, other in zip(motions.runs, load_motions(cell, file).runs, strict=True):
        assert np.allclose(one.q, other.q, atol=1e-7)
        assert np.allclose(one.effort, other.effort, rtol=1e-7)


def test_a_load_that_the_cell_does_not_carry_is_refused(tmp_path: Path) -> None:
    """As a plan with a [load] has them: the model of the torques has one load for all runs."""
    cell = cell_of(arm(tmp_path))
    path = written(tmp_path, day(arm(tmp_path), cell.robot, 1, 7))
    head, *rows = path.read_text().splitlines()
    for mass in (0, 3):
        text = "\n".join([f"{head},payload_kg", *(f"{row},{mass}" for row in rows), ""])
        path.write_text(text)
        if mass:
            with pytest.raises(InputError, match="carries 0 kg; keep runs of one load, and state"):
                load_motions(cell, path)
        else:
            assert load_motions(cell, path).runs


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [("time_s", "time", "write 'time' as 'time_s'"), ("_Nm", "_mNm", "has no torques")],
)
def test_a_table_of_other_units_is_known_as_one_of_motions(
    tmp_path: Path, right: str, wrong: str, said: str
) -> None:
    cell = cell_of(arm(tmp_path))
    path = written(tmp_path, day(arm(tmp_path), cell.robot, 1, 7))
    head, rest = path.read_text().split("\n", 1)
    path.write_text(f"{head.replace(right, wrong)}\n{rest}")
    assert holds_motions(path)
    with pytest.raises(InputError, match=said):
        load_motions(cell, path)


def unsigned(row: str) -> str:
    cells = row.split(",")
    return ",".join([*cells[:-4], *(cell.lstrip("-") for cell in cells[-4:])])


def still(row: str) -> str:
    cells = row.split(",")
    return ",".join([*cells[:2], "0", "0", "0", "0", *cells[-4:]])


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda rows: rows[::-1], "do not increase"),
        (lambda rows: [*rows[:5], rows[5].replace(",", ",x", 1), *rows[6:]], "is not a number"),
        (lambda rows: [unsigned(row) for row in rows], "never negative"),
        (lambda rows: [still(row) for row in rows], "no run in which a joint moves"),
        (lambda rows: [rows[0] + ",1"], "fields, the header"),
        (lambda rows: [], "has a header and no rows; add the samples"),
    ],
)
def test_wrong_tables_are_refused_in_one_line(
    tmp_path: Path, edit: Callable[[list[str]], list[str]], said: str
) -> None:
    cell = cell_of(arm(tmp_path))
    path = written(tmp_path, day(arm(tmp_path), cell.robot, 1, 7))
    rows = path.read_text().splitlines()[1:]
    with pytest.raises(InputError, match=said):
        load_motions(cell, written(tmp_path, Motions(()), edit(rows)))


def test_two_rates_and_standing_runs_are_said(tmp_path: Path) -> None:
    cell = cell_of(arm(tmp_path))
    one, two = day(arm(tmp_path), cell.robot, 2, 8).runs
    half = len(one) // 2
    slower = (np.concatenate([own[:half], own[half::2]]) for own in (one.time, one.q, one.effort))
    still = Run("b", two.time, np.zeros_like(two.q), two.effort)
    found = load_motions(cell, written(tmp_path, Motions((Run("a", *slower), still))))
    assert found.names == ("a",)
    assert any("two rates" in text for text in found.warnings)
    assert any("stands still" in text for text in found.warnings)


def test_a_silent_sensor_and_motions_that_hardly_move(tmp_path: Path) -> None:
    cell = cell_of(arm(tmp_path))
    runs = day(arm(tmp_path, j2='damping="3"'), cell.robot, 5, 9).runs
    silent = [replace(run, effort=run.effort * [1.0, 1.0, 1.0, 0.0]) for run in runs]
    found = diagnose_motions(cell, Motions(tuple(silent)))
    assert ("viscous_friction", "j2") in {(own.effect, own.where) for own in found.causes}
    slow = [replace(run, q=run.q * 1e-4) for run in runs]
    with pytest.raises(CalibError, match="no joint moves faster"):
        diagnose_motions(cell, Motions(tuple(slow)))


# -- real arms -----------------------------------------------------------------------------------

CELL = """schema = 1
name = "arm"
[robot]
urdf = "{}"
base = "{}"
tip = "{}"
[motion]
cutoff_hz = {}
"""


def real_cell(folder: Path, real: Path, base: str, tip: str, cutoff: float) -> Cell:
    path = folder / "cell.toml"
    path.write_text(CELL.format(real / "robot.urdf", base, tip, cutoff))
    return calib.load_cell(path)


@pytest.fixture(scope="module")
def ur10e(tmp_path_factory: pytest.TempPathFactory, data: Path) -> tuple[Cell, Motions]:
    folder, real = tmp_path_factory.mktemp("ur10e"), data / "ur10e_motion"
    cell = real_cell(folder, real, "base_link", "tool0", 8.0)
    return cell, load_motions(cell, real / "motion.csv")


@pytest.mark.long
def test_a_real_arm_needs_friction_armature_and_other_links(ur10e: tuple[Cell, Motions]) -> None:
    """Eight runs of an UR10e, three held out: 80 % by its URDF, 10 % with usual friction."""
    cell, motions = ur10e
    held = ("free_h8", "free_h12_30s", "free_jan")
    found = calib.diagnose(
        cell, motions.take([n for n in motions.names if n not in held]), heldout=motions.take(held)
    )
    assert isinstance(found, MotionDiagnosis)
    assert found.heldout is not None
    assert TorqueGap.overall(found.heldout.before) > 0.7
    assert TorqueGap.overall(found.heldout.after) < 0.065
    kinds = {own.effect for own in found.causes}
    assert kinds >= {"pre_sliding", "armature", "inertials", "load_friction", "viscous_friction"}
    assert not kinds & {"payload", "torque_offset", "spring", "torque_delay"}
    assert found.constants is not None
    # Constants quoted for an UR10, which is another arm: 14.87 13.26 11.13 10.62 11.03 11.47 Nm/A.
    assert np.all((found.constants[:5, 0] > 5.0) & (found.constants[:5, 0] < 20.0))


@pytest.mark.long
def test_two_short_runs_are_judged_by_stretches(tmp_path: Path, data: Path) -> None:
    """A KR300, ten seconds twice, each predicted by the other: 78 % by its URDF."""
    cell = real_cell(tmp_path, data / "kr300_motion", "base", "link6", 10.0)
    found = diagnose_motions(cell, load_motions(cell, data / "kr300_motion" / "motion.csv"))
    assert found.blocks
    assert TorqueGap.overall(found.crossed.after) < 0.2
    assert {"viscous_friction", "armature"} <= {own.effect for own in found.causes}
    one, other = (load_motions(cell, data / "kr300_motion" / "motion.csv").take([n]) for n in "AB")
    apart = diagnose_motions(cell, one, heldout=other)
    assert TorqueGap.overall(apart.gap.after) < 0.25  # 82 % before
    assert all(own.evidence.stands() for own in apart.causes)
    assert apart.possible
    assert not any(own.evidence.stands() for own in apart.possible)
    assert all(own.probability <= 0.5 for own in apart.possible)
    assert not any(own.standing == "established" for own in apart.possible)
