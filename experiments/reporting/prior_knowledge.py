"""What each agent must know beyond its observations: what it is built on, in a sentence for the tables."""

from collections.abc import Sequence

_IMAGES = "size and noise of the images, which point is which, where registers end"
_MEMORY = (
    f"{_IMAGES}; cameras are pinholes with square pixels; each motor moves either the cameras or the "
    "gripper; a changed arm is affine in each motor"
)

PRIOR_KNOWLEDGE: dict[str, str] = {
    "random": "nothing",
    "unified_servo": _IMAGES,
    "paper_servo": _IMAGES,
    "work_plane_servo": f"{_IMAGES}; motor 1 turns the waist",
    "learning_servo": _MEMORY,
    "grid_table": _IMAGES,
    "factored_table": _IMAGES,
    "support_points": _IMAGES,
    "gaussian_process": _MEMORY,
    "memory": _MEMORY,
    "joint_space_servo": _IMAGES,
    "affine_stereo": f"{_IMAGES}; the arm as built; that both cameras are affine",
    "model_based": f"{_IMAGES}; the whole robot as built: arm, motors, cameras and their mount",
    "self_calibrating": (
        f"{_IMAGES}; what kind of robot it is: its joints, the form of the motor curve, the bounds of all "
        "parameters, what the cameras are fixed to"
    ),
    "self_supervised": "which point is which, where registers end",
    "cooperstock_milios": "which point is which, where registers end",
    **dict.fromkeys(
        ("sb3", "sac", "sac_her", "td3", "tqc", "crossq", "ppo", "recurrent_ppo"),
        "a reward; a word limit and a discount that were tuned in other worlds",
    ),
}
"""A sentence for each agent's name; a test demands one for every agent."""


def must_know(name: str, privileged: Sequence[str]) -> str:
    """An agent's privileged observations, if any, and what it is built on."""
    given = ", ".join(f"`{observation}`" for observation in privileged)
    known = PRIOR_KNOWLEDGE.get(name, "not stated")
    return f"{given}; {known}" if given else known
