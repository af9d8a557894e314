"""The wheel, installed alone: whoever installs it has no repository."""

import os
import re
import subprocess
import sys
import tomllib
import venv
from pathlib import Path
from zipfile import ZipFile

import pytest

import calfree_gym

REPOSITORY = Path(__file__).resolve().parents[1]
PAGES = [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").glob("*.md"))]
FOLDERS = {
    "calfree_gym": "calfree_gym",
    "agents": "calfree_agents",
    "configs/agents": "calfree_agents/configs",
    "examples": "calfree_gym/examples",
}
"""What the wheel holds, and under which name."""

STRANGER = """
import gymnasium as gym, numpy as np, calfree_gym, calfree_agents
from importlib.util import find_spec
assert "site-packages" in calfree_gym.__file__
assert "site-packages" in calfree_agents.__file__
from importlib.metadata import version
from importlib.resources import files
assert calfree_gym.__version__ == version("calfree-gym")
for package in ("calfree_gym", "calfree_agents"):
    assert (files(package) / "py.typed").is_file()
for absent in ("agents", "configs", "experiments", "torch", "stable_baselines3", "yaml", "scipy"):
    assert find_spec(absent) is None, absent
for env_id in calfree_gym.ENV_IDS:
    for camera_mount in calfree_gym.MOUNTS if "Dock" not in env_id else (None,):
        mount = {"camera_mount": camera_mount} if camera_mount else {}
        env = gym.make(f"calfree_gym:{env_id}", **mount)
        env.reset(seed=0)
        for _ in range(3):
            env.step(env.action_space.sample())
        rows = gym.make_vec(f"calfree_gym:{env_id}", num_envs=3, **mount)
        rows.reset(seed=0)
        rows.step(np.zeros(rows.action_space.shape, np.float32))
        print(env_id, camera_mount)
"""

CLASSICAL = """
import gymnasium as gym, calfree_agents
from calfree_gym.tasks.reach import PRIVILEGED
env = gym.make("calfree_gym:CalFree/Reach-v0", tell=tuple(PRIVILEGED), dynamics="kinematic")
env.reset(seed=0)
for name in calfree_agents.names():
    try:
        agent = calfree_agents.make(name, env).learn(70)
        agent.save("agent")
        assert calfree_agents.make(name, env).load("agent").num_timesteps == 70, name
        assert name not in calfree_agents.NEURAL, name
    except ModuleNotFoundError as error:
        assert name in calfree_agents.NEURAL, name
        assert f"agent {name!r} needs {error.name}" in str(error)
        assert "pip install '.[agents]'" in str(error)
    print(name)
"""

LOADS = "from calfree_gym.cli.loading import agents_package; print(agents_package().__name__)"
BOTH_NAMES = """
import gymnasium as gym, numpy as np, torch
import agents, calfree_agents
from calfree_gym.tasks.reach import PRIVILEGED
from tests.agents.neural.quick import QUICK
torch.set_num_threads(1)
tell = tuple(PRIVILEGED)
env = gym.make("calfree_gym:CalFree/Reach-v0", tell=tell, dynamics="kinematic", camera_mount="stand")
for name in agents.names():
    assert agents.default_settings(name) == calfree_agents.default_settings(name)
    env.reset(seed=0)
    agents.make(name, env, **QUICK.get(name, {})).learn(100).save("ours")
    theirs = calfree_agents.make(name, env, **QUICK.get(name, {})).load("ours")
    assert type(theirs).__module__.startswith("calfree_agents.")
    theirs.save("theirs")
    back = agents.make(name, env, **QUICK.get(name, {})).load("theirs")
    assert theirs.num_timesteps == back.num_timesteps == 100, name
    observation, _ = env.reset(seed=1)
    assert np.array_equal(theirs.predict(observation)[0], back.predict(observation)[0]), name
    print(name)
"""


def run(*command, cwd=None, **variables):
    environment = os.environ | variables
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    run(sys.executable, "-m", "pip", "wheel", "--no-deps", "-w", folder, REPOSITORY, cwd=folder)
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def python(wheel, tmp_path_factory):
    """The interpreter of an empty environment in which the wheel alone is installed."""
    folder = tmp_path_factory.mktemp("stranger")
    venv.create(folder / "venv", with_pip=True)
    python = folder / "venv/bin/python"
    run(python, "-m", "pip", "install", "-c", REPOSITORY / "constraints.txt", wheel, cwd=folder)
    return python


@pytest.mark.slow
def test_the_wheel_holds_every_file_of_both_packages(wheel):
    there = {name for name in ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert there == {
        f"{name}/{path.relative_to(REPOSITORY / folder).as_posix()}"
        for folder, name in FOLDERS.items()
        for path in (REPOSITORY / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


@pytest.mark.slow
def test_the_wheel_alone_makes_and_steps_every_id(python, tmp_path):
    made = run(python, "-c", STRANGER, cwd=tmp_path).splitlines()
    of_arms = [env_id for env_id in calfree_gym.ENV_IDS if "Dock" not in env_id]
    assert len(made) == len(of_arms) * len(calfree_gym.MOUNTS) + 2


@pytest.mark.slow
def test_the_wheel_alone_runs_every_classical_agent_and_says_what_neural_ones_need(python, tmp_path):
    assert "self_supervised" in run(python, "-c", CLASSICAL, cwd=tmp_path).split()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("example", "said"),
    [
        ("servo --trials 2", "reached in 2 of 2 worlds"),
        ("knocked_camera --motions 20", "reached"),
        ("own_robot --motions 10", "motions of each reach: "),
    ],
)
def test_the_wheel_alone_runs_its_examples(example, said, python, tmp_path, opengl):
    assert said in run(python, "-m", *f"calfree_gym.examples.{example}".split(), cwd=tmp_path)


@pytest.mark.slow
def test_the_wheel_alone_has_the_command(python, tmp_path):
    calfree = python.with_name("calfree")
    assert "print it at 100 %" in run(calfree, "marks", "--paper=Letter", cwd=tmp_path)
    assert run(python, "-c", LOADS, cwd=tmp_path) == "calfree_agents\n"


@pytest.mark.slow
def test_the_wheel_alone_runs_what_the_readme_shows(python, tmp_path):
    blocks = re.findall(r"^```python\n(.*?)^```", PAGES[0].read_text(), re.DOTALL | re.MULTILINE)
    agents = "import calfree_agents as agents"
    shown = re.sub(r"^import agents\b", agents, "".join(blocks), flags=re.MULTILINE)
    assert agents in shown
    assert "reached: True" in run(python, "-c", shown, cwd=tmp_path)


@pytest.mark.slow
def test_type_checkers_see_the_types_of_the_wheel(python, tmp_path):
    code = "import calfree_agents, calfree_gym; calfree_agents.names().wrong; calfree_gym.MOUNTS.wrong"
    command = [sys.executable, "-m", "mypy", "--python-executable", python, "--no-incremental", "-c", code]
    checked = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False).stdout
    assert checked.count('has no attribute "wrong"') == 2, checked


@pytest.mark.slow
def test_each_package_loads_the_agents_that_the_other_has_saved(wheel, tmp_path):
    ZipFile(wheel).extractall(tmp_path)
    path = os.pathsep.join((str(tmp_path), str(REPOSITORY)))
    run(sys.executable, "-c", BOTH_NAMES, cwd=tmp_path, PYTHONPATH=path)


def test_hints_name_what_can_be_installed():
    """The project is on no package index."""
    extras = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    named = set()
    for package in ("calfree_gym", "agents", "experiments", "examples"):
        for path in (REPOSITORY / package).rglob("*.py"):
            text = path.read_text()
            assert "calfree-gym[" not in text, path
            named |= set(re.findall(r"to_install\([\"'](\w+)[\"']\)", text))
    assert named == {"agents", "cluster", "perturb", "vision"}
    for page in (*PAGES, *REPOSITORY.glob("*.md")):
        named |= {
            each for group in re.findall(r"\.\[([\w,]+)\]", page.read_text()) for each in group.split(",")
        }
    assert named <= extras.keys()
