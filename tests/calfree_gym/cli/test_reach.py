"""`calfree reach` on the bench: what it tells, what it writes, and that the arm holds however it ends."""

import base64
import re
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from calfree_gym.cli import reach as command
from calfree_gym.cli.film import MARKED
from tests.calfree_gym.cli.bench import calfree
from tests.calfree_gym.lerobot.fake_so101 import FakeSO101


class Scripted:
    """An agent that makes two motions a reach, and believes after the second one that a camera was turned."""

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
    """Runs `calfree reach` with that agent; its exit code, and its page."""
    package = SimpleNamespace(names=lambda: ["scripted"], make=lambda name, env: Scripted(env))
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
