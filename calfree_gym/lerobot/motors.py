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
RATE, JITTER_S = 20.0, 0.005
"""Goals a second, and by how much one may come early, in seconds. Choice: half of what a bus and two cameras
allow."""
AHEAD = 8.0
"""Degrees that a goal is ahead of its motor at most; where it would be more for `STALLED_S` seconds, the arm
has met something. Measured: an STS3215 is 2 to 3 degrees short under load; late, at 60 degrees/s, as much."""
STALLED_S = 0.4
STILL, READINGS, SETTLE_S = 0.2, 3, 2.0
"""Settled are motors of which so many readings differ by no more than two ticks of 4096 (degrees); they are
taken to be so after so many seconds. Choice."""
SHORT, MOST, TIMES = 2.0, 5.0, 3.0
"""A motor stayed back that is `SHORT` degrees short of its goal, and so many times as far as usual, or `MOST`
degrees. Measured: sag, play and friction leave up to 1.6 degrees; 3.1 where motors are a third as stiff."""
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
        self._next = self._sent_at = self._read_at = -math.inf
        self._all = [*self.names, *(name for name in robot_motors(robot) if name not in self.names)]
        self._at = np.full(len(self._all), math.inf)
        self._read()
        self._read()
        self._left, self.goal, self._others = self._at, self.here, self._at[len(self.names) :]
        self._way, self._most = (self.goal, self.goal), 0.0

    def go_to(self, goal: Array, speed: float) -> NDArray[np.bool_]:
        """Goes to a goal (m,), in degrees, and waits until the arm has settled.

        Where a motor stays back, the arm has met something, or a stop: its goal is where it stands then, and
        others stay where they have come to. No goal leaves the way: an arm that sinks is not followed.

        Args:
            goal: Where to.
            speed: Of goals, in degrees a second, at most. A motor that was stuck and comes free is faster, by
                up to `AHEAD` degrees.

        Returns:
            Which motors (m,) have stayed back.

        Raises:
            ArmError: Motors are not where they were told to be. Nothing has moved.
        """
        self._read()
        self._read()
        self._check_near()
        self._way, self._most = (np.minimum(self.goal, goal), np.maximum(self.goal, goal)), speed / RATE
        self.tick(self.goal)
        self._stream(goal)
        self._settle()
        back = self.stay_back
        for usual, short, stays in zip(self._usual, np.abs(self.goal - self.here), back, strict=True):
            if not stays:
                usual.append(float(short))
        if ((yielding := self._yielding) != self.goal).any():
            while (self.goal != yielding).any():
                self.tick(self._towards(yielding))
            self._settle()
        self._way = self.goal, self.goal
        return back

    def take_over(self) -> bool:
        """Whether somebody has moved motors since the last tick, so power was off; all stay where they are.

        They are told so at once: they would leap to goals that they had before.

        Raises:
            ArmError: They had torque, and sink.
        """
        self._read()
        self._read()
        told = np.concatenate([self.goal, self._others])
        moved = np.minimum(np.abs(self._at - told), np.abs(self._at - self._left)) > AHEAD
        if not moved.any():
            return False
        stay = np.where(np.abs(self._at - told) > AHEAD, self._at, told)
        self.goal, self._others = np.split(stay, [len(self.names)])
        self._way = self.goal, self.goal
        self.tick(self.goal)
        self._settle()
        self._check_near()
        return True

    def hold(self) -> None:
        """Goals of motors that something stops come to where these stand; others stay. Nothing is read."""
        yielding = self._yielding
        try:
            with suppress(Exception):  # whatever the bus says: without a new goal motors keep their last one
                while (self.goal != yielding).any():
                    self._send(self._towards(yielding))
        finally:
            self._way = self.goal, self.goal

    @property
    def here(self) -> Array:
        """Where the motors stood when they were read last (m,), in degrees."""
        return self._at[: len(self.names)]

    @property
    def others(self) -> dict[str, float]:
        """Where the motors that stay where they were are told to be, as LeRobot has it."""
        return dict(zip(self._all[len(self.names) :], self._others.tolist(), strict=True))

    @property
    def stay_back(self) -> NDArray[np.bool_]:
        """Which motors (m,) are farther from their goals than sag and play explain."""
        usual = [float(np.median(short)) if short else MOST for short in self._usual]
        return np.abs(self.goal - self.here) > np.clip(TIMES * np.array(usual), SHORT, MOST)

    @property
    def _yielding(self) -> Array:
        """Goals (m,), of motors that stay back as near to them as the way allows."""
        return np.where(self.stay_back, np.clip(self.here, *self._way), self.goal)

    def _towards(self, goal: Array) -> Array:
        """The next goal (m,) at limited speed."""
        return np.clip(goal, self.goal - self._most, self.goal + self._most)

    def _check_near(self) -> None:
        for name, goal, at in zip(self.names, self.goal, self.here, strict=True):
            if abs(goal - at) > AHEAD:
                raise ArmError(
                    f"motor {name} was told to be at {goal:.0f} degrees, and is at {at:.0f}: it cannot "
                    "hold what it bears, or was moved. Support the arm, switch it off and on, and restart"
                )

    def _stream(self, goal: Array) -> None:
        """Sends goals on the straight way, ever closer ones at both ends, and none far ahead of the arm."""
        self.doing = "streaming"
        start = self.goal
        steps = math.ceil(PEAK * float(np.abs(goal - start).max()) / self._most)
        step = waited = 0
        while step < steps and waited <= STALLED_S * RATE:
            share = (step + 1) / steps
            aimed = np.clip(start + share**2 * (3 - 2 * share) * (goal - start), *self._way)
            near = np.clip(aimed, self.here - AHEAD, self.here + AHEAD)
            waited += int((near != aimed).any())
            self.tick(self._towards(np.clip(near, *self._way)))
            if (self.goal == aimed).all():
                step, waited = step + 1, 0

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
        try:
            action = self._send(goal)
        except Exception as error:
            raise self._failed(error) from error
        if self._on_tick is not None:
            self._on_tick(self.seen, action)
        now = self.clock()
        self._next = max(self._next, now - 1 / RATE) + 1 / RATE
        self._sleep(max(self._next - now, 0.0))
        self._read()
        self._left = self._at

    def _send(self, goal: Array) -> dict[str, float]:
        """Sends a goal (m,), not sooner than a period after the last one; the action."""
        told = np.concatenate([goal, self._others]).tolist()
        action = {f"{name}{POSITION}": at for name, at in zip(self._all, told, strict=True)}
        if (early := self._sent_at + 1 / RATE - self.clock()) > JITTER_S:
            self._sleep(early)
        self._sent_at = self.clock()
        self._robot.send_action(action)
        self.goal = goal
        return action

    def _read(self) -> None:
        """Reads where motors stand; raises ArmError where they cannot have come there meanwhile."""
        try:
            seen = self._robot.get_observation()
            at = np.array([seen.get(f"{name}{POSITION}") for name in self._all], float)
        except Exception as error:
            raise self._failed(error) from error
        now = self.clock()
        most = AHEAD + PUSHED * (now - self._read_at)
        for name, new, old in zip(self._all, at, self._at, strict=True):
            if not abs(new - old) <= most:
                raise ArmError(
                    f"while {self.doing}, motor {name} says that it stands at {new:g} degrees, right after "
                    f"{old:g}: that is wrong, or its encoder has come to its end"
                )
        self.seen, self._at, self._read_at = seen, at, now
        self._note(now, seen)

    def _failed(self, error: Exception) -> ArmError:
        return ArmError(f"while {self.doing}, the robot says: {type(error).__name__}: {error}")
