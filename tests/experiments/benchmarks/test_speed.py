"""The benchmark's table, JSON and peers; what it measures is asserted nowhere."""

import json
import sys

import pytest

from experiments.__main__ import main
from experiments.benchmarks.speed import grasping
from experiments.benchmarks.speed import rates as speed
from experiments.benchmarks.speed.peer import Peer
from experiments.errors import ConfigError


def test_a_peer_steps_when_it_is_asked_to_and_tells_what_it_is():
    with Peer(f"{sys.executable}=CartPole-v1") as peer:
        assert peer.substeps is None
        assert peer.versions["gymnasium"]
        few, many = peer.seconds(10), peer.seconds(5000)
    assert 0 < few < many


@pytest.fixture
def simulated(tmp_path, monkeypatch):
    """A peer that has its substeps where panda-gym has them."""
    (tmp_path / "tiny_peer.py").write_text(
        "import gymnasium, types\n"
        "from gymnasium.envs.classic_control import CartPoleEnv\n"
        "class Tiny(CartPoleEnv):\n"
        "    sim = types.SimpleNamespace(n_substeps=20, timestep=0.002)\n"
        "gymnasium.register('Tiny-v0', Tiny)\n"
        "print('hello from a chatty package')\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return f"{sys.executable}=tiny_peer:Tiny-v0"


def test_a_peer_tells_its_substeps(simulated):
    with Peer(simulated) as peer:
        assert (peer.substeps, peer.timestep) == (20, 0.002)


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ("CartPole-v1", "found no PYTHON=ENV_ID"),
        ("/no/python=CartPole-v1", "/no/python cannot be run: No such file"),
        (f"{sys.executable}=NoSuch-v0", "NoSuch"),
        (f"{sys.executable}=no_such_module:Id-v0", "no_such_module"),
    ],
)
def test_peers_that_cannot_be_had(spec, said, capsys):
    with pytest.raises(ConfigError, match=said):
        Peer(spec)
    assert main(["benchmark", "--peer", spec]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_table_and_json_hold_the_same_ratios(simulated, monkeypatch, capsys):
    measured = speed.speed([simulated], rounds=1)
    monkeypatch.setattr(speed, "speed", lambda peers: measured)
    assert main(["benchmark"]) == 0
    table = capsys.readouterr().out
    assert main(["benchmark", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    units = [ratio["unit"] for ratio in found["ratios"]]
    assert units.count("environment steps") == 9
    assert units.count("physics substeps") == units.count("simulated seconds") == 2
    for ratio in found["ratios"]:
        assert f"| {ratio['name']} | {ratio['unit']} | {ratio['ratio']:.2f} |" in table
        assert ratio["ratio"] > 0
    assert found["machine"]["mujoco"]
    substeps = next(ratio for ratio in found["ratios"] if ratio["unit"] == "physics substeps")
    seconds = next(ratio for ratio in found["ratios"] if ratio["unit"] == "simulated seconds")
    assert seconds["ours"] / substeps["ours"] == pytest.approx(0.005)
    assert seconds["other"] / substeps["other"] == pytest.approx(0.002)


def test_grasping_is_timed_with_free_jaws_and_holding(monkeypatch):
    monkeypatch.setattr(grasping, "ROUNDS", 1)
    monkeypatch.setattr(grasping, "ROWS", 2)
    (table,) = grasping.grasping()
    assert [row.split(", ")[-1] for row in table.frame["row"]] == ["jaws free"] * 2 + ["object held"] * 2 + [
        "jaws free"
    ]
    assert (table.frame[["ratio", "ours a second", "other a second"]] > 0).all(axis=None)
