"""`calfree` on the bench: what it tells and writes and refuses, and that the arm holds however it ends."""

import base64
import http.client
import importlib.util
import os
import re
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

import agents
from calfree_gym.cli import main
from calfree_gym.cli import reach as command
from calfree_gym.cli.drawing import MARKS, drawn, pixels
from calfree_gym.cli.film import MARKED
from calfree_gym.cli.standing import StandingRobot
from calfree_gym.cli.watch import Page
from calfree_gym.lerobot import LeRobotReachEnv
from tests.calfree_gym.cli.bench import calfree
from tests.calfree_gym.lerobot import fake_so101
from tests.calfree_gym.lerobot.fake_so101 import FakeSO101

ROUND = np.array([np.cos(np.linspace(0, 2 * np.pi, 60)), np.sin(np.linspace(0, 2 * np.pi, 60))])


def test_rings_are_drawn_where_gripper_and_object_are(robot):
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


ROBOT = ["--robot.type=so101_follower", "--robot.port=/dev/ttyACM0", "--robot.id=arm"]


THREE = "shoulder_pan,shoulder_lift,elbow_flex"


class NoRobot:
    """One that must not be asked for anything."""

    is_connected = False


class Absent(FakeSO101):
    def connect(self, calibrate=True):
        raise RuntimeError("FeetechMotorsBus motor check failed on port '/dev/ttyACM0': Missing motor IDs: 3")


class Saved:
    """An agent that no other one can load."""

    name = "memory"

    def save(self, path):
        path.write(b"another agent's")


def code(command, robot):
    try:
        return calfree(command.split(), robot)
    except SystemExit as error:
        return error.code


NO_ANSWER = "the robot cannot be connected: FeetechMotorsBus motor check failed"


@pytest.mark.parametrize(
    ("robot", "command", "said"),
    [
        (NoRobot, "", "required: command"),
        (NoRobot, "reech", "invalid choice: 'reech'"),
        (NoRobot, "reach --robot.port=/dev/ttyACM0 --reach=3", "reach does not take --reach=3"),
        (NoRobot, "marks --robot.port=/dev/ttyACM0", "marks does not take --robot.port"),
        (NoRobot, "marks --paper=A3", "invalid choice: 'A3'"),
        (NoRobot, "marks --out=none/tags.pdf", "none/tags.pdf"),
        (NoRobot, "watch --display_data=maybe", "'maybe' is neither true nor false"),
        (
            NoRobot,
            "check --marks=tag",
            "--marks tag: there is no such file; allowed: a file of colours, or tags",
        ),
        (NoRobot, "reach --agent=memorie", "agent is 'memorie' (did you mean memory?)"),
        (NoRobot, "reach --reaches=0", "reaches is 0"),
        (NoRobot, "reach --speed=fast", "invalid float value: 'fast'"),
        (NoRobot, "reach --load=none.zip", "--load none.zip: there is no such file"),
        (NoRobot, "reach --save=none/arm.zip", "--save none/arm.zip: there is no such folder"),
        (NoRobot, "reach --save=here", "--save here: there is such a file; give --load=here too"),
        (NoRobot, "reach --save=here --load=arm.calfree", "--save here: there is such a file"),
        (NoRobot, "reach --out=.", "--out .: it holds a report.html; give another folder"),
        (NoRobot, "pick none.png --box 1 1 9 9 --mark object", "none.png: there is no such file"),
        (FakeSO101, "check --cameras=left,rigth", "no camera 'rigth' (did you mean right?)"),
        (FakeSO101, "check --cameras=left", "it must be the names of two of left, right"),
        (FakeSO101, "check --motors=elbow", "no motor 'elbow' (did you mean elbow_flex?)"),
        *(
            (FakeSO101, f"{command} --motors=elbow_flex,wrist_roll", "reaching needs 3 or more")
            for command in ("check", "reach")
        ),
        (FakeSO101, "check --unit=0", "unit is 0.0; it must be a number above 0"),
        (FakeSO101, "watch --cameras=front,right", "no camera 'front'"),
        (FakeSO101, "watch --port=70000", "choose another one with --port"),
        (FakeSO101, "reach --cameras=left,rigth", "no camera 'rigth' (did you mean right?)"),
        (FakeSO101, "reach --unit=170", "smaller unit"),
        (FakeSO101, "reach --tolerance-px=-1", "tolerance_px is -1"),
        (FakeSO101, "reach --max-motions=0", "max_motions is 0"),
        (
            NoRobot,
            "reach --agent=unified_servo --unit=20 --load=arm.calfree",
            "error: arm.calfree is of unit 45.0 (here 20.0) and agent memory (here unified_servo); "
            "allowed: --unit=45.0 --agent=memory, or another file",
        ),
        (NoRobot, f"reach --load=arm.calfree --motors={THREE}", f"arm.calfree is of motors {THREE},"),
        (NoRobot, "reach --load=here", "here is no file that the environment's save has written"),
        (FakeSO101, "reach --load=arm.calfree", "error: arm.calfree is damaged"),
        *((Absent, command, NO_ANSWER) for command in ("check", "watch", "reach")),
    ],
)
def test_what_cannot_be_is_refused_before_anything_moves(robot, command, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("here", "other", "report.html"):
        (tmp_path / name).touch()
    if "arm.calfree" in command:
        LeRobotReachEnv(FakeSO101(), ("left", "right")).save(Saved(), "arm.calfree")
    robot = robot()
    stood = None if isinstance(robot, NoRobot) else robot.plant.targets.copy()
    assert code(command, robot) == 2
    assert said in capsys.readouterr().err
    if stood is not None:
        np.testing.assert_array_equal(robot.plant.targets, stood)


def test_from_where_no_home_can_be_the_arm_goes_to_that_of_a_file(robot, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(fake_so101, "LIMITS", (967, 3128))
    reach = f"reach --max-motions=1 --reaches=1 --unit=20 --out={tmp_path / 'out'}"
    env = LeRobotReachEnv(robot, ("left", "right"), unit=20)
    env.save(agents.make("memory", env), tmp_path / "arm.calfree")
    at = robot.bus.sync_read("Present_Position")
    robot.send_action({f"{name}.pos": value - 14 * (name == "elbow_flex") for name, value in at.items()})
    robot.sleep(2)
    assert code(reach, robot) == 2
    assert "motor elbow_flex is at" in capsys.readouterr().err
    assert code(f"{reach} --load={tmp_path / 'arm.calfree'}", robot) == 0


def test_agents_that_learn_by_rewards_are_refused(capsys):
    pytest.importorskip("stable_baselines3")
    assert code("reach --agent=ppo", NoRobot()) == 2
    assert "agent is 'ppo', which learns by rewards" in capsys.readouterr().err


def test_a_port_that_is_taken_is_told(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert code(f"watch --port={port}", FakeSO101()) == 2
    assert f"port {port}: " in capsys.readouterr().err


@pytest.mark.skipif(importlib.util.find_spec("lerobot") is not None, reason="LeRobot is installed")
@pytest.mark.parametrize("command", ["check", "watch", "reach --agent=unified_servo"])
def test_without_lerobot_it_is_said_how_to_install_it(command, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([*command.split(), *ROBOT]) == 2
    assert "pip install 'lerobot[feetech]>=0.6,<0.7', with Python 3.12" in capsys.readouterr().err


@pytest.mark.skipif(importlib.util.find_spec("lerobot") is not None, reason="LeRobot is installed")
def test_lerobots_viewer_needs_lerobot(capsys):
    assert code("watch --display_data=true", FakeSO101()) == 2
    assert "--display_data needs LeRobot" in capsys.readouterr().err


class Scripted:
    def __init__(self, env):
        self.env, self.num_timesteps, self.events = env, 0, [SimpleNamespace(kind="zoomed")]

    def learn(self, total_timesteps, callback):
        self.env.reset()
        go_on = True
        while go_on:
            self.env.step(np.full(5, 0.05, np.float32))
            self.num_timesteps += 1
            go_on = callback(self)
        if self.num_timesteps == 4:
            self.events.append(SimpleNamespace(kind="re-aimed"))


@pytest.fixture
def run(robot, tmp_path, monkeypatch):
    package = SimpleNamespace(
        names=lambda: ["scripted"],
        make=lambda name, env: Scripted(env),
        learns_by_rewards=lambda name: False,
    )
    monkeypatch.setattr(command, "agents_package", lambda: package)

    def run(*arguments, happens=None):
        given = ["reach", "--agent=scripted", "--max-motions=2", f"--out={tmp_path}", *arguments]
        code = calfree(given, robot, happens, supports=False)
        return code, (tmp_path / "report.html").read_text()

    return run


def film(folder):
    """Its pictures (h, w, 3), RGB."""
    _, found = cv2.imreadanimation(str(folder / "film.webp"))
    return [each[..., 2::-1] for each in found.frames]


def is_framed(picture):
    return np.abs(picture[100:300, :3].reshape(-1, 3).mean(0) - MARKED).max() < 60


def test_a_servo_reaches_and_the_report_tells_it(power, opengl, tmp_path, capsys):
    robot = FakeSO101(2, power)
    given = ["--agent=unified_servo", "--reaches=2", f"--out={tmp_path}", f"--save={tmp_path / 'arm.zip'}"]
    assert calfree(["reach", *given], robot) == 0
    told = capsys.readouterr().out
    motions = [int(each) for each in re.findall(r"^reach \d: reached, (\d+) motions?,", told, re.M)]
    assert len(motions) == 2
    assert (tmp_path / "arm.zip").exists()
    page = (tmp_path / "report.html").read_text()
    assert "<h1>unified_servo reached 2 of 2 times</h1>" in page
    rows = re.findall(r"<tr><td>(\d)</td><td>yes</td><td>(\d+)</td>", page)
    assert [int(found) for _, found in rows] == motions
    assert not re.search(r'(src|href)="(?!data:)', page), "it needs no other file"
    pictures = re.findall(r'src="data:image/jpeg;base64,([^"]+)"', page)
    assert len(pictures) == 4, "before and after"
    for each in pictures:
        decoded = cv2.imdecode(np.frombuffer(base64.b64decode(each), np.uint8), cv2.IMREAD_COLOR)
        assert decoded.shape == (360, 960, 3)
    assert len(film(tmp_path)) == sum(motions) + 2, "one a motion, and one from home"
    assert power.read_text() == "off", "somebody supports the arm"


def test_looks_from_home_before_the_object_is_placed_anew_are_no_motions(robot, tmp_path):
    happens = {1: lambda: robot.hidden.add("object"), 2: robot.hidden.clear}
    given = ["reach", "--agent=unified_servo", "--reaches=1", "--max-motions=3", f"--out={tmp_path}"]
    calfree(given, robot, happens)
    assert len(film(tmp_path)) == 4, "three motions, and one look from home"


def test_what_the_agent_has_noticed_is_told_and_marked(run, tmp_path, capsys):
    code, page = run("--reaches=3")
    assert code == 0
    assert "<li>in reach 2: re-aimed</li>" in page
    assert "zoomed" not in page, "it was noticed earlier"
    told = capsys.readouterr().out
    assert re.search(
        r"^reach 2: not reached, 2 motions.*\n  the agent has noticed a change: re-aimed\nreach 3", told, re.M
    )
    assert [is_framed(each) for each in film(tmp_path)] == [False] * 3 + [True] * 3 + [False] * 3


def test_a_camera_that_is_gone_ends_the_run_and_the_report_says_so(run, robot, power, capsys):
    def unplug():
        robot.cameras["left"].unplugged = True

    code, page = run("--reaches=3", happens={2: unplug})
    assert code == 1
    assert "The run could not go on" in page
    assert "OpenCVCamera(left)" in page
    assert "<h1>scripted reached 0 of 1 times</h1>" in page
    assert "The arm goes on to hold" in capsys.readouterr().out
    assert power.read_text() == "on"


def test_after_ctrl_c_the_arm_holds_and_the_report_is_written(run, power):
    def interrupt():
        raise KeyboardInterrupt

    code, page = run("--reaches=3", happens={2: interrupt})
    assert code == 130
    assert "KeyboardInterrupt" in page
    assert power.read_text() == "on"


def test_a_report_and_a_film_that_cannot_be_written_leave_those_before(run, tmp_path, monkeypatch):
    def full_disk(file):
        raise OSError("no space left")

    run()
    before = {name: (tmp_path / name).read_bytes() for name in ("report.html", "film.webp")}
    monkeypatch.setattr(os, "fsync", full_disk)
    run("--reaches=2")
    monkeypatch.setattr(command, "write_report", lambda *given: None)
    run("--reaches=2")
    for name, content in before.items():
        assert (tmp_path / name).read_bytes() == content
