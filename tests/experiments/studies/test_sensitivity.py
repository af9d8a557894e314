"""Constants are found, varied wherever they are read, and judged; what is found is asserted nowhere."""

import ast

import numpy as np
import pytest

import agents
from agents.servo.image_model.gaussian_process import GaussianProcess
from agents.servo.jacobian import Kalman
from agents.servo.perception import NoiseEstimate
from experiments.statistics import Estimate
from experiments.studies import sensitivity
from experiments.studies.sensitivity import COLUMNS, VERDICTS, Sizes, judged, verdict

FOUND = {agent: sensitivity.constants_of(agent) for agent in sensitivity.MODULES}
EVERY = [each for found in FOUND.values() for each in found]
LABELS = {each.label: each for each in EVERY}
TINY = Sizes(first=1, later=1, trouble=1, lifetime=4)
ONLY = ("probe_px", "HomeView.SIGMAS")
MODULES = list(sensitivity._with_submodules(agents))
OTHERS = {
    "agents": {"base", "body_schema", "calibrated", "docking", "grasp", "neural", "registry", "rivals"},
    "agents.knowledge": {"learning_servo", "grid_table", "factored_table", "support_points"},
    "agents.servo": {
        *("jacobian", "jacobian_servo", "joint_space", "paper", "redundancy", "safe", "servo_agent", "trial"),
        "work_plane",
    },
}
"""Modules and packages with numbers of their own that are no part of these agents."""


def test_constants_of_settings_classes_and_modules_are_found():
    assert LABELS["probe_px"].value == 16.0
    assert LABELS["GaussianProcess.SPREAD"].value == GaussianProcess.SPREAD
    assert LABELS["gaussian_process.NOISIER"].value == 2.0
    assert {"Gating.TAILS", "Gating.MISTAKEN", "Gating.OF"} <= LABELS.keys()
    assert {"looks", "HomeView.SIGMAS"} <= {each.label for each in FOUND["memory"]}
    assert all(len({each.label for each in found}) == len(found) for found in FOUND.values())

    left_out = {"Reach.HALVINGS", "NoiseEstimate.MOST_PX", "seed"}
    assert not {*left_out, "gaussian_process.IMAGE_AREA"} & LABELS.keys(), "guards and exact numbers"


def test_no_number_of_the_agents_slips_by():
    listed = {module.__name__ for agent in sensitivity.MODULES for module in sensitivity.modules(agent)}
    others = tuple(f"{package}.{name}." for package, names in OTHERS.items() for name in names)
    for module in MODULES:
        name = module.__name__
        if name not in listed and not f"{name}.".startswith(others):
            found = [each.label for each in sensitivity.numbers("", module)]
            assert not found, f"{name} has {found}: list it in MODULES or in OTHERS"
    loaded = {f"{module.__name__}." for module in MODULES} | {"agents.neural."}
    assert loaded.issuperset(others)


def test_what_is_said_of_single_constants_is_said_of_ones_that_exist():
    numbers = {
        each.label
        for agent in sensitivity.MODULES
        for module in sensitivity.modules(agent)
        for each in sensitivity.numbers(agent, module)
    }
    labels = numbers | {each.label for agent in sensitivity.SETTINGS for each in sensitivity._settings(agent)}
    assert sensitivity.LEFT_OUT.keys() <= labels
    assert all(sensitivity.LEFT_OUT.values())
    assert sensitivity.BOUNDS.keys() <= LABELS.keys()


def test_a_new_constant_is_found(monkeypatch):
    source = "CLOSE, FAR_PX = 2.0, 9\n'''Tuned.'''\nclass Some:\n    SHARE: float = 0.5\n    PLAIN = 'text'\n"
    monkeypatch.setattr(sensitivity, "_tree", lambda module: ast.parse(source))
    module = type(ast)("agents.some")
    exec(source, vars(module))
    found = {each.label: (each.value, each.source) for each in sensitivity.numbers("memory", module)}
    assert found == {
        "some.CLOSE": (2.0, "tuned"),
        "some.FAR_PX": (9, "tuned"),
        "Some.SHARE": (0.5, "not said"),
    }


def test_constants_say_where_they_come_from():
    assert not [each.label for each in FOUND["unified_servo"] if each.source == "not said"]


@pytest.mark.parametrize("constant", EVERY, ids=lambda each: f"{each.agent}-{each.label}")
def test_a_constant_has_the_other_value_wherever_it_is_read_and_then_its_own(constant):
    value = constant.times(2.0)
    assert value != constant.value
    if constant.setting:
        with sensitivity.varied(constant, value) as settings:
            assert settings == {constant.name: value}
        return
    places = sensitivity.places(constant.module, constant.owner, constant.name)
    with sensitivity.varied(constant, value) as settings:
        assert settings == {}
        assert {getattr(holder, name) for holder, name in places} == {value}
    assert {getattr(holder, name) for holder, name in places} == {constant.value}


def test_a_constant_that_others_import_changes_there_too():
    marker = LABELS["perception.MARKER_NOISE_PX"]
    with sensitivity.varied(marker, 5.0):
        assert NoiseEstimate().px == Kalman(3).noise_px == 5.0
        names = ("MARKER_NOISE_PX", "NOISE_PX")
        imported = [vars(module)[name] for module in MODULES for name in names if name in vars(module)]
        assert len(imported) > 1
        assert set(imported) == {5.0}
    assert NoiseEstimate().px == Kalman(3).noise_px == marker.value


def test_an_error_leaves_no_constant_varied():
    with pytest.raises(KeyError), sensitivity.varied(LABELS["GaussianProcess.SPREAD"], 5.0):
        raise KeyError
    assert LABELS["GaussianProcess.SPREAD"].value == GaussianProcess.SPREAD


def test_no_constant_is_read_before_it_can_be_varied():
    """Defaults of arguments and values of modules and classes are computed once, when they are loaded."""
    names = {each.name for each in EVERY if not each.setting}
    for module in MODULES:
        for _, body in sensitivity._bodies(module):
            for node in body:
                once = [node] if isinstance(node, ast.Assign | ast.AnnAssign) else []
                if isinstance(node, ast.FunctionDef):
                    once = [*node.args.defaults, *(each for each in node.args.kw_defaults if each)]
                for part in (part for each in once for part in ast.walk(each)):
                    read = part.id if isinstance(part, ast.Name) else getattr(part, "attr", None)
                    stored = isinstance(getattr(part, "ctx", None), ast.Store)
                    assert stored or read not in names, f"{module.__name__}:{node.lineno} reads {read}"


def test_values_to_try():
    def tried(label, value, factor):
        owner, _, name = label.rpartition(".")
        return sensitivity.Constant("", "agents.x", owner, name, value, "", setting=not owner).times(factor)

    assert tried("Some.PX", 3.0, 2.0) == 6.0
    counts = [tried("Some.COUNT", value, factor) for value, factor in ((3, 0.5), (1, 0.5), (3, 2.0))]
    assert counts == [2, 1, 6]
    assert tried("Reach.AS_UNKNOWN", 0.7, 2.0) == 0.99
    assert tried("gaussian_process.NOISIER", 2.0, 0.5) > 1.0


@pytest.mark.parametrize(
    ("motions", "success", "expected"),
    [
        ((-0.05, 0.05), (-0.01, 0.01), "insensitive"),
        ((0.0, 0.0), (0.0, 0.0), "insensitive"),
        ((-0.06, 0.02), (0.0, 0.0), "not shown"),
        ((0.02, 0.03), (-0.02, 0.0), "not shown"),
        ((0.02, 0.09), (0.0, 0.0), "not shown"),
        ((0.06, 0.09), (0.0, 0.0), "sensitive"),
        ((-0.2, -0.06), (-0.3, 0.3), "sensitive"),
        ((0.0, 0.0), (-0.05, -0.02), "sensitive"),
    ],
)
def test_verdicts(motions, success, expected):
    assert verdict(Estimate(0.0, *motions), Estimate(0.0, *success)) == expected


def test_changes_are_those_of_worlds_in_percent_and_points():
    base = np.column_stack([np.linspace(8, 12, 20), np.full(20, 1.0)])
    found = judged(base, base * [1.1, 0.9])
    assert found["motions"] == pytest.approx(10.0)
    assert found["success"] == pytest.approx(-10.0)
    assert found["motions low"] == pytest.approx(10.0)
    assert found["verdict"] == "sensitive"
    assert judged(base, base * np.nan)["verdict"] == "raises an error"


@pytest.fixture(scope="module")
def measured():
    return sensitivity.effects(2, TINY, ONLY, jobs=1)


@pytest.mark.slow
def test_each_constant_is_measured_under_each_condition(measured):
    rows = {agent: len(own) for agent, own in measured.groupby("agent")}
    assert rows == {"unified_servo": 2 * 4, "memory": 2}
    assert set(measured.columns) == set(COLUMNS)
    assert set(measured["verdict"]) <= set(VERDICTS)
    assert not measured.isna().any(axis=None)
    assert (measured[measured["constant"] == "probe_px"]["differing"] > 0).any()


@pytest.mark.slow
def test_processes_find_the_same_and_the_table_shows_the_clearest(measured):
    found = sensitivity.clearest(sensitivity.effects(2, TINY, ONLY, jobs=2))
    assert list(found["constant"]) == list(measured["constant"].unique().repeat(2))
    for row in found.to_dict("records"):
        same = measured[(measured["constant"] == row["constant"]) & (measured["factor"] == row["factor"])]
        ranks = same["verdict"].map(VERDICTS.index)
        assert VERDICTS.index(row["verdict"]) == ranks.min()
        clearest = same[ranks == ranks.min()]
        assert abs(row["motions"]) == clearest["motions"].abs().max()
        assert row["differing"] == pytest.approx(same["differing"].mean())


def test_an_error_in_a_variation_is_told(monkeypatch):
    def fails(task, env, settings):
        if settings:
            raise ValueError("no")
        return np.ones((1, 2))

    monkeypatch.setattr(sensitivity, "measured", fails)
    found = sensitivity.clearest(sensitivity.effects(2, TINY, ("probe_px",), jobs=1))
    assert set(found["verdict"]) == {"raises an error"}
