"""``posecal import`` as a user and an outside check see it."""

from __future__ import annotations

import hashlib
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import calib
from calib.files.write_tables import measurements_csv
from studies.demo.embedded import embedded_text, simulated
from tests.calib.files.test_images import charuco
from tests.camera_cells import PINHOLE, camera_cell, kr270_cell
from tests.studies.command_line import paper_cell
from tests.studies.command_line import run as posecal

run = partial(posecal, "import")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cell, simulated measurements, and the same as an instrument and a controller write them."""
    path = tmp_path_factory.mktemp("import")
    cell = calib.load_cell(paper_cell(path))
    data, _, _ = simulated(cell, calib.load_plan(cell, path / "plan.csv"), 3)
    text = measurements_csv(cell, data)
    (path / "measured.csv").write_text(text)
    header, *rows = (line.split(",") for line in text.splitlines())
    x = header.index("x_mm")
    points = "".join(f"A,  {r[0]},  {r[1]},  " + ",  ".join(r[x : x + 3]) + "\r\n" for r in rows)
    (path / "points.txt").write_text("// Frame A::WORLD\n" + points, newline="")
    joints = dict.fromkeys(";".join([r[0], *r[2:x], *r[x + 3 :]]).replace(".", ",") for r in rows)
    titles = [h.replace("_deg", " [°]") for h in header[:x] + header[x + 3 :]]
    titles.remove("marker")
    (path / "joints.csv").write_text("\n".join([";".join(titles), *joints]), encoding="utf-8")
    return path


def test_joined_table_is_the_measured_one(folder: Path) -> None:
    out, result = folder / "joined.csv", folder / "joined.json"
    done = run(
        folder / "points.txt", "--joints", folder / "joints.csv", "--unit", "mm",
        "--cell", folder / "cell.toml", "-o", out, "--json", result,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "30 poses, 90 points" in done.output
    cell = calib.load_cell(folder / "cell.toml")
    ours, truth = (calib.load_measurements(cell, p) for p in (out, folder / "measured.csv"))
    assert ours.poses.names == truth.poses.names
    for name in ("q", "wrench"):
        np.testing.assert_array_equal(getattr(ours.poses, name), getattr(truth.poses, name))
    np.testing.assert_array_equal(ours.points, truth.points)
    np.testing.assert_array_equal(ours.seen, truth.seen)
    fields = json.loads(result.read_text(), parse_constant=pytest.fail)
    assert (fields["schema"], fields["command"], fields["names"]) == (
        1,
        "import",
        "{pose}::{marker}",
    )
    assert (fields["poses"], fields["points"]) == (30, 90)
    assert fields["markers"] == {"m1": 30, "m2": 30, "m3": 30}
    named = {Path(entry["file"]).name: entry["sha256"] for entry in fields["inputs"]}
    assert set(named) == {"points.txt", "joints.csv", "cell.toml", "kr270.urdf"}
    assert named["points.txt"] == hashlib.sha256((folder / "points.txt").read_bytes()).hexdigest()


def test_a_table_that_cannot_be_read_back_is_not_written(folder: Path, tmp_path: Path) -> None:
    """A marker of the cell that no point shows is a fault of the whole table; --partial allows it."""
    lines = (folder / "points.txt").read_text().splitlines()
    (tmp_path / "p.txt").write_text("\n".join(line for line in lines if ",  m3," not in line))
    options = ["--unit", "mm", "--cell", folder / "cell.toml", "-o", tmp_path / "out.csv"]
    done = run(tmp_path / "p.txt", "--joints", folder / "joints.csv", *options)
    assert done.exit_code == 2
    assert "out.csv: as joined, marker m3: is in the cell's" in done.stderr
    assert not (tmp_path / "out.csv").exists()
    done = run(tmp_path / "p.txt", "--joints", folder / "joints.csv", "--partial", *options)
    assert done.exit_code == 0, done.output
    assert "60 points" in done.output


def test_joints_of_another_robot_are_refused_with_the_way_to_rename(
    folder: Path, tmp_path: Path
) -> None:
    text = (folder / "joints.csv").read_text(encoding="utf-8").replace("A", "axis")
    (tmp_path / "j.csv").write_text(text, encoding="utf-8")
    options = ["--unit", "mm", "--cell", folder / "cell.toml", "-o", tmp_path / "out.csv"]
    done = run(folder / "points.txt", "--joints", tmp_path / "j.csv", *options)
    assert done.exit_code == 2
    assert "--joint-names A1,A2,A3,A4,A5,A6" in done.stderr
    again = ["--joint-names", "A1,A2,A3,A4,A5,A6"]
    done = run(folder / "points.txt", "--joints", tmp_path / "j.csv", *options, *again)
    assert done.exit_code == 0, done.output


CAPTURED = """schema = 1
[robot]
urdf = "kr270.urdf"
base = "base_link"
tip = "tool0"
[bodies.eye]
[instruments.board]
kind = "pose"
sigma_mm = 0.1
sigma_urad = 100
[model]
effects = ["base", "tool"]
"""


def test_samples_of_moveit_are_readings_of_the_camera(folder: Path) -> None:
    """Joint states and samples of an eye in the hand, by SciPy, as the one body of the cell."""
    (folder / "captured.toml").write_text(CAPTURED)
    rng = np.random.default_rng(1)
    q, T = rng.uniform(-1.0, 1.0, (6, 6)), np.tile(np.eye(4), (6, 1, 1))
    T[:, :3, :3], T[:, :3, 3] = Rotation.random(6, rng=rng).as_matrix(), rng.normal(size=(6, 3))
    samples = [
        {"effector_wrt_world": np.eye(4).ravel().tolist(), "object_wrt_sensor": own.tolist()}
        for own in T.reshape(6, 16)
    ]
    names = [f"A{k}" for k in range(1, 7)]
    (folder / "samples.json").write_text(json.dumps(samples))
    (folder / "states.json").write_text(
        json.dumps({"joint_names": names, "joint_values": q.tolist()}, indent=2)
    )
    out = folder / "captured.csv"
    done = run(
        folder / "samples.json", "--joints", folder / "states.json", "--eye", "in-hand",
        "--cell", folder / "captured.toml", "--instrument", "board", "-o", out,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "6 poses, 6 readings" in done.output
    said = " ".join(done.output.split())
    assert "poses of the camera in the board's frame, as the body eye" in said
    cell = calib.load_cell(folder / "captured.toml")
    data = calib.load_measurements(cell, out)
    np.testing.assert_allclose(data.poses.q, q, atol=1e-12)
    back = np.linalg.inv(T)
    np.testing.assert_allclose(data.readings[:, 0, :3], back[:, :3, 3], atol=1e-8)
    axes = np.swapaxes(back[:, :3, :2], 1, 2).reshape(6, 6)
    np.testing.assert_allclose(data.readings[:, 0, 3:9], axes, atol=1e-8)


def test_a_recording_a_pose(folder: Path) -> None:
    """Files are named as the poses of the joint file; each of their frames sees the body."""
    (folder / "captured.toml").write_text(CAPTURED)
    for k in range(3):
        rows = [f"{frame},0,0,0,90,{100 * k},0,{frame}" for frame in (1, 2, 3)]
        head = "Objects\n100\n,,eye:eye,,,,,\nFrame,Sub Frame,RX,RY,RZ,TX,TY,TZ\n"
        text = head + ",,deg,deg,deg,mm,mm,mm\n" + "\n".join(rows)
        (folder / f"take{k}.csv").write_text(text)
    joints = "pose," + ",".join(f"A{k}_deg" for k in range(1, 7)) + "\n"
    joints += "".join(f"take{k},{k},-90,90,0,0,{k}\n" for k in (2, 0, 1))
    (folder / "takes.csv").write_text(joints)
    out = folder / "captured.csv"
    takes = [folder / f"take{k}.csv" for k in range(3)]
    done = run(
        *takes, "--joints", folder / "takes.csv", "--cell", folder / "captured.toml", "-o", out
    )
    assert done.exit_code == 0, done.output
    assert "3 frames of a pose are averaged; they scatter by 0.82 mm" in done.output
    data = calib.load_measurements(calib.load_cell(folder / "captured.toml"), out)
    assert data.poses.names == ("take2", "take0", "take1")
    np.testing.assert_allclose(data.readings[:, 0, 0], [0.2, 0.0, 0.1], atol=1e-9)
    np.testing.assert_allclose(data.readings[:, 0, 3:6], [[0.0, 1.0, 0.0]] * 3, atol=1e-9)


SEEN = camera_cell("squares = [9, 6]\npitch_mm = 30", PINHOLE, "kr270.urdf", "base_link", "tool0")


def test_images_of_a_board(tmp_path: Path) -> None:
    """Each image is the pose of its name; one that shows no board is left out, and said."""
    photographs = pytest.importorskip("tests.photographs")
    cv2 = photographs.cv2
    i, j = np.indices((540, 810)) // 90
    drawn, truth = np.where((i + j) % 2 == 0, 0, 255).astype(np.uint8), {}
    (tmp_path / "images").mkdir()
    for k in range(2):
        T = photographs.facing(0.2 * k, (0.3 * k, 0.1), (0.25, 0.18), 0.5)
        image = photographs.photograph("homography", drawn, T)
        cv2.imwrite(str(tmp_path / "images" / f"shot{k}.png"), image)
        truth[k] = photographs.pixels(np.array([[0.03, 0.03, 0.0], [0.24, 0.15, 0.0]]), T)
    cv2.imwrite(str(tmp_path / "images" / "shot2.png"), np.full((720, 960), 90, np.uint8))
    (tmp_path / "kr270.urdf").write_text(embedded_text("kr270.urdf"))
    cell, joints, out = (tmp_path / name for name in ("cell.toml", "joints.csv", "out.csv"))
    cell.write_text(SEEN)
    table = "pose," + ",".join(f"A{k}_deg" for k in range(1, 7)) + "\n"
    joints.write_text(table + "".join(f"shot{k},{k},-90,90,0,0,{k}\n" for k in (1, 2, 0)))
    call = [tmp_path / "images", "--joints", joints, "-o", out, "--board", "b"]
    done = run(*call, "--cell", cell)
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "images 2 of 3 count, 40 points each" in said
    assert "image that does not count" in said
    assert "shot2.png cam no board" in said
    data = calib.load_measurements(calib.load_cell(cell), out)
    assert data.poses.names == ("shot1", "shot0")
    for row, k in enumerate((1, 0)):
        np.testing.assert_allclose(data.readings[row, [0, 39]], truth[k], atol=0.1)
    by_order = run(*call, "--cell", cell, "--by-order", "--json", tmp_path / "r.json")
    assert by_order.exit_code == 0, by_order.output
    fields = json.loads((tmp_path / "r.json").read_text())
    assert (fields["poses"], fields["lists"][0]["unit"]) == (2, "px")
    assert len(fields["inputs"]) == 6
    assert out.read_text().splitlines()[1].startswith("shot0,b:0,1,")
    for more, said in (
        (call, "names a board of a cell; give --cell"),
        (
            [*call[1:], tmp_path / "images" / "shot0.png", "--cell", cell],
            "of the joint file without",
        ),
        ([*call, tmp_path / "images" / "shot0.png", "--cell", cell], "named as another image"),
        ([tmp_path / "images" / "shot0.png", *call[1:5]], "is an image; say what it shows"),
    ):
        wrong = run(*more)
        assert wrong.exit_code == 2
        assert said in wrong.stderr
        assert wrong.stderr.count("\n") == 1


def test_reasons_of_images_that_do_not_count(tmp_path: Path) -> None:
    """Blurred, of another size, with too few points: each is named; the page shows all."""
    photographs = pytest.importorskip("tests.photographs")
    cv2, drawn = photographs.cv2, charuco()
    (tmp_path / "images").mkdir()
    for k in range(4):
        T = photographs.facing(0.2 * k, (0.2 * k, 0.1), (0.27, 0.18), 0.5)
        image = photographs.photograph("homography", drawn, T)
        cv2.imwrite(str(tmp_path / "images" / f"s{k}.png"), image)
    hidden = image.copy()
    hidden[:, 330:] = 128
    hidden[:330] = 128
    for name, other in (
        ("s4", cv2.GaussianBlur(image, (0, 0), 2.5)),
        ("s5", cv2.resize(image, (640, 480))),
        ("s6", hidden),
        ("s7", cv2.GaussianBlur(image, (0, 0), 30.0)),
    ):
        cv2.imwrite(str(tmp_path / "images" / f"{name}.png"), other)
    (tmp_path / "kr270.urdf").write_text(embedded_text("kr270.urdf"))
    (tmp_path / "cell.toml").write_text(SEEN.replace("30\n", "30\n" + CODED, 1))
    rows = "".join(f"s{k},{k},-90,90,0,0,{k}\n" for k in (*range(1, 8), 9))
    head = "pose," + ",".join(f"A{k}_deg" for k in range(1, 7)) + "\n"
    (tmp_path / "joints.csv").write_text(head + rows)
    done = run(
        tmp_path / "images", "--joints", tmp_path / "joints.csv", "--board", "b", "--partial",
        "--cell", tmp_path / "cell.toml", "-o", tmp_path / "out.csv", "--json", tmp_path / "r.json",
        "--page", tmp_path / "page.html",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    images = json.loads((tmp_path / "r.json").read_text())["images"]
    reasons = {own["pose"]: own["reason"] for own in images}
    assert [reasons[f"s{k}"] for k in range(4)] == ["no joints", "", "", ""]
    assert reasons["s4"].startswith("blurred: edges are smeared by ")
    assert reasons["s5"] == "other size: 640 x 480 px, not 960 x 720"
    assert reasons["s6"].startswith(("too few points (", "no board"))
    assert reasons["s7"] == "no board, blurred"
    assert "1 pose (s9)" in done.output
    page = (tmp_path / "page.html").read_text()
    assert page.count("data:image/jpeg;base64,") == len(images)
    assert page.count('class="bad"') == sum(bool(reason) for reason in reasons.values())
    assert "s5: other size: 640 x 480 px" in page


def test_a_recording_and_two_cameras(tmp_path: Path) -> None:
    """A recording needs no joint file; folders are named as the cameras, and whole tables join."""
    photographs = pytest.importorskip("tests.photographs")
    bags = pytest.importorskip("tests.ros_bags")
    drawn, stops = charuco(), np.radians([[0, -90, 90, 0, 0, 0], [20, -85, 80, -5, 9, 3]])
    cell = kr270_cell(tmp_path, *_BOTH, effects=("base", "tool"))
    states, images = [], []
    for k, q in enumerate(stops):
        T = photographs.facing(0.2 * k, (0.2, 0.1), (0.27, 0.18), 0.5)
        pixels = photographs.photograph("homography", drawn, T)
        for name in ("left", "right"):
            (tmp_path / name).mkdir(exist_ok=True)
            photographs.cv2.imwrite(str(tmp_path / name / f"stop00{k + 1}.png"), pixels)
        for time in np.arange(3.0 * k, 3.0 * k + 2.0, 0.1).tolist():
            states.append((time, bags.joint_state([f"A{n}" for n in range(1, 7)], q, time)))
        images.append((3.0 * k + 1.0, bags.image(pixels, 3.0 * k + 1.0)))
    day = bags.written(
        tmp_path / "day", {"/joint_states": states, "/left/image": images, "/right/image": images}
    )
    table, joints = tmp_path / "out.csv", tmp_path / "joints.csv"
    done = run(day, "--board", "b", "--cell", cell, "-o", table)
    assert done.exit_code == 0, done.output
    assert "/left/image: 2 of 2 images taken, one at each of 2 stops" in done.output
    recorded = calib.load_measurements(calib.load_cell(cell), table)
    assert recorded.poses.names == ("stop001", "stop002")
    np.testing.assert_allclose(recorded.poses.q, stops, atol=1e-6)
    head, rows = "pose," + ",".join(f"A{k}_rad" for k in range(1, 7)), enumerate(stops, 1)
    lines = [f"stop00{k}," + ",".join(map(str, q)) for k, q in rows]
    joints.write_text("\n".join([head, *lines]))
    both = [tmp_path / "left", tmp_path / "right"]
    done = run(*both, "--joints", joints, "--board", "b", "--cell", cell, "-o", table)
    assert done.exit_code == 0, done.output
    found = calib.load_measurements(calib.load_cell(cell), table)
    np.testing.assert_allclose(found.readings, recorded.readings, atol=1e-9)
    apart = []
    for own in both:
        apart.append(tmp_path / f"{own.name}.csv")
        done = run(own, "--instrument", own.name, "--joints", joints, "--board", "b",
                   "--cell", cell, "-o", apart[-1])  # fmt: skip
        assert done.exit_code == 0, done.output
    done = run(*apart, "--cell", cell, "-o", table)
    assert done.exit_code == 0, done.output
    joined = calib.load_measurements(calib.load_cell(cell), table)
    np.testing.assert_array_equal(joined.readings, found.readings)
    for call, said in (
        ([both[0], "--topic", "/left/image"], "--topic: is of recordings"),
        ([day, "--joints", joints], "which holds the joints"),
        ([tmp_path / "left" / "stop001.png", "--joints", joints], "of the cameras left, right"),
    ):
        wrong = run(*call, "--board", "b", "--cell", cell, "-o", table)
        assert wrong.exit_code == 2
        assert said in wrong.stderr


CODED = 'marker_mm = 22\ndictionary = "5x5_100"\n'
_BOTH = [f'[boards.b]\non = "tip"\nsquares = [9, 6]\npitch_mm = 30\n{CODED}']
_BOTH += [
    f'[instruments.{n}]\nkind = "camera"\non = "world"\n{PINHOLE}\n' for n in ("left", "right")
]


def _in_quotes(text: str) -> str:
    head, *rows = text.strip().split("\n")
    shown = [[f'"{f.replace(".", ",")}"' if "." in f else f for f in r.split(",")] for r in rows]
    return "\n".join([head, *map(",".join, shown), ""])


_WRITTEN = {
    "tabs": lambda t: t.replace(",", "\t"),
    "semicolons and decimal commas": lambda t: t.replace(",", ";").replace(".", ","),
    "decimal commas in quotes": _in_quotes,
    "blanks": lambda t: t.replace(",", " "),
    "a title": lambda t: "Report of the day\n" + t,
    "two titles": lambda t: f"Report of the day,,,\nOperator: nobody,,\n{t}",
    "Windows": lambda t: t.replace(",", ";").replace("\n", "\r\n"),
}


@pytest.mark.parametrize("how", _WRITTEN)
def test_a_whole_table_is_read_as_it_was_meant(folder: Path, tmp_path: Path, how: str) -> None:
    (tmp_path / "day.txt").write_text(
        _WRITTEN[how]((folder / "measured.csv").read_text()), newline=""
    )
    done = run(tmp_path / "day.txt", "--cell", folder / "cell.toml", "-o", tmp_path / "new.csv",
               "--json", tmp_path / "new.json")  # fmt: skip
    assert done.exit_code == 0, done.output
    cell = calib.load_cell(folder / "cell.toml")
    ours, truth = (
        calib.load_measurements(cell, p) for p in (tmp_path / "new.csv", folder / "measured.csv")
    )
    assert ours.poses.names == truth.poses.names
    np.testing.assert_array_equal(ours.poses.q, truth.poses.q)
    np.testing.assert_array_equal(ours.readings, truth.readings)
    fields = json.loads((tmp_path / "new.json").read_text(), parse_constant=pytest.fail)
    assert (fields["poses"], fields["points"]) == (30, 90)
    assert fields["markers"] == {"m1": 30, "m2": 30, "m3": 30}
