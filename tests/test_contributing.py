"""The recipes of CONTRIBUTING.md, followed word for word in a copy of the repository."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text()
FOLDERS = ("calfree_gym", "agents", "experiments", "docs")
FILES = ("mkdocs.yml", "pyproject.toml", "README.md")
RECIPES = {
    part.splitlines()[0].removeprefix("a ").removeprefix("an "): part
    for part in TEXT.split("\n## Recipe: ")[1:]
}
STEP = re.compile(
    r"^(?P<what>New file|In|Try it)(?: `(?P<file>[^`]+)`)?"
    r"(?:, (?P<where>before|after every|after) (?P<ticks>`+) ?(?P<anchor>.+?) ?(?P=ticks))?:\n\n"
    r"```\w*\n(?P<block>.*?)^```",
    re.MULTILINE | re.DOTALL,
)
BEGINNING = re.compile(r"^(?:New file|In|Try it)\b", re.MULTILINE)


def run(*command, cwd):
    environment = os.environ | {"PYTHONPATH": str(cwd)}
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def follow(recipe, folder):
    """Carries out a recipe in a folder."""
    steps = list(STEP.finditer(RECIPES[recipe]))
    assert len(steps) == len(BEGINNING.findall(RECIPES[recipe])), "a step that this test does not understand"
    for step in steps:
        if step["what"] == "Try it":
            shell = step["block"].startswith(".venv/bin/python ")
            command = shlex.split(step["block"])[1:] if shell else ["-c", step["block"]]
            run(sys.executable, *command, cwd=folder)
            continue
        path = folder / step["file"]
        assert path.exists() == (step["what"] == "In")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(inserted(path.read_text(), step) if step["what"] == "In" else step["block"])


def inserted(text, step):
    """A text with a step's block, as far indented as the line it is put beside."""
    lines = text.splitlines(keepends=True)
    places = [i for i, line in enumerate(lines) if line.strip() == step["anchor"]]
    assert len(places) == 1 or (places and step["where"] == "after every"), step["anchor"]
    for at in reversed(places):
        block = textwrap.indent(step["block"], re.match(" *", lines[at])[0])
        lines.insert(at + (step["where"] != "before"), block)
    return "".join(lines)


@pytest.fixture
def copy(tmp_path):
    for name in FOLDERS:
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__", "results"))
    for name in FILES:
        shutil.copy(ROOT / name, tmp_path)
    where = run(sys.executable, "-c", "import calfree_gym, agents; print(calfree_gym.__file__)", cwd=tmp_path)
    assert where.startswith(str(tmp_path))
    return tmp_path


@pytest.mark.parametrize("recipe", RECIPES)
@pytest.mark.slow
def test_recipe(recipe, copy):
    follow(recipe, copy)
    globals()[f"check_{recipe}"](copy)


def check_task(copy):
    """Suites know it, and it passes what Gymnasium asks of all."""
    code = """
from gymnasium.utils.env_checker import check_env
from experiments.config.environment import EnvironmentConfig
env = EnvironmentConfig(id='CalFree/Follow-v0', world='nominal', occlusion=True)
check_env(env.make().unwrapped, skip_render_check=True)
print(env.task)
"""
    assert run(sys.executable, "-c", code, cwd=copy) == "reach\n"


def check_suite(copy):
    """Its report shows both agents at both values."""
    report = (copy / "build" / "results" / "zoomed" / "report.md").read_text()
    assert "focal_length" in report
    assert "test-motion servo" in report


def check_study(copy):
    """Its test passes, and its table was written."""
    run(sys.executable, "-m", "pytest", "-q", "tests/experiments/studies/test_zoom_range.py", cwd=copy)
    assert '"zoom_range"' in (copy / "build" / "results" / "zoom_range.json").read_text()


def check_perturbation(copy):
    """It stands in the documentation's table."""
    code = "import sys; sys.path.insert(0, 'docs'); import hooks; print(hooks.on_page_markdown(sys.argv[1]))"
    page = run(sys.executable, "-c", code, "<!-- perturbations -->", cwd=copy)
    assert "### `sensor_slip`" in page
    assert "| `px` | pixels | any number | -20 to 20 | -0.2 to 0.2 |" in page


def check_agent(copy):
    """It has a section in the documentation, and is saved and loaded as all agents are."""
    assert "\n### `plain_servo`\n" in (copy / "docs/agent-settings.md").read_text()
    code = (
        "import gymnasium as gym, agents\n"
        "env = gym.make('calfree_gym:CalFree/Reach-v0', dynamics='kinematic')\n"
        "agent = agents.make('plain_servo', env, seed=1).learn(20)\n"
        "agent.save('plain.npz')\n"
        "print(agents.make('plain_servo', env).load('plain.npz').num_timesteps)"
    )
    assert run(sys.executable, "-c", code, cwd=copy) == "20\n"


def check_arm(copy):
    """It was drawn."""
    assert (copy / "runs/three.png").stat().st_size > 5000


def check_figure(copy):
    """It was drawn, and stands in both reports."""
    folder = copy / "runs/tiny"
    assert (folder / "figures/distances.png").stat().st_size > 5000
    assert "figures/distances.png" in (folder / "report.md").read_text()
    assert ">Distances</" in (folder / "report.html").read_text()
