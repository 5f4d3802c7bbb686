"""What users do wrong; what ``posecal`` says to each stands in ``messages.md``."""

from __future__ import annotations

import re
from dataclasses import dataclass

from tests.bad_inputs.edits import (
    Edit,
    added,
    column,
    effects,
    exchanged,
    field,
    header,
    line,
    lines,
    no_rows_with,
    swap,
    times,
    whole,
    without,
)


@dataclass(frozen=True)
class Fault:
    """A call that must fail, on the files of the demonstration.

    did : what the user did
    call : words after ``posecal``; file, edit : what was changed before, if anything
    """

    did: str
    call: str
    file: str = ""
    edit: Edit = str


_IDENTIFY = "identify cell.toml measurements.csv"


def _in(file: str, call: str, cases: dict[str, Edit]) -> list[Fault]:
    return [Fault(did, call, file, edit) for did, edit in cases.items()]


_SEEN = swap(
    "[instrument]\nsigma_mm = 0.010",
    '[boards.b]\non = "tip"\nsquares = [9, 6]\npitch_mm = 30\n[instruments.cam]\nkind = "camera"\n'
    "focal_px = 1200\ncenter_px = [640, 480]\nsigma_px = 0.1",
)


def _seen(old: str, new: str) -> Edit:
    """The cell with a camera and a board, and a change of these."""
    return lambda text: swap(old, new)(_SEEN(text))


def _excluding(cause: str) -> Edit:
    return added(f'\n[diagnosis]\nexclude = ["{cause}"]\n')


MEASUREMENTS = _in(
    "measurements.csv",
    _IDENTIFY,
    {
        "a joint's column is missing": without("A3_deg"),
        "a joint's column without unit": header("A3_deg", "A3"),
        "a column of a joint that is not there": header("fx_N", "A7_deg"),
        "a joint in two units": header("fx_N", "A3_rad"),
        "approach of one joint alone": column("approach_A1", "1"),
        "approach of a joint that is not there": column("approach_B1", "1"),
        "an approach that is no sign": lambda t: field(4, "approach_A2", "2")(_all_approaches(t)),
        "a point without unit": header("x_mm", "x"),
        "a point's column is missing": without("z_mm"),
        "temperature in another unit": column("temperature_K", "293"),
        "a column twice": header("fx_N", "fy_N"),
        "no column of poses": header("pose", "point"),
        "a point's column in capital letters": header("x_mm", "X_mm"),
        "a decimal comma": field(5, "x_mm", '"1,5"'),
        "a word for a number": field(5, "x_mm", "abc"),
        "an empty field": field(5, "x_mm", ""),
        "NaN": field(7, "A2_deg", "nan"),
        "a point beyond the horizon": field(4, "x_mm", "1e9"),
        "a row twice": lambda t: t + t.split("\n")[1] + "\n",
        "a marker that the cell does not have": field(3, "marker", "m9"),
        "a marker never measured": no_rows_with(",m3,"),
        "two joint values in one pose": field(3, "A1_deg", "1.0"),
        "a pose without a name": field(3, "pose", ""),
        "a name with an escape sequence": field(3, "pose", "p\x1b[2J"),
        "a standard deviation of zero": column("sigma_mm", "0"),
        "a standard deviation in pixels of a point": column("sigma_px", "0.3"),
        "fields missing in a row": line(4, lambda r: r.rsplit(",", 1)[0]),
        "too few poses": lines(10),
        "an empty file": whole(""),
        "only a header": lines(1),
        "an open quote": line(4, lambda r: '"' + r),
        "a table of 5000 columns": whole("pose," + ",".join(map(str, range(5000)))),
        "a JSON in place of the table": whole('{"a": 1}\n'),
        "milliseconds since 1970": column("time_s", "1763819384123"),
        "counts of an encoder": field(4, "A1_deg", "1000000"),
    },
)

_POINTS = ("x_mm", "y_mm", "z_mm")
_DIAGNOSE = "diagnose cell.toml measurements.csv"

IMPLAUSIBLE = [
    *_in(
        "measurements.csv",
        _IDENTIFY,
        {
            "a mirrored frame": times(-1.0, "y_mm"),
            "points in inches": times(1.0 / 25.4, *_POINTS),
            "two joints swapped": exchanged("A4_deg", "A6_deg"),
            "two markers exchanged in one reading": lambda t: field(3, "marker", "m1")(
                field(2, "marker", "m2")(t)
            ),
        },
    ),
    Fault("a mirrored frame diagnosed", _DIAGNOSE, "measurements.csv", times(-1.0, "x_mm")),
    Fault("a mirrored frame in mid-session", "enough cell.toml measurements.csv --plan plan.csv",
          "measurements.csv", times(-1.0, "z_mm")),
]  # fmt: skip

CELL = _in(
    "cell.toml",
    _IDENTIFY,
    {
        "an empty cell": whole(""),
        "a number in quotes": swap("0.010", '"0.01"'),
        "a maximum permissible error without divisor": swap("0.010", "{ mpe_mm = 0.03 }"),
        "a unit misspelt": swap("sigma_mm", "sigma_m"),
        "an error common to all readings": swap(
            "[instrument]", "[instrument]\ncommon.scale_um_m = 0.3"
        ),
        "a tracker that is turned": swap("[instrument]", "[instrument]\nrpy_deg = [0, 0, 90]"),
        "a tolerance of nothing": added("\n[acceptance]\ntolerance_mm = 0\n"),
        "a decision rule": added('\n[acceptance]\ntolerance_mm = 0.1\nrule = "guarded"\n'),
        "a table in what the report tells": added("\n[report]\nserial = { number = 3 }\n"),
        "no instrument": lambda t: t.replace("[instrument]\nsigma_mm = 0.010", "[payload]\n"),
        "no markers": lambda t: "\n".join(
            r for r in t.split("\n") if r[:4] not in ("m1 =", "m2 =", "m3 =")
        ),
        "a marker of two numbers": swap("[279.2, -16.4, -91.9]", "[279.2, -16.4]"),
        "a marker named with a bell": swap("m1 =", '"m\\u0007" ='),
        "a normal without length": swap(
            "[279.2, -16.4, -91.9]", "{ position = [1, 2, 3], normal = [0, 0, 0] }"
        ),
        "a marker on no link": swap(
            "[279.2, -16.4, -91.9]", '{ position = [1, 2, 3], on = "left_hand" }'
        ),
        "a joint moved by one that is not there": added(
            "\n[robot.coupled.A3]\nof = { B2 = -1.0 }\n"
        ),
        "a joint that moves itself": added("\n[robot.coupled.A3]\nof = { A3 = -1.0 }\n"),
        "an acceptance of 400 degrees": swap(
            "[279.2, -16.4, -91.9]", "{ position = [1, 2, 3], acceptance_deg = 400 }"
        ),
        "limits of no joint": swap("A2 = [-140.0, -0.01]", "B2 = [-1, 1]"),
        "limits outside the URDF's": swap("[-140.0, -0.01]", "[10, 20]"),
        "millimetres for a joint that turns": swap("[robot.limits_deg]", "[robot.limits_mm]"),
        "a load of three tonnes": swap("mass_kg = 250.0", "mass_kg = 3000.0"),
        "the load as payload as well": added(
            "\n[payload]\nmass_kg = 250.0\ncom_mm = [300, 0, 150]\n"
        ),
        "gravity in centimetres": added("\n[gravity]\nm_s2 = [0, 0, -980.665]\n"),
        "a result in place of the cell": whole('{"a": 1}\n'),
        "base and markers taken as known": effects("geometry"),
        "the payload in the wrench as well": lambda t: t.replace("[load]", "[payload]").replace(
            "max_tilt", "# max_tilt"
        ),
        "another schema": swap("schema = 1", "schema = 2"),
        "knots of no joint": swap("A2 = [-140.0, -99.85", "B2 = [-140.0, -99.85"),
        "a knot twice": swap("A2 = [-140.0, -99.85", "A2 = [-140.0, -140.0"),
        "both count and values of levels": swap(
            "poses_per_level = 3 }", "poses_per_level = 3, count = 5 }"
        ),
        "an obstacle of no known shape": added('\n[[design.obstacle]]\ntype = "cone"\n'),
        "a speed in another unit": added("\n[robot.speed_mm_s]\nA1 = 105\n"),
        "a day faster than the joints": added("\n[timing]\nspeed_percent = 120\n"),
        "a box without size": added('\n[[design.obstacle]]\ntype = "box"\ncenter_mm = [0, 0, 0]\n'),
        "no effects": effects(),
        "a misspelt effect": effects("joint_complience:A2"),
        "sizes that are no sizes": swap("[model]", '[model]\nsize_prior = "maybe"'),
        "a size in no unit of the effect": swap(
            "[model]", "[model]\nsize_prior = { geometry_deg = 3 }"
        ),
        "a prior from other robots": added('\n[model.prior]\nfile = "type.json"\n'),
        "a group with a place": effects("base:A2", "tool"),
        "an effect of the base at a joint": effects("base", "base_compliance:A2"),
        "temperature not measured": effects("base", "thermal_expansion:arm"),
        "torques not measured": effects("base", "measured_torque:A2"),
        "an error of the load of a rigid arm": effects("base", "payload"),
        "a scale beside free lengths": effects("base", "tool", "geometry", "tracker_scale"),
        "a cause misspelt that is excluded": _excluding("backlsh:A3"),
        "an excluded cause at a place misspelt": _excluding("base_compliance:bse"),
        "an excluded cause at no joint": _excluding("backlash:elbow"),
        "a group of effects excluded": _excluding("geometry"),
        "a URDF that is not there": swap("kr270.urdf", "other.urdf"),
        "a device for the URDF": swap('"kr270.urdf"', '"/dev/zero"'),
        "no such link": swap('tip = "tool0"', 'tip = "tool1"'),
        "the base beyond the tip": swap('base = "base_link"', 'base = "link_6"\n#'),
        "brackets by the thousand": added("\nx = " + "[" * 3000),
        "an integer of ten thousand digits": swap("0.010", "1" * 10_000),
    },
)

_BOMB = (
    '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]>'
    "<robot name='&b;'><link name='base_link'/></robot>"
)
_A2 = '<origin xyz="0.35 0 0" rpy="0 0 0"/>'


def _joint(name: str, kind: str, parent: str, child: str) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/></joint>'
        "</robot>"
    )


URDF = _in(
    "kr270.urdf",
    _IDENTIFY,
    {
        "not XML": swap("</robot>", "</robo>"),
        "an entity bomb": whole(_BOMB),
        "a model of another kind": whole("<mujoco/>"),
        "NaN in an origin": swap("0.35 0 0", "0.35 nan 0"),
        "an origin beyond reason": swap("0.35 0 0", "1e300 0 0"),
        "a link in millimetres": swap("0.35 0 0", "350 0 0"),
        "a joint that is not supported": swap('type="revolute"', 'type="planar"'),
        "a joint twice": swap('<joint name="A2"', '<joint name="A1"'),
        "a joint that mimics none": swap(_A2, _A2 + '<mimic joint="B1"/>'),
        "a joint that mimics itself": swap(_A2, _A2 + '<mimic joint="A2"/>'),
        "a negative mass": swap('value="232"', 'value="-232"'),
        "a closed loop": swap("</robot>", _joint("bar", "fixed", "base_link", "link_3")),
        "a chain interrupted": swap('<child link="link_4"/>', '<child link="link_9"/>'),
    },
)

OTHERS = [
    Fault("a plan with a pose twice", "compare cell.toml plan.csv", "plan.csv", swap("p02", "p01")),
    Fault("a plan in place of a cell", "identify plan.csv measurements.csv"),
    Fault("a plan in place of measurements", "identify cell.toml plan.csv"),
    Fault("a plan in place of a result", "compensate cell.toml plan.csv aims.csv"),
    Fault("a result nested by the thousand", "compensate cell.toml result.json aims.csv",
          "result.json", whole("[" * 100_000)),
    Fault("a result with NaN", "compensate cell.toml result.json aims.csv", "result.json",
          lambda t: t.replace('"value_SI": ', '"value_SI": NaN, "was": ', 1)),
    Fault("targets that are not there", _IDENTIFY, "cell.toml",
          swap('# targets = "targets.csv"', 'targets = "targets.csv"')),
    Fault("targets without weight", "design cell.toml --candidates 500", "targets.csv",
          whole("A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg,weight\n0,-90,90,0,45,0,0\n")),
    Fault("targets outside the limits", "design cell.toml --candidates 500", "targets.csv",
          whole("A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg\n0,90,90,0,45,0\n")),
    Fault("a command that is not there", "identfy cell.toml measurements.csv"),
    Fault("data forgotten", "identify cell.toml"),
    Fault("a cell that is not there", "identify nowhere.toml measurements.csv"),
    Fault("data that are not there", "identify cell.toml nowhere.csv"),
    Fault("a device for the data", "identify cell.toml /dev/null"),
    Fault("an unknown approach", _IDENTIFY + " --approach poses"),
    Fault("a hold-out of 150 %", _IDENTIFY + " --holdout 1.5"),
    Fault("a hold-out that is not there", _IDENTIFY + " --holdout held.csv"),
    Fault("the data as their own hold-out", _IDENTIFY + " --holdout measurements.csv"),
    Fault("nearly all held out", _IDENTIFY + " --holdout 0.99"),
    Fault("the result over the data", _IDENTIFY + " --json measurements.csv"),
    Fault("two results in one file", _IDENTIFY + " --json x --urdf x"),
    Fault("the result into a missing folder", _IDENTIFY + " --json no/folder/result.json"),
    Fault("figures in place of a file", _IDENTIFY + " --figures plan.csv"),
    Fault("the result onto a full device", _IDENTIFY + " --json /dev/full"),
    Fault("a plan twice", "compare cell.toml plan.csv plan.csv"),
    Fault("levels not understood", "design cell.toml --levels A2=5"),
    Fault("levels and poses that contradict", "design cell.toml --levels A2=5x3 --poses 16"),
    Fault("too few candidates", "design cell.toml --candidates 3"),
    Fault("more poses than candidates", "design cell.toml --candidates 500 --levels A2=2x400"),
    Fault("one rival alone", "design cell.toml --discriminate joint_compliance:A2"),
    Fault("a rival misspelt", "design cell.toml --discriminate joint_complience:A1,backlash:A3"),
    Fault("a rival that the model contains",
          "design cell.toml --discriminate joint_compliance:A2,bearing_compliance:A3"),
    Fault("a criterion and rivals", "design cell.toml --criterion D --discriminate a:b,c:d"),
    Fault("a factor that is none",
          "design cell.toml --criterion c --candidates 500 --of joint_compliance:A3=x"),
    Fault("a subset for a criterion that takes none",
          "design cell.toml --candidates 500 --of joint_compliance:A6"),
    Fault("a parameter that is not there",
          "design cell.toml --criterion Ds --candidates 500 --of backlash:A1"),
    Fault("the plan over the cell", "design cell.toml -o cell.toml"),
    Fault("a hold-out for a plan", "diagnose cell.toml plan.csv --plan-only --holdout 0.3"),
    Fault("a better cell over the URDF", f"{_DIAGNOSE} --cell-out kr270.urdf"),
    Fault("measurements without points diagnosed", "diagnose cell.toml plan.csv"),
    Fault("the demonstration over edited files", "demo .", "cell.toml", added("# mine\n")),
    Fault("the demonstration in place of a file", "demo plan.csv"),
]  # fmt: skip


def _all_approaches(table: str) -> str:
    for k in range(1, 7):
        table = column(f"approach_A{k}", "1")(table)
    return table


_IMPORT = "import points.csv --joints joints.csv -o joined.csv"
_COMPENSATE = "compensate cell.toml result.json aims.csv"

JOINED = [
    Fault("points without a marker", _IMPORT, "points.csv", header("marker", "name")),
    Fault("a pose without joints", _IMPORT, "joints.csv", line(3, lambda _: "")),
    Fault("a pose without points", _IMPORT, "joints.csv", added("p99,0,0,0,0,0,0\n")),
    Fault("joints twice", _IMPORT, "joints.csv", lambda text: text + text.splitlines()[1] + "\n"),
    Fault("a column in both tables", _IMPORT, "points.csv", header("x_mm", "A1_deg")),
    Fault("no joint file", "import points.csv --joints none.csv -o joined.csv"),
    Fault("the table over the points", "import points.csv --joints joints.csv -o points.csv"),
    Fault("a program in an unknown language", "program cell.toml plan.csv -o plan.txt"),
    Fault("a program of a plan beyond the limits", "program cell.toml plan.csv -o plan.src", "plan.csv",
          swap("-140", "-175")),
]  # fmt: skip

RESULTS = [
    Fault("compensation from no result", "compensate cell.toml cell.toml aims.csv"),
    Fault("compensation with targets and result exchanged",
          "compensate cell.toml aims.csv result.json"),
    Fault("compensation from a result without estimate", _COMPENSATE, "result.json",
          swap('"estimate"', '"was"')),
    Fault("compensation of targets outside the limits", _COMPENSATE, "aims.csv",
          swap("-140", "-175")),
    Fault("a report of no result", "report cell.toml"),
    Fault("a report of a result without residuals", "report result.json", "result.json",
          swap('"residuals"', '"rest"')),
    Fault("a report of a command that has none", "report result.json", "result.json",
          swap('"identify"', '"predict"')),
    Fault("a report of nothing", "report"),
    Fault("a goal below zero", "enough cell.toml measurements.csv --plan plan.csv --goal-mm -1"),
    Fault("no plan to go on with", "enough cell.toml measurements.csv --plan none.csv"),
    Fault("half a plan without measurements", "enough cell.toml plan.csv --plan plan.csv"),
]  # fmt: skip

_CHANGES = "changes result.json result.json"
_OTHER = swap("</robot>", "<!-- another --></robot>")
_REPORT = """{"schema": 1, "command": "report", "version": "0", "cell": "", "seed": 0, "inputs": [],
"about": {}, "warnings": [], "page": "p.html", "notes": []}"""
CHANGES = [
    Fault("changes since a cell", "changes cell.toml result.json"),
    Fault("changes since what is not there", "changes none.json result.json"),
    Fault("changes since a day of another kind", _CHANGES, "result.json", whole(_REPORT)),
    Fault("changes of a result that did not converge", _CHANGES, "result.json",
          swap('"converged": true', '"converged": false')),
    Fault("changes on another nominal model", _CHANGES, "kr270.urdf", _OTHER),
    Fault("changes in a cell that changed", _CHANGES, "cell.toml", added("# moved")),
    Fault("changes in a cell that is none", f"{_CHANGES} --cell plan.csv"),
]  # fmt: skip

_DH = """joint,alpha_deg,a_mm,theta_deg,d_mm
A1,180,0,0,-645
A2,90,330,0,0
A3,0,1150,-90,0
"""
_XACRO = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>'
_INIT = "init arm.csv -o new"


def _dh(old: str, new: str) -> Edit:
    return whole(_DH.replace(old, new))


ROBOTS = [
    Fault("a DH table without its convention", _INIT, "arm.csv", whole(_DH)),
    *_in(
        "arm.csv",
        _INIT + " --dh classic",
        {
            "a DH column without unit": _dh("a_mm", "a"),
            "a DH column in two units": _dh("d_mm", "d_mm,d_m"),
            "radians under the name of degrees": _dh("A2,90", "A2,1.5707963"),
            "degrees under the name of radians": _dh("alpha_deg", "alpha_rad"),
            "millimetres under the name of metres": _dh("a_mm", "a_m"),
            "a DH joint twice": _dh("A2", "A1"),
            "a DH joint of no kind": lambda _: _DH.replace("joint,", "joint,kind,").replace(
                "A1,", "A1,R,"
            ).replace("A2,", "A2,revolute,").replace("A3,", "A3,revolute,"),
        },
    ),
    Fault("a URDF taken for a DH table", "init kr270.urdf -o new --dh classic"),
    Fault("no robot", "init none.urdf"),
    Fault("a robot that is a cell", "init cell.toml -o new --dh modified"),
    Fault("a cell over the present one", "init kr270.urdf"),
    Fault("a tip that the robot lacks", "init kr270.urdf -o new --tip tool9"),
    Fault("a xacro not expanded", "init arm.xacro -o new", "arm.xacro", whole(_XACRO)),
    Fault("a page in place of a robot", "init arm.html -o new", "arm.html", whole("<html/>")),
    Fault("a robot that does not move", "init arm.urdf -o new", "arm.urdf",
          whole("<robot name='arm'><link name='a'/></robot>")),
    *_in(
        "cell.toml",
        _IDENTIFY,
        {
            "DH without its convention": swap('urdf = "kr270.urdf"', 'dh = "arm.csv"'),
            "two files of one robot": swap('kr270.urdf"', 'kr270.urdf"\nmjcf = "arm.xml"'),
            "a URDF taken for an MJCF": swap('urdf = "kr270.urdf"', 'mjcf = "kr270.urdf"'),
            "a URDF without base": swap('base = "base_link"', ""),
        },
    ),
]  # fmt: skip

SERIAL = """<mujoco><compiler angle="radian"/><worldbody><body name="base">
<body name="link" pos="0 0 1"><joint name="j1" range="-1 1"/><geom size="0.1"/>
<body name="hand" pos="0 0 1"><joint name="j2" axis="1 0 0"/><geom size="0.1"/><site name="tip"/>
</body></body></body><site name="wall"/></worldbody></mujoco>"""
"""A good MJCF."""


def _mjcf(old: str, new: str) -> Edit:
    return whole(swap(old, new)(SERIAL))


def tied(ends: str, more: str = "") -> Edit:
    """An MJCF with an equality constraint."""
    return swap("</mujoco>", f"<equality><{ends}/></equality>{more}</mujoco>")


_INCLUDE = '<include file="{}"/><compiler'
_TENDON = '<tendon><fixed name="t"><joint joint="j2" coef="1"/></fixed></tendon>'
MJCF = _in(
    "arm.xml",
    "init arm.xml -o new --base base --tip tip",
    {
        "an include that is not there": _mjcf("<compiler", _INCLUDE.format("no.xml")),
        "an MJCF that includes itself": _mjcf("<compiler", _INCLUDE.format("arm.xml")),
        "no such body": _mjcf('"base"', '"bas"'),
        "a ball joint": _mjcf('name="j2"', 'type="ball"'),
        "a joint without a name": _mjcf('name="j2"', ""),
        "coupled joints": whole(tied('joint joint1="j1" joint2="j2"')(SERIAL)),
        "a hand tied to the world": whole(tied('connect body1="hand" anchor="0 0 0"')(SERIAL)),
        "a tip welded to the wall": whole(tied('weld site1="tip" site2="wall"')(SERIAL)),
        "a tendon held at its length": whole(tied('tendon tendon1="t"', _TENDON)(SERIAL)),
        "NaN in a place": _mjcf("0 0 1", "0 nan 1"),
        "an attribute misspelt": _mjcf("axis=", "axes="),
        "limits the wrong way round": _mjcf("-1 1", "1 -1"),
    },
)


def _board(more: str) -> Edit:
    return _seen("pitch_mm = 30", f"pitch_mm = 30\n{more}")


CAMERAS = _in(
    "cell.toml",
    _IDENTIFY,
    {
        "a lens in a file of its own": _seen("sigma_px", 'calibration = "lens.yaml"\nsigma_px'),
        "a camera without its focal length": _seen("focal_px = 1200\n", ""),
        "a focal length in words": _seen("1200", '"long"'),
        "a lens of which nobody knows what is uncertain": _seen(
            "sigma_px", "intrinsics_std = { distortion = true }\nsigma_px"
        ),
        "a board of two shapes": _board("points_mm = { p = [0, 0, 0] }"),
        "a board of tags": _board("tags = [5, 4]"),
        "markers larger than their squares": _board("marker_mm = 40"),
        "a dictionary of markers": _board('dictionary = "5x5_100"'),
    },
)


def _touched(kind: str, *more: str) -> Edit:
    """The cell with something that is touched, or a bar, in place of the tracker."""
    table = [f'[instruments.own]\nkind = "{kind}"', *more]
    return swap("[instrument]\nsigma_mm = 0.010", "\n".join([*table, "sigma_mm = 0.010"]))


TOUCHED = [
    Fault("a plane of which nobody says where it stands", "design cell.toml", "cell.toml",
          _touched("plane")),
    Fault("a plane without its normal", "design cell.toml", "cell.toml",
          _touched("plane", "position_mm = [1700, 0, 700]")),
    Fault("a plan that does not touch", "compare cell.toml plan.csv --monte-carlo 0", "cell.toml",
          _touched("plane", "position_mm = [1700, 0, 700]", "normal = [0, 0, 1]")),
]  # fmt: skip

_SHAPE = """
[robot.capsules_mm]
A1 = [{ from = [0, 0, 0], to = [0, 0, 500], radius = 300 }]
A2 = [{ from = [0, 0, 0], to = [1250, 0, 0], radius = 220 }]
"""
_AROUND = """
[[design.obstacle]]
type = "sphere"
center_mm = [0, 0, 500]
radius_mm = 900
"""
_PROGRAM, _FEW = "program cell.toml plan.csv -o plan.src", "--candidates 500"


def _drifting(text: str) -> str:
    """A model of a drift alone."""
    return re.sub(r"(?m)^levels = .*$", "poses = 15", effects("base_drift")(text))


DAYS = [
    Fault("an obstacle around the base", f"design cell.toml {_FEW}", "cell.toml",
          added(_AROUND + _SHAPE)),
    Fault("a mesh as an obstacle", f"design cell.toml {_FEW}", "cell.toml",
          added('\n[[design.obstacle]]\ntype = "mesh"\nfile = "table.stl"\n')),
    Fault("a plan for a drift alone", f"design cell.toml {_FEW}", "cell.toml", _drifting),
    Fault("temperatures of the day", _PROGRAM, "cell.toml",
          added("\n[timing]\ntemperature_degC = [[0, 20], [60, 22]]\n")),
    Fault("a reference pose", f"design cell.toml {_FEW}", "cell.toml",
          lambda text: text.replace("[design] ", "[design]\nreference_every = 5 ")),
]  # fmt: skip

FAULTS = {
    "measurements.csv": MEASUREMENTS,
    "measurements that no arm gives": IMPLAUSIBLE,
    "cell.toml": CELL,
    "the URDF": URDF,
    "other files, and the call": OTHERS,
    "joined tables and robot programs": JOINED,
    "robots, and a first cell of them": ROBOTS,
    "the MJCF": MJCF,
    "cameras": CAMERAS,
    "what is touched": TOUCHED,
    "the order of the day": DAYS,
    "results that are read again": RESULTS,
    "changes": CHANGES,
}
