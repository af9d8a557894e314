"""The wheel, installed alone: whoever installs it has no repository."""

import subprocess
import sys
import venv
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]

STRANGER = """
import gymnasium as gym, numpy as np, calfree_gym
from importlib.util import find_spec
assert "site-packages" in calfree_gym.__file__
from importlib.metadata import version
from importlib.resources import files
assert calfree_gym.__version__ == version("calfree-gym")
assert (files("calfree_gym") / "py.typed").is_file()
for absent in ("agents", "experiments", "torch", "stable_baselines3"):
    assert find_spec(absent) is None, absent
for env_id in calfree_gym.ENV_IDS:
    for mount in calfree_gym.MOUNTS:
        env = gym.make(f"calfree_gym:{env_id}", camera_mount=mount)
        env.reset(seed=0)
        for _ in range(3):
            env.step(env.action_space.sample())
        rows = gym.make_vec(f"calfree_gym:{env_id}", num_envs=3, camera_mount=mount)
        rows.reset(seed=0)
        rows.step(np.zeros((3, 3), np.float32))
        print(env_id, mount)
"""


def run(*command, cwd):
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_wheel_alone_makes_and_steps_every_id(tmp_path):
    run(sys.executable, "-m", "pip", "wheel", "--no-deps", "-w", tmp_path, REPOSITORY, cwd=tmp_path)
    (wheel,) = tmp_path.glob("*.whl")
    venv.create(tmp_path / "venv", with_pip=True)
    python = tmp_path / "venv/bin/python"
    run(python, "-m", "pip", "install", "-c", REPOSITORY / "constraints.txt", wheel, cwd=tmp_path)
    printed = run(python, "-c", STRANGER, cwd=tmp_path)
    assert len(printed.splitlines()) == 4
