"""One motor in plain Python, and environments whose motors are compared with it."""

import math

from calfree_gym.robot.arms.movemaster import MOVEMASTER
from tests.calfree_gym.environments import make

FIELDS = {
    "register_noise": 0.01,
    "register_step": 0.004,
    "shortfall": 0.05,
    "longest_motion": 0.15,
    "word_gain": 0.5,
    "dead_zone": 0.03,
    "gear_ripple": (0.4, 1.0, 0.6),
}
"""New fields of the world, each with a value that no built robot has."""
EXACT = {"register_noise": 0.0, "register_step": 0.0}


def made(task="Reach", **arguments):
    usual = {"keep_in_view": False, "terminate_on_success": False}
    reach = {"dynamics": "kinematic", "camera_mount": "stand"} if task == "Reach" else {}
    return make(task, **usual | reach | arguments).unwrapped


def registers_of(observation, motors=3, first=4):
    return observation["observation"][..., first : first + motors]


class Motor:
    """One motor, number for number as its documentation says.

    Args:
        world: The world.
        motor: Which.
        robot: Its arm.
    """

    def __init__(self, world, motor, robot=MOVEMASTER):
        self.world, self.motor, self.robot = world, motor, robot
        self.register = self.joint = 0.0
        self.lowest, self.highest = self.end(-1.0), self.end(1.0)

    def of(self, field):
        return getattr(self.world, field)[self.motor].tolist()

    def position(self, register):
        period, phase, depth = self.of("gear_ripple")
        turn = 2 * math.pi / period
        t = register + depth / turn * (math.sin(turn * register + phase) - math.sin(phase))
        c, inner = self.of("motor_curvature"), max(-1.0, min(1.0, t))
        far = inner + c * inner * (inner**2 - 1) + (t - inner) * (1 + 2 * c)
        rest = self.robot.home[self.motor] + self.of("joint_zeros")
        return rest + self.of("motor_sign") * self.of("motor_gain") * self.robot.span[self.motor] * far

    def end(self, far):
        (low, high), margin = self.robot.stops[self.motor], self.robot.stop_margin[self.motor]
        near, tried = 0.0, far
        for _ in range(60):
            if low + margin <= self.position(tried) <= high - margin:
                near = tried
            else:
                far = tried
            tried = (near + far) / 2
        return near

    def move(self, word):
        longest = self.of("longest_motion")
        executed = max(-longest, min(longest, word)) * (1 - self.of("shortfall")) * self.of("word_gain")
        before = self.register
        self.register = max(self.lowest, min(self.highest, before + executed))
        if abs(word) > self.of("dead_zone"):
            self.joint = max(self.lowest, min(self.highest, self.joint + self.register - before))
