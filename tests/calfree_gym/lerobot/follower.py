"""LeRobot's own SO-101 follower, unchanged, over a fake Feetech bus and fake cameras, before the bench."""

import tempfile
from pathlib import Path

from lerobot.motors.encoding_utils import decode_sign_magnitude
from lerobot.motors.feetech import FeetechMotorsBus
from lerobot.motors.motors_bus import get_address
from lerobot.robots.so_follower import SO101Follower, SO101FollowerConfig, so_follower

from tests.calfree_gym.lerobot.so101 import MOTORS
from tests.calfree_gym.lerobot.webcam import HEIGHT, WIDTH

MODEL = "sts3215"
EEPROM = 40
"""Addresses below are kept without power."""
OFFSET_BITS = 11


class FakeFeetech(FeetechMotorsBus):
    """Motors as the factory made them, whose joints move on a bench.

    Attributes:
        bench: The `FakeSO101` that has joints, cameras, a clock and faults; given before one is made.
        kept: What was written to EEPROM: addresses, motors and values.
    """

    bench = None

    def __init__(self, *args, **settings):
        super().__init__(*args, **settings)
        self.kept = []
        self._open = False
        self._torque, self._position, self._goal, self._offset = map(
            self._address, ("Torque_Enable", "Present_Position", "Goal_Position", "Homing_Offset")
        )
        factory = {self._address("Min_Position_Limit"): 0, self._address("Max_Position_Limit"): 4095}
        self._table = {motor: dict(factory) for motor in range(1, len(MOTORS) + 1)}

    def _address(self, name):
        return get_address(self.model_ctrl_table, MODEL, name)[0]

    @property
    def is_connected(self):
        return self._open

    def _connect(self, handshake=True):
        if not str(self.port).endswith("ACM0"):
            raise ConnectionError(f"Could not connect on port '{self.port}'. Try running `lerobot-find-port`")
        self._open = True

    def disconnect(self, disable_torque=True):
        if disable_torque:
            self.disable_torque()
        self._open = False

    def _value(self, motor, address):
        if address == self._position:
            return int(self.bench.bus.ticks()[motor - 1])
        return self._table[motor].get(address, 0)

    def _read(self, address, length, motor_id, **_):
        self.bench.sleep(0.004)
        return self._value(motor_id, address), 0, 0

    def _write(self, addr, length, motor_id, value, **_):
        if self.bench.bus.error:
            raise self.bench.bus.error
        if addr < EEPROM:
            self.kept.append((addr, motor_id, value))
        self._table[motor_id][addr] = value
        if addr == self._offset:
            self.bench.bus.offsets[motor_id - 1] = decode_sign_magnitude(value, OFFSET_BITS)
        if addr == self._torque:
            self.bench._torque(all(table.get(self._torque) for table in self._table.values()))
        return 0, 0

    def _sync_read(self, addr, length, motor_ids, **_):
        self.bench.sleep(0.004)
        return {motor: self._value(motor, addr) for motor in motor_ids}, 0

    def _sync_write(self, addr, length, ids_values, **_):
        self.bench.sleep(0.002)
        assert addr == self._goal
        self.bench.bus.send({MOTORS[motor - 1]: value for motor, value in ids_values.items()})
        return 0


class FakeCamera:
    """A camera of the bench, as LeRobot's `OpenCVCamera`."""

    use_rgb, use_depth, width, height = True, False, WIDTH, HEIGHT

    def __init__(self, name, bench):
        self._name, self._bench, self.is_connected = name, bench, False

    def connect(self):
        self.is_connected = True

    def disconnect(self):
        self.is_connected = False

    def read_latest(self):
        return self._bench._frames()[self._name]


def follower(bench, monkeypatch, port="/dev/ttyACM0", **config):
    """LeRobot's follower, of which nobody has calibrated anything, on the clock of a bench."""
    monkeypatch.setattr(so_follower, "FeetechMotorsBus", FakeFeetech)
    monkeypatch.setattr(FakeFeetech, "bench", bench)
    folder = Path(tempfile.mkdtemp())
    robot = SO101Follower(SO101FollowerConfig(id="fake", port=port, calibration_dir=folder, **config))
    robot.cameras = {name: FakeCamera(name, bench) for name in bench.cameras}
    robot.clock, robot.sleep = bench.clock, bench.sleep
    return robot
