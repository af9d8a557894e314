"""Small arms of our own writing, as unlike each other as MJCF files are; each says what is special in it."""

from pathlib import Path

MODELS = Path(__file__).parent / "models"

ARMS = {
    "scara": {"model": MODELS / "scara.xml", "gripper": "tip"},
    "gantry": {"model": MODELS / "gantry.xml", "gripper": "hook"},
    "hobby": {"model": MODELS / "hobby.xml", "gripper": "tip"},
    "torque": {"model": MODELS / "torque.xml", "gripper": "tool0"},
    "redundant": {"model": MODELS / "redundant.xml", "gripper": "tool", "home": "home"},
    "mobile": {"model": MODELS / "mobile.xml", "gripper": "grip", "base": "mount"},
    "gripper": {"model": MODELS / "gripper.xml", "gripper": "pinch", "home": "ready"},
    "names": {"model": MODELS / "names.xml", "gripper": "left.arm/tip"},
}
"""What `Arm` needs to be told of each."""

MOTORS = {
    "scara": ("shoulder", "elbow", "lift", "roll"),
    "gantry": ("x", "y", "z"),
    "hobby": ("turn", "shoulder", "elbow", "wrist"),
    "torque": ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"),
    "redundant": ("A1", "A2", "A3", "A4", "A5", "A6", "A7"),
    "mobile": ("pan", "lift", "elbow", "pitch", "roll"),
    "gripper": ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"),
    "names": ("left.arm/waist [0]", "Schulter & Gelenk=2", '肘, "elbow": #3'),
}
"""The joints of each from its base to its gripper."""


def three_hinges(degrees, tip):
    """MJCF of three links, each of which turns so far either way; `tip` is so far (m) up the last."""
    inner = f'<site name="tip" pos="0 0 {tip}"/>'
    for name, axis in (("bend", "0 1 0"), ("lift", "0 1 0"), ("turn", "0 0 1")):
        joint = f'<joint name="{name}" axis="{axis}" range="{-degrees} {degrees}"/>'
        geom = '<geom type="capsule" fromto="0 0 0 0 0 .15" size=".02"/>'
        inner = f'<body pos="0 0 .15">{joint}{geom}{inner}</body>'
    return f"<mujoco><worldbody>{inner}</worldbody></mujoco>"
