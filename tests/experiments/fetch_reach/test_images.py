"""FetchReach as images, where gymnasium-robotics is installed; and what a network learns of them."""

import numpy as np
import pytest
import torch

from calfree_gym import Perturb
from experiments.fetch_reach.policies import CAMERA, CELLS, fetch, images_of, shares_around


@pytest.mark.slow
def test_a_turned_camera_shows_in_its_own_image_alone_and_the_goal_in_both():
    pytest.importorskip("gymnasium_robotics")
    knock = [{"at": {"step": 1}, "do": {"type": "camera_aim", "camera": CAMERA, "degrees": 10}}]
    seen = []
    for schedule in ([], knock):
        env = images_of(Perturb(fetch(), schedule, seed=0, images={CAMERA: None}))
        env.reset(seed=0)
        seen.append(env.step(np.zeros(3))[0]["images"].astype(int))
        red = seen[-1].reshape(64, 64, 2, 3)[..., 0] - seen[-1].reshape(64, 64, 2, 3)[..., 1]
        assert ((red > 100).sum((0, 1)) > 0).all()
        env.close()
    differ = np.abs(seen[0] - seen[1]).mean((0, 1))
    assert (differ[:3] > 5).all()
    assert (differ[3:] == 0).all()


def test_shares_of_cells_have_their_mean_at_the_point():
    points = torch.tensor([[0.3, -0.2, 0.0, 0.51], [-0.9, 0.9, 0.11, -0.33]])
    shares = shares_around(points).unflatten(-1, (CELLS, CELLS))
    middles = torch.arange(1, 2 * CELLS, 2) / CELLS - 1
    mean = torch.stack([shares.sum(2) @ middles, shares.sum(3) @ middles], -1)
    torch.testing.assert_close(mean.flatten(1), points)
    assert ((shares > 0).sum((2, 3)) <= 4).all()
