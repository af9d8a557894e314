"""Brings an arm to goals at limited speed, knows when it has settled, and keeps it where it is."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.lerobot.faults import ArmError
from calfree_gym.lerobot.robot import POSITION, LeRobot, robot_motors
from calfree_gym.picture_reach import Array

Tick = Callable[[dict[str, Any], dict[str, float]], Any]
"""Gets what was observed, and the action that was sent upon it."""
RATE = 20.0
"""Goals a second. Choice: half of what a bus and two cameras allow."""
AHEAD = 8.0
"""Degrees that a goal is ahead of its motor at most; where it would be more for `STALLED_S` seconds, the arm
has met something. Measured: an STS3215 is 2 to 3 degrees short under load; late, at 60 degrees/s, as much."""
STALLED_S = 0.4
STILL, READINGS, SETTLE_S = 0.2, 3, 2.0
"""Settled are motors of which so many readings differ by no more than two ticks of 4096 (degrees); they are
taken to be so after so many seconds. Choice."""
SHORT, TIMES = 2.0, 3.0
"""A motor stayed back that is so many degrees short of its goal, and so many times as far as usual. Measured:
sag, play and friction leave up to 1.6 degrees."""
REMEMBERED = 50
"""So many motions tell what is usual. Choice: a day's first reaches."""
PEAK = 1.5
"""The highest speed of a motion, by its mean (smoothstep)."""
FASTEST = 0.75 * AHEAD * RATE
"""Degrees a second: goals of faster motions go ahead too far. Choice: what is left is for arms that lag."""
PUSHED = 360.0
"""Degrees a second that no motor goes: an STS3215 without a load goes 270 to 360. A reading that is `AHEAD`
farther off is wrong."""


class Motors:
    """Some motors of a robot; the others stay where they were.

    Attributes:
        names: Of the motors, m.
        goal: What they were told last (m,), in degrees.
        here: Where they stood when they were read last (m,), in degrees.
        seen: What was observed then.
        doing: What happens now, in a word.

    Args:
        robot: The robot, connected.
        names: See above.
        note: Gets the time and all that is observed.
        on_tick: See `Tick`; called `RATE` times a second while the arm moves, settles and looks.
    """

    def __init__(
        self,
        robot: LeRobot,
        names: Sequence[str],
        note: Callable[[float, dict[str, Any]], None],
        on_tick: Tick | None,
    ) -> None:
        self.names, self.doing = tuple(names), "standing"
        self.clock: Callable[[], float] = getattr(robot, "clock", time.monotonic)
        self._sleep: Callable[[float], None] = getattr(robot, "sleep", time.sleep)
        self._robot, self._note, self._on_tick = robot, note, on_tick
        self._usual = [deque[float](maxlen=REMEMBERED) for _ in self.names]
        self._next = self._read_at = -math.inf
        self.here = np.full(len(self.names), math.inf)
        self._places = [f"{name}{POSITION}" for name in self.names]
        self._read()
        self._read()
        self.goal = self.here
        others = [f"{name}{POSITION}" for name in robot_motors(robot) if name not in self.names]
        self._others = {name: float(self.seen[name]) for name in others}

    def go_to(self, goal: Array, speed: float) -> NDArray[np.bool_]:
        """Goes to a goal (m,), in degrees, and waits until the arm has settled.

        Where a motor stays back, the arm has met something, or a stop: its goal is where it stands then, and
        others stay where they have come to.

        Args:
            goal: Where to.
            speed: In degrees a second, at most.

        Returns:
            Which motors (m,) have stayed back.
        """
        self._take_over()
        self.tick(self.goal)
        moves = np.abs(goal - self.goal) > STILL
        self._stream(goal, speed)
        self._settle()
        back = self.stay_back
        for usual, short, stays in zip(self._usual, np.abs(self.goal - self.here), back, strict=True):
            if not stays:
                usual.append(float(short))
        if (met := back & moves).any():
            self.tick(np.where(met, self._nearer, self.goal))
            self._settle()
        return back

    def hold(self) -> None:
        """Stays where it was read last, with no more readings: motors that only sag keep their goals."""
        self.goal = np.where(self.stay_back, self._nearer, self.goal)
        with suppress(Exception):  # whatever the bus says: without a new goal motors keep their last one
            self._robot.send_action(self._action(self.goal))

    @property
    def stay_back(self) -> NDArray[np.bool_]:
        """Which motors (m,) are farther from their goals than sag and play explain."""
        usual = [float(np.median(short)) if short else 0.0 for short in self._usual]
        return np.abs(self.goal - self.here) > np.maximum(SHORT, TIMES * np.array(usual))

    @property
    def _nearer(self) -> Array:
        """Goals (m,) where motors stand; where those are farther off, so much nearer."""
        return np.clip(self.here, self.goal - AHEAD, self.goal + AHEAD)

    def _take_over(self) -> None:
        """Where somebody has moved motors meanwhile, which had no torque, they stay there."""
        self._read()
        self._read()
        self.goal = np.where(np.abs(self.goal - self.here) > AHEAD, self.here, self.goal)
        for name, there in self._others.items():
            if abs(float(self.seen[name]) - there) > AHEAD:
                self._others[name] = float(self.seen[name])

    def _stream(self, goal: Array, speed: float) -> None:
        """Sends goals on the straight way, ever closer ones at both ends, and none far ahead of the arm."""
        self.doing = "streaming"
        start, most = self.goal, speed / RATE
        steps = math.ceil(PEAK * float(np.abs(goal - start).max()) / most)
        step = waited = 0
        while step < steps and waited <= STALLED_S * RATE:
            share = (step + 1) / steps
            aimed = start + share**2 * (3 - 2 * share) * (goal - start)
            if (np.abs(aimed - self.here) > AHEAD).any():
                waited += 1
                nearer = np.clip(self.goal, self.here - AHEAD, self.here + AHEAD)
                self.tick(np.clip(nearer, self.goal - most, self.goal + most))
            else:
                step, waited = step + 1, 0
                self.tick(aimed)

    def _settle(self) -> None:
        self.doing = "settling"
        readings = [self.here]
        for _ in range(round(SETTLE_S * RATE)):
            self.tick(self.goal)
            readings.append(self.here)
            if len(readings) >= READINGS and np.ptp(readings[-READINGS:], axis=0).max() <= STILL:
                break

    def tick(self, goal: Array) -> None:
        """Sends a goal (m,), waits for the rest of a period, and reads where motors stand then.

        Raises:
            ArmError: The robot does not answer, or the note that is taken says what is wrong.
        """
        action = self._action(goal)
        try:
            self._robot.send_action(action)
        except Exception as error:
            raise self._failed(error) from error
        self.goal = goal
        if self._on_tick is not None:
            self._on_tick(self.seen, action)
        now = self.clock()
        self._next = max(self._next, now - 1 / RATE) + 1 / RATE
        self._sleep(max(self._next - now, 0.0))
        self._read()

    def _action(self, goal: Array) -> dict[str, float]:
        return dict(zip(self._places, goal.tolist(), strict=True)) | self._others

    def _read(self) -> None:
        """Reads where motors stand; raises ArmError where they cannot have come there meanwhile."""
        try:
            seen = self._robot.get_observation()
        except Exception as error:
            raise self._failed(error) from error
        now, here = self.clock(), np.array([float(seen[place]) for place in self._places])
        possible = AHEAD + PUSHED * (now - self._read_at)
        for name, at, before in zip(self.names, here, self.here, strict=True):
            if not abs(at - before) <= possible:
                raise ArmError(
                    f"while {self.doing}, motor {name} says that it stands at {at:g} degrees, right after "
                    f"{before:g}: that is wrong, or its encoder has come to its end"
                )
        self.seen, self.here, self._read_at = seen, here, now
        self._note(now, seen)

    def _failed(self, error: Exception) -> ArmError:
        return ArmError(f"while {self.doing}, the robot says: {type(error).__name__}: {error}")
