"""The recipes of CONTRIBUTING.md, followed word for word in a copy of the repository."""

import re
import shlex
import shutil
import sys
import textwrap

import pytest

from tests import test_wheel
from tests.test_wheel import REPOSITORY

TEXT = (REPOSITORY / "CONTRIBUTING.md").read_text()
COPIED = (
    "calfree_gym",
    "agents",
    "experiments",
    "docs",
    "mkdocs.yml",
    "pyproject.toml",
    "README.md",
    "tests/test_structure.py",
)
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
    return test_wheel.run(*command, cwd=cwd, PYTHONPATH=str(cwd))


def follow(recipe, folder):
    """Carries out a recipe in a folder; returns the files changed, and how many lines were written."""
    files, lines = set(), 0
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
        times = 1
        if step["what"] == "In":
            text, times = inserted(path.read_text(), step)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text if step["what"] == "In" else step["block"])
        if path.suffix == ".py":
            files.add(path)
            lines += times * sum(bool(line.strip()) for line in step["block"].splitlines())
    return files, lines


def inserted(text, step):
    """A text with a step's block, as far indented as the line it is put beside; and how often."""
    lines = text.splitlines(keepends=True)
    places = [i for i, line in enumerate(lines) if line.strip() == step["anchor"]]
    assert len(places) == 1 or (places and step["where"] == "after every"), step["anchor"]
    for at in reversed(places):
        block = textwrap.indent(step["block"], re.match(" *", lines[at])[0])
        if step["where"] == "before":
            gap = 2 * "\n" if lines[at].startswith("def ") else "\n" * lines[at].startswith("#")
            lines.insert(at, block + gap)
        else:
            lines.insert(at + 1, block)
    return "".join(lines), len(places)


@pytest.fixture
def copy(tmp_path):
    for name in COPIED:
        source = REPOSITORY / name
        if source.is_dir():
            shutil.copytree(source, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__", "results"))
        else:
            (tmp_path / name).parent.mkdir(exist_ok=True)
            shutil.copy(source, tmp_path / name)
    where = run(sys.executable, "-c", "import calfree_gym, agents; print(calfree_gym.__file__)", cwd=tmp_path)
    assert where.startswith(str(tmp_path))
    return tmp_path


def test_there_is_a_recipe_for_each():
    assert RECIPES.keys() == {"task", "perturbation", "agent", "arm", "suite", "study", "figure"}


@pytest.mark.parametrize("recipe", RECIPES)
@pytest.mark.slow
def test_recipe(recipe, copy):
    files, lines = follow(recipe, copy)
    assert lines < {"task": 60}.get(recipe, 30)
    ruff = [sys.executable, "-m", "ruff"]
    if files:
        run(*ruff, "check", *map(str, files), cwd=copy)
        run(*ruff, "format", "--check", *map(str, files), cwd=copy)
    run(sys.executable, "-m", "pytest", "-q", "-k", "not loaded", "tests/test_structure.py", cwd=copy)
    check = {
        "task": check_task,
        "perturbation": check_perturbation,
        "agent": check_agent,
        "arm": check_arm,
        "suite": check_suite,
        "study": check_study,
        "figure": check_figure,
    }[recipe]
    check(copy)


def check_task(copy):
    """Suites know it, and it passes what Gymnasium asks of all."""
    code = (
        "from gymnasium.utils.env_checker import check_env\n"
        "from experiments.config.environment import EnvironmentConfig\n"
        "env = EnvironmentConfig(id='CalFree/Follow-v0', world='nominal', occlusion=True)\n"
        "check_env(env.make().unwrapped, skip_render_check=True)\n"
        "print(env.task)"
    )
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
