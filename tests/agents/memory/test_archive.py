"""What was known in earlier worlds is found again by the gripper's view at home."""

import numpy as np
import pytest

from agents.memory.adaptive_memory import Archive
from agents.memory.remembered import Remembered
from calfree_gym.perturbations import CameraReplace
from tests.agents.memory.gripper_views import known, trial, wild
from tests.agents.trials import assert_same_arrays


@pytest.mark.parametrize("seed", [4112, 4113])
def test_the_old_world_is_found_and_agrees_and_another_one_does_not(seed):
    old = wild(seed)
    new = CameraReplace(camera="left").apply(old, np.random.default_rng(0))
    archive = Archive()
    archive.add(known(old).arrays(), np.mean([trial(old, i, 0).sensors[0] for i in range(5)], 0))
    back, elsewhere = trial(old, 99), trial(new, 99)
    assert archive.find(elsewhere.sensors[0], 0.7) is None
    found = Remembered(3).copy_of(archive.find(back.sensors[0], 0.7))
    now = known(new)
    assert found.agrees_with(back, now)
    assert not found.agrees_with(elsewhere, now)


def test_a_restored_archive_is_the_same_and_a_damaged_one_is_told():
    archive, again = Archive(), Archive()
    for i in range(3):
        archive.add({"registers": np.full(i, i), "views/sensors": np.full(2, i)}, np.full(4, 0.1 * i))
    again.restore(archive.arrays())
    assert_same_arrays(again, archive)
    arrays = archive.arrays()
    del arrays["archive/0/home"]
    with pytest.raises(ValueError, match="holds no home"):
        Archive().restore(arrays)
