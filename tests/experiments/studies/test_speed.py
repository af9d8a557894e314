"""The benchmark's table, JSON and peers; what it measures is asserted nowhere."""

import sys

import pytest

from experiments.__main__ import main
from experiments.errors import ConfigError
from experiments.studies import common, speed
from experiments.studies.speed import Peer


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


def test_a_peer_steps_when_it_is_asked_to_and_tells_what_it_is(simulated):
    with Peer(simulated) as peer:
        assert (peer.substeps, peer.timestep) == (20, 0.002)
    with Peer(f"{sys.executable}=CartPole-v1") as peer:
        assert peer.substeps is None
        assert peer.versions["gymnasium"]
        few, many = peer.seconds(10), peer.seconds(5000)
    assert 0 < few < many


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
def test_every_ratio_is_measured(simulated, monkeypatch):
    monkeypatch.setattr(speed, "arms_of_tests", lambda: {"gantry": common.arms_of_tests()["gantry"]})
    reaching, grasping, arms = (table.frame for table in speed.tables([simulated], rounds=1))
    units = reaching["unit"].tolist()
    assert units.count("environment steps") == 9
    assert units.count("physics substeps") == units.count("simulated seconds") == 2
    substeps, seconds = (
        reaching[reaching["unit"] == unit].iloc[0] for unit in ("physics substeps", "simulated seconds")
    )
    assert seconds["ours a second"] / substeps["ours a second"] == pytest.approx(0.005)
    assert seconds["other a second"] / substeps["other a second"] == pytest.approx(0.002)
    jaws = ["jaws free"] * 2 + ["object held"] * 2 + ["jaws free"]
    assert [row.split(", ")[-1] for row in grasping["row"]] == jaws
    assert arms["row"].tolist() == ["256 rows / bare Batch, gantry"]
    for found in (reaching, grasping, arms):
        assert (found[["ratio", "ours a second", "other a second"]] > 0).all(axis=None)


def test_grasping_is_timed_with_free_jaws_and_holding():
    assert all(each.ratio > 0 for each in speed._grasping(1, rows=2, motions=2, bare_steps=20))
