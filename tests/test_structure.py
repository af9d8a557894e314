"""The house: arrows run one way, imports stay light."""

import ast
import os
import subprocess
import sys
from importlib.util import resolve_name
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BELOW = {"calfree_gym": [], "agents": ["calfree_gym"], "experiments": ["calfree_gym", "agents"]}
PUBLIC = {
    "calfree_gym.errors",
    "calfree_gym.errors.yaml_values",
    "calfree_gym.image",
    "calfree_gym.sb3",
    "calfree_gym.wrappers",
}
"""What agents may know of the black box."""
PUBLIC_FOR_CALIBRATED = {
    "calfree_gym.world",
    "calfree_gym.geometry",
    "calfree_gym.robot.arms.kinematics",
    "calfree_gym.robot.arms.movemaster",
    "calfree_gym.vision.cameras",
}
"""What the calibrated robots may know besides: how the robot was built."""


def modules(package):
    """Its modules by name, packages by theirs, with the file of each."""
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in (ROOT / package).rglob("*.py")
    }


MODULES = {name: path for package in BELOW for name, path in modules(package).items()}


def imported(path):
    """Names of all that a file imports, at whatever place, but for type checking."""
    names = set()

    def visit(node):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            children = node.orelse
        else:
            children = ast.iter_child_nodes(node)
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            package = ".".join(path.relative_to(ROOT).parts[:-1])
            module = resolve_name("." * node.level + (node.module or ""), package)
            inner = [f"{module}.{alias.name}" for alias in node.names]
            names.update(name if name in MODULES else module for name in inner)
        for child in children:
            visit(child)

    visit(ast.parse(path.read_text(encoding="utf-8")))
    return names


@pytest.mark.parametrize("package", BELOW)
def test_packages_import_none_above_them(package):
    for name, path in modules(package).items():
        ours = {each.split(".")[0] for each in imported(path)} & BELOW.keys()
        assert ours <= {package, *BELOW[package]}, f"{name} imports {ours}"


def test_agents_import_the_listed_public_modules_of_the_black_box():
    for name, path in modules("agents").items():
        found = {each for each in imported(path) if each.split(".")[0] == "calfree_gym"}
        allowed = PUBLIC | PUBLIC_FOR_CALIBRATED if ".calibrated" in name else PUBLIC
        assert found <= allowed, f"{name} imports {sorted(found - allowed)}"


def test_agents_import_themselves_relatively_and_no_other_package_does():
    """In the wheel `agents` has another name."""
    for name, path in MODULES.items():
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        written = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
        froms = [node for node in nodes if isinstance(node, ast.ImportFrom)]
        written |= {"." * node.level + (node.module or "") for node in froms}
        unwanted = "agents" if name.split(".")[0] == "agents" else ""
        assert unwanted not in {each.split(".")[0] for each in written}, name


@pytest.mark.parametrize(
    ("statement", "unwanted"),
    [
        ("import calfree_gym", {"torch", "OpenGL", "matplotlib", "stable_baselines3", "scipy"}),
        (
            "import gymnasium, calfree_gym; e = gymnasium.make('CalFree/Reach-v0'); e.reset(seed=0);"
            "e.step(e.action_space.sample())",
            {"torch", "OpenGL", "matplotlib"},
        ),
        (
            "from calfree_gym.cli import main; main(['marks', '--out=/dev/null'])",
            {"agents", "calfree_agents", "torch", "lerobot", "OpenGL", "matplotlib", "scipy"},
        ),
        (
            "import gymnasium, agents; from calfree_gym.tasks.reach import PRIVILEGED;"
            "e = gymnasium.make('calfree_gym:CalFree/Reach-v0', tell=tuple(PRIVILEGED));"
            "[agents.make(name, e).learn(3) for name in agents.names() if name not in agents.NEURAL]",
            {"torch", "OpenGL", "matplotlib", "stable_baselines3", "scipy"},
        ),
    ],
    ids=["import", "environment", "command", "classical agents"],
)
def test_what_is_not_needed_is_not_loaded(statement, unwanted):
    code = f"{statement}\nimport sys; print(sorted({unwanted!r} & sys.modules.keys()))"
    own = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}  # it loads OpenGL
    done = subprocess.check_output([sys.executable, "-c", code], cwd=ROOT, text=True, env=own)
    assert done.splitlines()[-1] == "[]"
