"""The house: arrows run one way, imports stay light, the wheel ships the black box alone."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MAY_IMPORT = {
    "calfree_gym": {"calfree_gym"},
    "agents": {"agents", "calfree_gym"},
    "experiments": {"experiments", "agents", "calfree_gym"},
}


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_arrows_run_one_way(package):
    for path in (ROOT / package).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path}: relative import"
                names = [str(node.module)]
            else:
                continue
            ours = {name.split(".")[0] for name in names} & MAY_IMPORT.keys()
            assert ours <= MAY_IMPORT[package], f"{path} imports {ours}"


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
            "import gymnasium, agents; from calfree_gym.envs.goal import PRIVILEGED;"
            "e = gymnasium.make('calfree_gym:CalFree/Reach-v0', tell=tuple(PRIVILEGED));"
            "[agents.make(name, e).learn(3) for name in agents.names() if name != 'sac']",
            {"torch", "OpenGL", "matplotlib", "stable_baselines3", "scipy"},
        ),
    ],
    ids=["import", "environment", "classical agents"],
)
def test_what_is_not_needed_is_not_loaded(statement, unwanted):
    code = f"{statement}\nimport sys; print(sorted({unwanted!r} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
