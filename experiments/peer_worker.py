"""Times any Gymnasium environment, under whatever interpreter has it: `PYTHON -c THIS ENV_ID`.

It imports nothing of ours, and nothing beside gymnasium and what registers the environment. First it prints
one line of JSON about the environment; then, for every line "STEPS" on its input, it makes so many
environment steps of random actions and prints the seconds that they took.
"""

import json
import sys
import time
from typing import Any

REGISTER = ("panda_gym", "gymnasium_robotics")


def make(env_id: str) -> Any:
    """The environment, once the packages that may have it are registered."""
    import gymnasium

    for package in REGISTER:
        try:
            module = __import__(package)
        except ImportError:
            continue
        if hasattr(gymnasium, "register_envs"):
            gymnasium.register_envs(module)
    return gymnasium.make(env_id)


def substeps_and_timestep(env: Any) -> tuple[Any, Any]:
    """Physics substeps in a step and seconds in a substep, or nulls where they cannot be told."""
    base = env.unwrapped
    sim: Any = getattr(base, "sim", None)
    if hasattr(sim, "n_substeps"):  # panda-gym
        return sim.n_substeps, sim.timestep
    model: Any = getattr(base, "model", None)
    if hasattr(model, "opt"):  # MuJoCo environments of gymnasium and gymnasium-robotics
        return getattr(base, "frame_skip", getattr(base, "n_substeps", None)), model.opt.timestep
    return None, None


def main(env_id: str) -> None:
    """Answers until its input ends."""
    env = make(env_id)
    env.reset(seed=0)
    env.action_space.seed(0)
    substeps, timestep = substeps_and_timestep(env)
    versions = {"python": sys.version.split()[0]}
    for package in ("gymnasium", "numpy", "mujoco", "pybullet", *REGISTER):
        if package in sys.modules:
            versions[package] = str(getattr(sys.modules[package], "__version__", "unknown"))
    about = {"substeps": substeps, "timestep": timestep, "versions": versions}
    print(json.dumps(about), flush=True)
    for line in sys.stdin:
        actions = [env.action_space.sample() for _ in range(int(line))]
        start = time.perf_counter()
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        print(json.dumps(time.perf_counter() - start), flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
