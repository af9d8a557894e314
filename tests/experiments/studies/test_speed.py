"""The benchmark's table, JSON and peers; what it measures is asserted nowhere."""

import sys

import pytest

from experiments.__main__ import main
from experiments.errors import ConfigError
from experiments.studies import common, speed
from experiments.studies.speed import Peer, motions


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


def test_rows_of_a_peer_are_timed_beside_as_many_of_ours(tmp_path, monkeypatch):
    (tmp_path / "envpool.py").write_text(
        "import gymnasium as gym, numpy as np\n"
        "class Rows(gym.Env):\n"
        "    num_envs, action_space = 64, gym.spaces.Box(-1, 1, (2,))\n"
        "    def step(self, action):\n"
        "        assert action.shape == (64, 2)\n"
        "        over = np.ones(64, bool)\n"
        "        return action, over, over, over, {}\n"
        "    def reset(self, seed=None):\n"
        "        assert seed == 0, 'once: rows begin anew by themselves'\n"
        "def make_gymnasium(env_id, num_envs, num_threads, seed):\n"
        "    assert (env_id, num_envs, num_threads) == ('Some-v4', 64, 1)\n"
        "    return Rows()\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with Peer(f"{sys.executable}=envpool:Some-v4") as peer:
        found = list(speed.beside(peer, 1))
    assert [line.what for line in found] == [
        f"a step of 64 {dynamics} rows, one thread / of 64 of envpool:Some-v4"
        for dynamics in ("kinematic", "physics")
    ]
    assert all(line.ratio == pytest.approx(line.beside / line.seconds) for line in found)


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
def test_everything_is_timed(simulated, monkeypatch):
    own = common.arms_of_tests()
    few = {name: own[name] for name in ("gantry", motions.SEVEN_MOTORS)}
    monkeypatch.setattr(motions, "arms_of_tests", lambda: few)
    monkeypatch.setattr(speed, "by_rows", lambda rounds: motions.by_rows(rounds, (1, 4)))
    table, rows = speed.tables([simulated], rounds=1)
    told = table.frame.set_index("ours / beside it")
    second = told.loc["a simulated second of one arm / tiny_peer:Tiny-v0", "times as fast"]
    step = told.loc["a step of one arm / tiny_peer:Tiny-v0", "times as fast"]
    assert second == pytest.approx(step * (100 * 0.005) / (20 * 0.002))
    assert not any("PPO until" in what for what in told.index), "it has no goals"
    assert (told["times as fast"].dropna() > 0).all()
    assert rows.frame["rows"].tolist() == [1, 4]
    assert (rows.frame > 0).all(axis=None)
    lines = [line.get_ydata() for line in speed.figure([table, rows]).axes[0].lines]
    assert [len(line) for line in lines[:4]] == [2, 2, 2, 2]


def test_grasping_is_timed_with_free_jaws_and_holding():
    assert all(each.ratio > 0 for each in motions.grasping(1, rows=2, motions=2, bare_steps=20))


def test_the_ratio_is_of_pairs_in_turns():
    ours, other = iter((1.0, 2.0, 30.0)), iter((2.0, 8.0, 90.0))
    line = motions.in_turns("", lambda: next(ours), lambda: next(other), 3)
    assert (line.seconds, line.beside, line.ratio) == (2, 8, 3)


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (2.34e-7, "0.2 µs"),
        (9.94e-6, "9.9 µs"),
        (0.00099949, "999 µs"),
        (0.0099, "9.9 ms"),
        (0.99951, "1.0 s"),
        (75, "75 s"),
        (None, ""),
    ],
)
def test_times_are_written_in_the_unit_that_reads_best(seconds, said):
    assert motions.written(seconds) == said
