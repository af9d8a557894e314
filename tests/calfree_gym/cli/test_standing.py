"""`calfree check`, `watch`, `marks` and `pick`, on the bench: nothing moves."""

import http.client
import socket
import sys
import threading
import time
import urllib.parse
import urllib.request
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from calfree_gym.cli.drawing import MARKS, drawn, pixels
from calfree_gym.cli.standing import StandingRobot
from calfree_gym.cli.watch import Page
from tests.calfree_gym.cli.bench import calfree

ROUND = np.array([np.cos(np.linspace(0, 2 * np.pi, 60)), np.sin(np.linspace(0, 2 * np.pi, 60))])


def test_rings_are_drawn_where_gripper_and_object_are(robot):
    """Against the bench's own geometry, its lens apart."""
    standing = StandingRobot(robot, ("left", "right"))
    robot.place_object()
    look = standing.look()
    for camera in range(2):
        picture, found = drawn(look, camera), pixels(look, camera)
        there = [robot.world.images(point)[camera] for point in (robot.grip(), robot.plant.data.mocap_pos[0])]
        np.testing.assert_allclose(found, (np.array(there) * [1, -1] + 1) * [320, 240], atol=6)
        for middle, colour in zip(np.round(found), MARKS.values(), strict=True):
            x, y = np.round(middle[:, None] + 14 * ROUND).astype(int)
            ring = np.abs(picture[y, x].astype(int) - colour).sum(-1) < 100
            assert ring.mean() > 0.5, "but for where the other ring or a word covers it"


def test_check_tells_that_all_is_well_and_moves_nothing(robot, power, tmp_path, capsys):
    stood = robot.plant.targets.copy()
    assert calfree(["check", f"--out={tmp_path}"], robot) == 0
    told = capsys.readouterr().out
    assert "All is well." in told
    assert told.count("seen in 5 of 5 looks") == 4
    assert f"shoulder_pan: at {robot.bus.degrees({'it': robot.bus.ticks()[0]})['it']:.1f} degrees" in told
    np.testing.assert_array_equal(robot.plant.targets, stood)
    for name in ("left", "left-seen", "right", "right-seen"):
        assert cv2.imread(str(tmp_path / f"{name}.png")).shape == (480, 640, 3)
    assert power.read_text() == "off", "somebody supports the arm"


def test_check_names_what_is_wrong(robot, power, tmp_path, capsys):
    robot.world.zeros[2] += 100 - robot.bus.ticks()[2]
    robot.hidden.add("gripper_1")
    robot.cameras["right"].frozen = True
    robot.cameras["right"].latest(robot.clock(), None, robot._scene)
    robot.cameras["right"]._frame = np.full((480, 640, 3), 99, np.uint8)
    assert calfree(["check", f"--out={tmp_path}"], robot, supports=False) == 1
    told = capsys.readouterr().out
    assert "WRONG: motor elbow_flex is at 10" in told
    assert "robot.bus.set_half_turn_homings(['elbow_flex'])" in told
    assert "WRONG: the gripper is seen by camera left in 0 of 5 looks" in told
    assert "WRONG: the object is seen by camera left" not in told
    assert "WRONG: camera right has shown one picture 5 times: it is frozen" in told
    del robot
    assert power.read_text() == "on", "nobody supports the arm"


def test_warnings_are_told_in_words(robot, tmp_path, capsys):
    robot.config = SimpleNamespace()
    calfree(["check", f"--out={tmp_path}"], robot)
    assert "\nwarning: the robot's config has no" in f"\n{capsys.readouterr().err}"


def interrupted(robot, looks):
    """The robot, at whose next look but so many somebody presses Ctrl-C."""
    observe, left = robot.get_observation, iter(range(looks))

    def get_observation():
        if next(left, None) is None:
            raise KeyboardInterrupt
        return observe()

    robot.get_observation = get_observation
    return robot


def test_watch_writes_a_file_until_ctrl_c(robot, tmp_path):
    file = tmp_path / "now.jpg"
    assert calfree(["watch", f"--out={file}"], interrupted(robot, 2)) == 0
    assert cv2.imread(str(file)).shape == (360, 960, 3)


def test_watch_shows_lerobots_viewer_what_is_seen(robot, monkeypatch):
    shown = []
    viewer = SimpleNamespace(
        init_visualization=lambda mode, session_name: shown.append(mode),
        log_visualization_data=lambda mode, observation: shown.append(observation),
    )
    for name in ("lerobot", "lerobot.utils", "lerobot.utils.visualization_utils"):
        monkeypatch.setitem(sys.modules, name, viewer)
    assert calfree(["watch", "--display_data=true"], interrupted(robot, 2)) == 0
    mode, *pictures = shown
    assert mode == "rerun"
    assert [{name: each.shape for name, each in two.items()} for two in pictures] == [
        {"left": (480, 640, 3), "right": (480, 640, 3)}
    ] * 2


def test_watch_tells_its_page(robot, capsys):
    assert calfree(["watch", "--port=0"], interrupted(robot, 1)) == 0
    assert "http://127.0.0.1:" in capsys.readouterr().out


def test_a_camera_that_is_gone_ends_watch(robot, capsys):
    robot.cameras["left"].unplugged = True
    assert calfree(["watch", "--port=0"], robot) == 1
    assert "OpenCVCamera(left) latest frame is too old" in capsys.readouterr().err


@pytest.fixture
def page(monkeypatch):
    monkeypatch.setattr("calfree_gym.cli.watch.PATIENCE_S", 0.1)
    page = Page(0)
    page._picture, page._number = b"picture", 1
    yield page
    page.close()


@pytest.mark.parametrize(
    ("host", "status"),
    [("127.0.0.1:{}", 200), ("localhost:{}", 200), ("evil.example:{}", 403), ("127.0.0.1", 403), ("", 403)],
)
def test_the_page_is_shown_under_no_other_name_and_within_no_other_page(page, host, status):
    port = urllib.parse.urlsplit(page.address).port
    asking = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    for path in ("/", "/stream"):
        asking.request("GET", path, headers={"Host": host.format(port)})
        answer = asking.getresponse()
        assert answer.status == status
        assert answer.headers["Cross-Origin-Resource-Policy"] == ("same-origin" if status == 200 else None)
        asking.close()


def test_no_thread_is_left_of_who_has_gone_or_asks_for_nothing(page):
    address, before = ("127.0.0.1", urllib.parse.urlsplit(page.address).port), threading.active_count()
    silent = socket.create_connection(address)
    for _ in range(5):
        with urllib.request.urlopen(f"{page.address}stream", timeout=10) as stream:
            stream.read(5)
    until = time.monotonic() + 20
    while threading.active_count() > before and time.monotonic() < until:
        time.sleep(0.05)
    assert threading.active_count() <= before
    silent.close()


def test_the_page_shows_what_was_seen_last(robot):
    standing, page = StandingRobot(robot, ("left", "right")), Page(0)
    try:
        page(standing.look())
        with urllib.request.urlopen(page.address, timeout=10) as shown:
            assert b'<img src="stream"' in shown.read()
        with urllib.request.urlopen(f"{page.address}stream", timeout=10) as stream:
            assert stream.headers.get_content_type() == "multipart/x-mixed-replace"
            head = [stream.readline().decode().strip() for _ in range(4)]
            length = int(head[2].removeprefix("Content-Length: "))
            picture = cv2.imdecode(np.frombuffer(stream.read(length), np.uint8), cv2.IMREAD_COLOR)
        assert picture.shape == (360, 960, 3)
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"{page.address}etc", timeout=10)
    finally:
        page.close()


@pytest.mark.parametrize("paper", ["A4", "Letter"])
def test_marks_writes_the_page_of_tags(paper, tmp_path):
    file = tmp_path / "tags.pdf"
    assert calfree(["marks", f"--paper={paper}", f"--out={file}"], None) == 0
    assert file.read_bytes().startswith(b"%PDF")


def test_pick_is_that_of_the_package_of_vision(tmp_path, capsys):
    picture = np.full((200, 200, 3), 120, np.uint8)
    cv2.circle(picture, (100, 100), 12, (30, 200, 40), -1)
    cv2.imwrite(str(tmp_path / "room.png"), picture)
    given = ["--box", "85", "85", "30", "30", "--mark", "object", f"--out={tmp_path / 'marks.yaml'}"]
    assert calfree(["pick", str(tmp_path / "room.png"), *given], None) == 0
    assert "the tracker finds object in the box" in capsys.readouterr().out
