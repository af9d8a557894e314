"""`calfree reach`: an agent reaches with a real arm, and a report tells how."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from calfree_gym.cli.film import film
from calfree_gym.cli.loading import agents_package
from calfree_gym.cli.recording import Recording
from calfree_gym.cli.report import write_report
from calfree_gym.cli.robots import Ask, connecting
from calfree_gym.errors import check_choice, check_whole
from calfree_gym.files import whole
from calfree_gym.lerobot import ArmError, LeRobotReachEnv, knowledge
from calfree_gym.lerobot.robot import LeRobot
from calfree_gym.picture_reach import PairTracker

REPORT = "report.html"


@dataclass(frozen=True)
class ReachRun:
    """What is asked; see `calfree reach --help`."""

    agent: str
    reaches: int
    cameras: tuple[str, ...]
    motors: tuple[str, ...] | None
    marks: str | PairTracker | None
    unit: float
    speed: float
    tolerance_px: float
    max_motions: int
    save: Path | None
    load: Path | None
    out: Path

    def check(self) -> None:
        """Raises ValueError or OSError where something cannot be; asks no robot."""
        check_choice("agent", self.agent, agents_package().names())
        if agents_package().learns_by_rewards(self.agent):
            raise ValueError(
                f"agent is {self.agent!r}, which learns by rewards, in 100,000s of motions: too many for a "
                "real arm; allowed: agents that need no rewards, such as memory"
            )
        check_whole("reaches", self.reaches, 1, 10**6)
        if self.load is not None and not self.load.is_file():
            raise FileNotFoundError(f"--load {self.load}: there is no such file")
        if self.load is not None:
            knowledge.read(self.load, self.unit, self.agent, self.motors)
        if self.save is not None and not self.save.absolute().parent.is_dir():
            raise FileNotFoundError(f"--save {self.save}: there is no such folder")
        if self.save is not None and self.save.exists() and not (self.load and self.save.samefile(self.load)):
            raise FileExistsError(
                f"--save {self.save}: there is such a file; give --load={self.save} too, to go on with it, "
                "or another name"
            )
        if (self.out / REPORT).exists():
            raise FileExistsError(f"--out {self.out}: it holds a {REPORT}; give another folder")


def reach(robot: LeRobot, run: ReachRun, ask: Ask) -> int:
    """Lets an agent reach, and writes film and report, however it ends; 1 where the arm cannot go on, else 0.

    Args:
        robot: Of LeRobot.
        run: What is asked.
        ask: Has the next object placed.

    Raises:
        ImportError: The agent lacks what it needs.
        ValueError: An argument is not allowed; nothing has moved.
        OSError: The robot cannot be connected, or a file not be read or written.
    """
    recording = Recording(run.reaches)
    with connecting():
        env = LeRobotReachEnv(
            robot,
            run.cameras,
            marks=run.marks,
            motors=run.motors,
            home=run.load,
            unit=run.unit,
            speed=run.speed,
            tolerance_px=run.tolerance_px,
            max_motions=run.max_motions,
            place_object=lambda: ask("Place the object, then press Enter: "),
            on_tick=recording.tick,
        )
    agent = agents_package().make(run.agent, env)
    if run.load is not None:
        env.load(agent, run.load)
    run.out.mkdir(parents=True, exist_ok=True)
    recording.begin(env, agent)
    error = ""
    try:
        for each in env.reaches(agent, run.reaches):
            recording.end(each)
            if run.save is not None:
                env.save(agent, run.save)
    except ArmError as caught:
        error = str(caught)
        print(f"error: {error}")
    except BaseException as caught:
        error = f"{type(caught).__name__}: {caught}".rstrip(": ")
        raise
    finally:
        recording.tick()
        _report(run, recording, error)
    return int(bool(error))


def _report(run: ReachRun, recording: Recording, error: str) -> None:
    page, moving = run.out / REPORT, film(recording.reaches, recording.noticed)
    outcomes = [each.outcome for each in recording.reaches if each.outcome]
    reached = sum(each.reached for each in outcomes)
    settings = {
        "when": time.strftime("%Y-%m-%d %H:%M"),
        "unit": f"{run.unit:g} degrees",
        "speed": f"{run.speed:g} degrees/s",
        "tolerance": f"{run.tolerance_px:g} px of 512",
        "loaded": run.load or "nothing",
    }
    title = f"{run.agent} reached {reached} of {len(outcomes)} times"
    write_report(page, title, settings, recording.reaches, recording.noticed, moving, error)
    if moving:
        with whole(run.out / "film.webp") as file:
            file.write(moving)
    print(f"{title}; the report is {page}")
