"""What a stranger does first with the installed wheel; `python tests/smoke.py` in an empty folder.

Learners are made where stable-baselines3 is installed.
"""

import subprocess
import sys
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import calfree_agents
import gymnasium as gym

import calfree_gym

REACH = "calfree_gym:CalFree/Reach-v0"


def reaches(name: str) -> bool:
    """Whether an agent that has learned 100 motions reaches a new object."""
    env = gym.make(REACH, dynamics="kinematic")
    env.reset(seed=0)
    agent = calfree_agents.make(name, env, seed=0).learn(100)
    (observation, info), state = env.reset(), None
    terminated = truncated = False
    while not (terminated or truncated):
        words, state = agent.predict(observation, state)
        observation, _, terminated, truncated, info = env.step(words)
    return bool(info["is_success"])


if __name__ == "__main__":
    assert "site-packages" in calfree_gym.__file__, calfree_gym.__file__
    for env_id in calfree_gym.ENV_IDS:
        env = gym.make(f"calfree_gym:{env_id}")
        env.reset(seed=0)
        env.step(env.action_space.sample())
    for name in ("unified_servo", "memory"):
        assert reaches(name), name
    if learners := find_spec("stable_baselines3") is not None:
        env = gym.make(REACH, dynamics="kinematic")
        env.reset(seed=0)
        calfree_agents.make("ppo", env, seed=0, rows=4, n_steps=16, batch_size=64).learn(64)
    subprocess.run([Path(sys.executable).with_name("calfree"), "--help"], check=True, capture_output=True)
    packages = ("mujoco", "gymnasium", "numpy", "opencv-python-headless")
    packages += ("torch", "stable-baselines3") if learners else ()
    found = ", ".join(f"{name} {version(name)}" for name in packages)
    print(f"all of it runs: calfree-gym {version('calfree-gym')}, Python {sys.version.split()[0]}, {found}")
