"""A robot of the bench, which tells whether its motors have torque, also once it is forgotten."""

import pytest

from tests.calfree_gym.lerobot.fake_so101 import FakeSO101


@pytest.fixture
def power(tmp_path):
    return tmp_path / "power"


@pytest.fixture
def robot(power, opengl):
    return FakeSO101(power=power)
