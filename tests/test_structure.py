"""The house: arrows run one way, imports stay light."""

import ast
import graphlib
import subprocess
import sys
from collections import Counter
from importlib.util import resolve_name
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LAYERS = {
    "calfree_gym": "errors files wrappers image reaching geometry streams pool vision robot world "
    "perturbations perturb rendering engine tasks calfree_gym envs sb3 picture_reach lerobot cli",
    "agents": "base neural servo calibrated knowledge memory rivals body_schema grasp docking reference "
    "registry moved agents",
    "experiments": "errors options config evaluation experiments running statistics reporting execution "
    "protocol tuning film fetch_reach arm_check studies __main__",
}
"""Subpackages and modules of each package, from the ground up; its own name stands for its `__init__`. Each
may import those before it, and none after it."""
PACKAGES_BELOW = {"calfree_gym": [], "agents": ["calfree_gym"], "experiments": ["calfree_gym", "agents"]}
PUBLIC = {
    "calfree_gym.errors",
    "calfree_gym.errors.yaml_values",
    "calfree_gym.files",
    "calfree_gym.image",
    "calfree_gym.sb3",
    "calfree_gym.wrappers",
}
"""What agents may know of the black box: how long a pixel is, how errors and settings read, how files are
written, what adapts it to learners."""
PUBLIC_FOR_CALIBRATED = {
    "calfree_gym.world",
    "calfree_gym.geometry",
    "calfree_gym.robot.arms.movemaster",
    "calfree_gym.robot.motors",
    "calfree_gym.vision.cameras",
}
"""What the calibrated robots may know besides: how the robot was built, and the kind of its motors."""
MOST_LINES = 600
EXTRA = "to_install('agents')"


def modules(package):
    """Its modules by name, packages by theirs, with the file of each."""
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in (ROOT / package).rglob("*.py")
    }


MODULES = {name: path for package in LAYERS for name, path in modules(package).items()}


def imported(path, for_types=False):
    """Names of all that a file imports, at whatever place; for type checking too, where that is asked."""
    names = set()

    def visit(node):
        if not for_types and isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
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


def top(module):
    """The subpackage or module of its package that a module belongs to."""
    return module.split(".")[1] if "." in module else module


@pytest.mark.parametrize("package", LAYERS)
def test_packages_import_none_above_them(package):
    for name, path in modules(package).items():
        ours = {each.split(".")[0] for each in imported(path)} & LAYERS.keys()
        assert ours <= {package, *PACKAGES_BELOW[package]}, f"{name} imports {ours}"


@pytest.mark.parametrize("package", LAYERS)
def test_subpackages_import_none_above_them(package):
    order = {name: place for place, name in enumerate(LAYERS[package].split())}
    assert order.keys() == {top(name) for name in modules(package)}, "LAYERS names what there is"
    for name, path in modules(package).items():
        for each in imported(path) & modules(package).keys():
            assert order[top(each)] <= order[top(name)], f"{name} imports {each}, which is above it"


@pytest.mark.parametrize("package", LAYERS)
def test_modules_import_each_other_in_no_circle(package):
    own = modules(package)
    graph = {name: imported(path, for_types=True) & own.keys() for name, path in own.items()}
    graphlib.TopologicalSorter(graph).prepare()


def test_agents_import_themselves_relatively_and_no_other_package_does():
    """In the wheel `agents` has another name."""
    for name, path in MODULES.items():
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        written = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
        written |= {
            "." * node.level + (node.module or "") for node in nodes if isinstance(node, ast.ImportFrom)
        }
        relative = {each for each in written if each.startswith(".")}
        if name.split(".")[0] == "agents":
            by_name = {each for each in written if each.split(".")[0] == "agents"}
            assert not by_name, f"{name} imports {sorted(by_name)} by name"
        else:
            assert not relative, f"{name} imports {sorted(relative)} relatively"


def test_agents_import_the_listed_public_modules_of_the_black_box_and_the_lists_are_as_short_as_can_be():
    used, used_by_calibrated = set(), set()
    for name, path in modules("agents").items():
        found = {each for each in imported(path) if each.split(".")[0] == "calfree_gym"}
        calibrated = top(name) == "calibrated"
        allowed = PUBLIC | PUBLIC_FOR_CALIBRATED if calibrated else PUBLIC
        assert found <= allowed, f"{name} imports {sorted(found - allowed)}"
        used |= found
        used_by_calibrated |= found if calibrated else set()
    assert used == PUBLIC | PUBLIC_FOR_CALIBRATED
    assert used_by_calibrated >= PUBLIC_FOR_CALIBRATED


def test_the_black_box_names_agents_in_one_place_which_loads_them_where_a_command_needs_them():
    """`calfree reach`; all else of it needs none."""
    naming = {
        name
        for name, path in modules("calfree_gym").items()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8").replace(EXTRA, "None")))
        if isinstance(node, ast.Constant) and node.value in ("agents", "calfree_agents")
    }
    assert naming == {"calfree_gym.cli.loading"}


def test_each_class_has_a_name_of_its_own():
    names = [
        node.name
        for path in MODULES.values()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    ]
    assert [name for name, times in Counter(names).items() if times > 1] == []


@pytest.mark.parametrize("folder", [*LAYERS, "tests", "examples", "docs"])
def test_no_file_is_longer_than_can_be_read_at_once(folder):
    for path in (ROOT / folder).rglob("*.py"):
        lines = len(path.read_text(encoding="utf-8").splitlines())
        assert lines < MOST_LINES, f"{path.relative_to(ROOT)} has {lines} lines"


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
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
