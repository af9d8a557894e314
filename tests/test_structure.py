"""The house: arrows run one way, imports stay light."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BELOW = {"calfree_gym": [], "agents": ["calfree_gym"], "experiments": ["calfree_gym", "agents"]}


@pytest.mark.parametrize("package", BELOW)
def test_packages_import_none_above_them_and_agents_import_themselves_relatively(package):
    """In the wheel `agents` has another name."""
    for path in (ROOT / package).rglob("*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        froms = [node for node in nodes if isinstance(node, ast.ImportFrom)]
        named = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
        named |= {node.module for node in froms if not node.level}
        ours = {each.split(".")[0] for each in named} & BELOW.keys()
        assert ours <= {package, *BELOW[package]} - ({"agents"} if package == "agents" else set()), path
        assert package == "agents" or not any(node.level for node in froms), path


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
