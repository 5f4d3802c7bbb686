"""Poses of bodies as motion capture and hand-eye programs write them, against SciPy's rotations."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.arrays import Array
from calib.errors import InputError
from calib.files.exports import Eye, PointList, read_export, read_joints
from calib.files.exports.join import join

RNG = np.random.default_rng(7)
PLACES = RNG.uniform(-1.5, 1.5, (4, 3))
TURNS = Rotation.random(4, random_state=3)
FRAMES = (11, 12, 13, 40)


def motive(unit: str = "Meters", scale: float = 1.0, more: str = "") -> str:
    """Two bodies of which the second is hidden in two frames, a marker of the first between them."""
    columns = ["Rigid Body"] * 8 + ["Rigid Body Marker"] * 3 + ["Rigid Body"] * 8
    names = ["flange"] * 8 + ["flange:Marker1"] * 3 + ["stand"] * 8
    own = ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"]
    axes = ["X", "Y", "Z", "W", "X", "Y", "Z", ""]
    lines = [
        "Format Version,1.23,Take Name,day 1,Capture Frame Rate,120.000000,Rotation Type,Quaternion,"
        f"Length Units,{unit},Coordinate Space,Global",
        "",
        ",".join(["", "Type", *columns]),
        ",".join(["", "Name", *names]),
        ",".join(["", "ID", *['"7A"'] * 19]) + more,
        ",".join(["", "", *own, *["Position"] * 3, *own]),
        ",".join(["Frame", "Time (Seconds)", *axes, "X", "Y", "Z", *axes]),
    ]
    for frame, place, turn in zip(FRAMES, PLACES, TURNS, strict=True):
        body = [f"{v:.6f}" for v in (*turn.as_quat(), *(place * scale), 0.0003)]
        second = [""] * 8 if frame in (12, 13) else body
        row = [str(frame), f"{frame / 120:.6f}", *body, "1", "2", "3", *second]
        lines.append(",".join(row))
    return "\n".join(lines) + "\n"


def vicon(
    quaternion: bool = False, mark: str = ",", angle: str = "deg", section: str = "Objects"
) -> str:
    titles = ["RX", "RY", "RZ", *(["RW"] if quaternion else []), "TX", "TY", "TZ"]
    units = [*([""] * 4 if quaternion else [angle] * 3), *["mm"] * 3]
    blank = [""] * (len(titles) - 1)
    rows = [
        [section],
        ["100"],
        ["", "", "flange:flange", *blank, "arm:wrist", *blank],
        ["Frame", "Sub Frame", *titles, *titles],
        ["", "", *units, *units],
    ]
    for frame, place, turn in zip(FRAMES, PLACES, TURNS, strict=True):
        vector = np.degrees(turn.as_rotvec()) if angle == "deg" else turn.as_rotvec()
        body = [f"{v:.9g}" for v in (*(turn.as_quat() if quaternion else vector), *(1e3 * place))]
        rows.append([str(frame), "0", *body, *([""] * len(body) if frame == 12 else body)])
    text = "\n".join(mark.join(row) for row in rows) + "\n"
    return text.replace(".", ",") if mark == ";" else text


def written(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(text)
    return folder / name


def frames_of(found: PointList, body: str) -> tuple[Array, Rotation]:
    rows = np.array([[float(v) for v in p.values] for p in found.points if p.point == body])
    return rows[:, :3] / 1e3, Rotation.from_quat(rows[:, [4, 5, 6, 3]])


def assert_frames(
    found: PointList, body: str, kept: list[int], atol: float = 2e-6, back: bool = False
) -> None:
    places, turns = frames_of(found, body)
    R, p = TURNS[kept], PLACES[kept]
    if back:
        R, p = R.inv(), -R.inv().apply(p)
    np.testing.assert_allclose(places, p, atol=atol)
    assert (turns * R.inv()).magnitude().max() < 2.0 * atol


MOTIVES = {
    "metres": motive(),
    "millimetres": motive("Millimeters", 1e3),
    "with parents": motive(more="\n,Parent" + "," * 20),
}


@pytest.mark.parametrize("text", MOTIVES.values(), ids=MOTIVES)
def test_rigid_bodies_of_motive(tmp_path: Path, text: str) -> None:
    found = read_export(written(tmp_path, "take.csv", text))
    assert found.frames
    assert {p.point for p in found.points} == {"flange", "stand"}
    assert [p.group for p in found.points if p.point == "flange"] == [str(f) for f in FRAMES]
    assert_frames(found, "flange", [0, 1, 2, 3])
    assert_frames(found, "stand", [0, 3])
    with pytest.raises(InputError, match="holds 2 bodies, flange, stand; leave --marker out"):
        read_export(tmp_path / "take.csv", body="b")


@pytest.mark.parametrize("section", ["Objects", "Segments"])
@pytest.mark.parametrize("mark", [",", ";"])
@pytest.mark.parametrize("rotation", ["quaternion", "deg", "rad"])
def test_bodies_of_vicon(tmp_path: Path, rotation: str, mark: str, section: str) -> None:
    text = vicon(rotation == "quaternion", mark, rotation, section)
    found = read_export(written(tmp_path, "take.csv", text))
    assert {p.point for p in found.points} == {"flange", "arm:wrist"}
    assert_frames(found, "flange", [0, 1, 2, 3], atol=1e-7)
    assert_frames(found, "arm:wrist", [0, 2, 3], atol=1e-7)
    assert bool(found.notes) == (rotation != "quaternion")


def test_segments_of_nexus_below_other_sections(tmp_path: Path) -> None:
    before = "Devices\n1000\n,,Force\nFrame,Sub Frame,Fx\n,,N\n1,0,3.5\n1,1,3.6\n\n"
    text = before + vicon(section="Segments") + "\nTrajectories\n100\n,,m1\nFrame,Sub Frame,X,Y,Z\n"
    found = read_export(written(tmp_path, "take.csv", text))
    assert_frames(found, "flange", [0, 1, 2, 3], atol=1e-7)


FAULTS: dict[str, tuple[str, str]] = {
    "no header": ("\n".join([motive().split("\n")[0], "1,2,3"]), "no header of types and names"),
    "no place": (motive().replace("Position", "Pos"), "has not all of rotation X Y Z W"),
    "unseen": ("\n".join(motive().split("\n")[:7]) + "\n", "holds no frame that saw a body"),
    "two units": (vicon().replace("mm", "cm", 1), "line 5: states no one unit of the place"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "said"), FAULTS.values(), ids=FAULTS)
def test_recordings_that_cannot_be_read(tmp_path: Path, text: str, said: str) -> None:
    path = written(tmp_path, "take.csv", text)
    with pytest.raises(InputError, match=said) as error:
        read_export(path)
    assert "\n" not in str(error.value)


def joint_table(folder: Path, names: list[str]) -> Path:
    rows = "".join(f"{name},{k}.5,{-k}\n" for k, name in enumerate(names))
    return written(folder, "joints.csv", "pose,j1_deg,j2_deg\n" + rows)


def test_frames_that_the_joint_file_names(tmp_path: Path) -> None:
    found = read_export(written(tmp_path, "take.csv", motive()))
    joints = read_joints(joint_table(tmp_path, ["11", "40"]))
    joined = join([found], joints, partial=True, instrument="capture")
    assert joined.columns[:3] == ("pose", "marker", "instrument")
    assert [row[:4] for row in joined.rows if row[1] == "flange"] == [
        ["11", "flange", "capture", "0.5"],
        ["40", "flange", "capture", "1.5"],
    ]
    table = np.array([[float(v) for v in row[-7:]] for row in joined.rows if row[1] == "flange"])
    np.testing.assert_allclose(table[:, :3], 1e3 * PLACES[[0, 3]], atol=1e-3)


def test_a_recording_for_each_pose_is_averaged(tmp_path: Path) -> None:
    """The mean of frames that scatter is nearer to the truth than one frame; their scatter is told."""
    lists, count = [], 200
    for k in range(3):
        rng = np.random.default_rng(k)
        rows = [["Objects"], ["100"], ["", "", "b"], ["Frame", "Sub Frame", *_TITLES], _UNITS]
        for frame in range(1, count + 1):
            turn = TURNS[k] * Rotation.from_rotvec(rng.normal(scale=1e-3, size=3))
            place = 1e3 * PLACES[k] + rng.normal(scale=0.3, size=3)
            rows.append([str(frame), "0", *(f"{v:.9f}" for v in (*turn.as_quat(), *place))])
        text = "\n".join(",".join(row) for row in rows)
        lists.append(read_export(written(tmp_path, f"p{k}.csv", text)))
    joined = join(lists, read_joints(joint_table(tmp_path, ["p0", "p1", "p2"])))
    assert [row[0] for row in joined.rows] == ["p0", "p1", "p2"]
    table = np.array([[float(v) for v in row[-7:]] for row in joined.rows])
    assert np.abs(table[:, :3] - 1e3 * PLACES[:3]).max() < 4.0 * 0.3 / np.sqrt(count)
    off = Rotation.from_quat(table[:, [4, 5, 6, 3]]) * TURNS[[0, 1, 2]].inv()
    assert off.magnitude().max() < 5e-3 / np.sqrt(count)
    (said,) = joined.notes
    assert said.startswith("200 frames of a pose are averaged; they scatter by 0.5")  # sqrt(3) 0.3
    assert " 1.7 mrad" in said


_TITLES = ["RX", "RY", "RZ", "RW", "TX", "TY", "TZ"]
_UNITS = ["", "", "", "", "", "", "mm", "mm", "mm"]


def test_lists_of_two_kinds_are_not_joined(tmp_path: Path) -> None:
    found = read_export(written(tmp_path, "take.csv", motive()))
    joints = read_joints(joint_table(tmp_path, ["11", "40"]))
    other = read_export(written(tmp_path, "p.txt", "// units: mm\na,m1,1,2,3\n"))
    with pytest.raises(InputError, match="import each kind for itself"):
        join([found, other], joints)


# -- samples of hand-eye calibrations ------------------------------------------------------------


def ros(T: int) -> dict[str, dict[str, float]]:
    x, y, z, w = (float(v) for v in TURNS[T].as_quat())
    place = dict(zip("xyz", map(float, PLACES[T]), strict=True))
    return {"translation": place, "rotation": {"x": x, "y": y, "z": z, "w": w}}


def rows(T: int) -> list[float]:
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = TURNS[T].as_matrix(), PLACES[T]
    return [float(v) for v in M.ravel()]


def dumped(fields: object) -> str:
    return pytest.importorskip("yaml").safe_dump(fields)


SAMPLES: dict[str, tuple[str, Callable[[], object]]] = {
    "easy_handeye": (".yaml", lambda: [{"robot": ros(3 - k), "optical": ros(k)} for k in range(4)]),
    "stamped": (
        ".yaml",
        lambda: [
            {"robot": {"transform": ros(0)}, "optical": {"transform": ros(k)}} for k in range(4)
        ],
    ),
    "message": (
        ".yml",
        lambda: {
            "samples": {
                "hand_world_samples": [ros(3 - k) for k in range(4)],
                "camera_marker_samples": [ros(k) for k in range(4)],
            }
        },
    ),
    "older message": (
        ".yaml",
        lambda: {"camera_marker_samples": {"transforms": [ros(k) for k in range(4)]}},
    ),
    "moveit": (
        ".yaml",
        lambda: [{"effector_wrt_world": rows(0), "object_wrt_sensor": rows(k)} for k in range(4)],
    ),
    "json": (".json", lambda: {"samples": [{"tracking": ros(k)} for k in range(4)]}),
}


@pytest.mark.parametrize("eye", get_args(Eye))
@pytest.mark.parametrize(("suffix", "fields"), SAMPLES.values(), ids=SAMPLES)
def test_samples(tmp_path: Path, suffix: str, fields: Callable[[], object], eye: Eye) -> None:
    text = json.dumps(fields(), indent=1) if suffix == ".json" else dumped(fields())
    found = read_export(written(tmp_path, f"s{suffix}", text), body="tool", eye=eye)
    assert not found.frames
    assert [p.group for p in found.points] == ["1", "2", "3", "4"]
    assert_frames(found, "tool", [0, 1, 2, 3], atol=2e-9, back=eye == "in-hand")


def test_samples_that_say_where_the_camera_is(tmp_path: Path) -> None:
    fields = {
        "parameters": {"calibration_type": "eye_in_hand", "robot_base_frame": "base_link"},
        "samples": [{"robot": ros(0), "tracking": ros(k)} for k in range(4)],
    }
    path = written(tmp_path, "s.yaml", dumped(fields))
    assert_frames(read_export(path, body="cam"), "cam", [0, 1, 2, 3], atol=2e-9, back=True)
    with pytest.raises(InputError, match="says eye in-hand; leave --eye out"):
        read_export(path, body="cam", eye="on-base")


def test_samples_with_the_joint_states_of_moveit(tmp_path: Path) -> None:
    samples = [{"effector_wrt_world": rows(0), "object_wrt_sensor": rows(k)} for k in range(4)]
    values = RNG.uniform(-3, 3, (4, 3)).tolist()
    states = {"joint_names": ["a", "b", "c"], "joint_values": values}
    joints = read_joints(written(tmp_path, "j.yaml", dumped(states)))
    assert joints.joints == ("a_rad", "b_rad", "c_rad")
    path = written(tmp_path, "s.yaml", dumped(samples))
    joined = join([read_export(path, body="board", eye="on-base")], joints)
    assert [[float(v) for v in row[2:5]] for row in joined.rows] == values
    states["joint_values"] = values[:3]
    fewer = read_joints(written(tmp_path, "k.yaml", dumped(states)))
    with pytest.raises(InputError, match=r"1 pose .4. without joints"):
        join([read_export(path, body="board", eye="on-base")], fewer)


_POSED = "translation: {x: 1, y: 2, z: 3}, rotation: {x: 0, y: 0, z: 0, w: 2}"
SAMPLE_FAULTS = {
    "no quaternion": ("- optical: {translation: {x: 1, y: 2, z: 3}}\n", "1: has no rotation"),
    "a length of two": (f"- optical: {{{_POSED}}}\n", "1: has a quaternion of length 2"),
    "a shear": (f"- object_wrt_sensor: {[1, 1, *[0] * 14]}\n", "1: is no transform of 4 x 4"),
    "a word": (f"- optical: {{{_POSED.replace('1', 'near')}}}\n", "line 1: 'near' is no number"),
}


@pytest.mark.parametrize(("text", "said"), SAMPLE_FAULTS.values(), ids=SAMPLE_FAULTS)
def test_samples_that_cannot_be_read(tmp_path: Path, text: str, said: str) -> None:
    path = written(tmp_path, "s.yaml", text)
    with pytest.raises(InputError, match=said):
        read_export(path, body="b", eye="in-hand")
