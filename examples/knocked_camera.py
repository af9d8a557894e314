"""A camera is knocked in mid-run, and the servo of `servo.py` goes on: what is not calibrated is not lost."""

import argparse

import gymnasium as gym

try:
    from servo import reach
except ModuleNotFoundError:  # installed
    from calfree_gym.examples.servo import reach


def main() -> None:
    """Reaches again and again in one wild world, whose left camera is turned half way through."""
    parser = argparse.ArgumentParser(description="A calibration-free visual servo whose camera is knocked.")
    parser.add_argument("--motions", type=int, default=100, help="in all; the knock comes after half of them")
    parser.add_argument("--degrees", type=float, default=20.0, help="by which the left camera is turned")
    arguments = parser.parse_args()

    knock = {"type": "camera_aim", "camera": "left", "degrees": arguments.degrees}
    env = gym.make(
        "calfree_gym:CalFree/Reach-v0",
        world="wild",
        perturbations=[{"at": {"motion": arguments.motions // 2}, "do": knock}],
    )
    look, _ = env.reset(seed=0)
    motions = trial = 0
    while motions < arguments.motions:
        infos = reach(env, look)
        motions, trial = motions + len(infos), trial + 1
        outcome = "reached" if infos[-1]["is_success"] else "missed"
        knocks = [knock] * sum(info["perturbed"] for info in infos)
        print(f"trial {trial}: {outcome} in {len(infos)} motions", *knocks)
        look, _ = env.reset()


if __name__ == "__main__":
    main()
