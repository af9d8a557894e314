"""The one surface: predict, learn, save and load, for every agent."""

import warnings
import zipfile
import zlib
from io import BytesIO, StringIO
from itertools import islice

import gymnasium as gym
import numpy as np
import pytest

import agents
from agents.base import storage
from agents.base.prior_knowledge import PriorKnowledge
from calfree_gym import files
from calfree_gym.tasks.reach import PRIVILEGED
from tests.agents.neural.quick import QUICK
from tests.agents.trials import motions_of
from tests.arms.own import ARMS

NAMES = agents.names()


def environment(name, kind="ReachDense", make=gym.make, tell=tuple(PRIVILEGED), **options):
    """An environment that tells whatever any classical agent may ask for."""
    tell = () if name in QUICK else tell
    mount = "stand" if name == "sac_her" else "waist"
    return make(f"CalFree/{kind}-v0", dynamics="kinematic", camera_mount=mount, tell=tell, **options)


def make(name, seed=0, **settings):
    env = environment(name, max_episode_steps=30)
    env.reset(seed=4)
    return agents.make(name, env, seed=seed, **QUICK.get(name, {}), **settings), env


def words_of(agent, env, motions=6):
    """Words on a held-out trial."""
    return np.array([words for words, *_ in islice(motions_of(agent, env, seed=77), motions)])


def saved(agent):
    """What it would save; archives of torch and NumPy tell the time besides."""
    agent.save(file := BytesIO())
    if not zipfile.is_zipfile(file):
        return file.getvalue()
    with zipfile.ZipFile(file) as archive:
        return {entry: zlib.crc32(archive.read(entry)) for entry in archive.namelist() if entry != "data"}


@pytest.fixture(scope="module", params=NAMES)
def learned(request):
    """The name of an agent, one that has learned a little, and the environment of a trial held out."""
    agent, env = make(request.param)
    world = env.unwrapped.world
    agent.learn(80)
    assert env.unwrapped.world == world, "it stays in the world that it was given"
    return request.param, agent, environment(request.param, world=world)


def test_predict_gives_words_and_changes_nothing(learned):
    _, agent, held_out = learned
    before = saved(agent)
    words = words_of(agent, held_out)
    assert words.dtype == np.float32
    assert words.shape[1:] == (3,)
    assert (np.abs(words) <= 1).all()
    np.testing.assert_array_equal(words_of(agent, held_out), words)
    assert saved(agent) == before


def test_an_agent_loads_from_paths_and_open_files_and_acts_and_learns_on_alike(learned, tmp_path):
    name, agent, held_out = learned
    file = BytesIO(b"mine")
    file.seek(4)
    agent.save(file)
    path = tmp_path / "of" / "mine" / "agent"
    agent.save(path)
    file.seek(4)
    words = words_of(agent, held_out)
    with path.open("rb") as opened, warnings.catch_warnings():
        warnings.simplefilter("error")
        for place in (file, opened, str(path), path):
            again, env = make(name)
            again.load(place)
            assert again.num_timesteps == agent.num_timesteps == 80
            assert saved(again) == saved(agent)
            np.testing.assert_array_equal(words_of(again, held_out), words)
    again.learn(40)
    assert env.unwrapped.world == held_out.unwrapped.world
    agent.save(file := BytesIO())
    assert make(name)[0].load(file).num_timesteps == 80, "from its beginning: it stands at its end"


OPTIONAL = {"announced", "home_differences", "home_trials", "jacobian", "last_home", "looks_teach"}
OPTIONAL |= {"mistaken", "noise_differences", "rests", "returns", "smooth_lengths"}
OPTIONAL |= {"slope_registers", "slope_variances"}
"""Arrays that files of earlier versions lack."""


@pytest.mark.parametrize("learned", [name for name in NAMES if name not in agents.NEURAL], indirect=True)
def test_an_array_that_lacks_or_has_another_shape_is_refused_by_name_and_changes_nothing(learned):
    name, agent, _ = learned
    other, _ = make(name)
    before, arrays = saved(other), agent.arrays()
    damaged = [(key, {**arrays, key: array[..., None]}) for key, array in arrays.items() if array.size]
    for key in arrays.keys() - OPTIONAL:
        damaged.append((key, {name: array for name, array in arrays.items() if name != key}))
    for key, found in damaged:
        storage.save(file := BytesIO(), agent.kind, found, 80, 3)
        with pytest.raises(ValueError, match=f"damaged.*{key.split('/')[-1]}"):
            other.load(file)
        assert saved(other) == before


@pytest.mark.parametrize("name", ["memory", "recurrent_servo", "sac"])
def test_what_is_neither_a_path_nor_a_binary_file_is_told(name, tmp_path):
    agent, _ = make(name)
    (tmp_path / "there").write_bytes(b"whole")
    with (tmp_path / "there").open("rb") as to_read, (tmp_path / "text").open("w+") as text:
        for wrong in (7, None, StringIO(), text):
            for use, to in ((agent.save, "write"), (agent.load, "read")):
                with pytest.raises(
                    TypeError, match=f"found .*; allowed: a path, or a binary file .* to {to}"
                ):
                    use(wrong)
        with pytest.raises(TypeError, match="to write"):
            agent.save(to_read)
        with pytest.raises(ValueError, match="damaged or no s"):
            agent.load(to_read)
    with pytest.raises(ZeroDivisionError), storage.written(tmp_path / "there") as place:
        raise ZeroDivisionError(place.write(b"part"))
    assert (tmp_path / "there").read_bytes() == b"whole"
    assert not [*tmp_path.glob("*.partial")]
    with pytest.raises(FileExistsError, match="there"):
        agent.save(tmp_path / "there" / "agent")
    with pytest.raises(FileNotFoundError, match="nowhere: there is no such file"):
        agent.load(tmp_path / "nowhere")
    with pytest.raises(FileNotFoundError, match="there is no such file"):
        agent.load("no\0where")


@pytest.mark.parametrize("name", NAMES)
def test_learn_counts_motions_and_stops_when_told(name):
    agent, _ = make(name)
    seen = []
    agent.learn(25, callback=lambda progress: seen.append(progress.num_timesteps) or True)
    agent.learn(15, callback=lambda progress: seen.append(progress.num_timesteps) or True)
    assert seen == list(range(1, 41))
    agent.learn(100, callback=lambda progress: progress.num_timesteps < 50)
    assert agent.num_timesteps == 50


@pytest.mark.parametrize("name", NAMES)
def test_batched_observations_get_the_words_of_single_ones(name):
    agent, _ = make(name)
    batch = environment(name, "Reach", gym.make_vec, num_envs=3)
    observations, _ = batch.reset(seed=20)
    singles = [environment(name, "Reach") for _ in range(3)]
    now = [env.reset(seed=20 + i)[0] for i, env in enumerate(singles)]
    state, states, over = None, [None] * 3, [False] * 3
    for _ in range(5):
        words, state = agent.predict(observations, state)
        for i, env in enumerate(singles):
            if over[i]:  # its row of the batch begins another trial
                continue
            single, states[i] = agent.predict(now[i], states[i])
            np.testing.assert_allclose(words[i], single, rtol=0, atol=1e-6 if name in QUICK else 0)
            now[i], _, terminated, truncated, _ = env.step(words[i])
            over[i] = terminated or truncated
        observations, *_ = batch.step(words)


@pytest.mark.parametrize("name", ["unified_servo", "recurrent_servo", "recurrent_ppo"])
def test_a_lost_state_is_an_error_that_says_what_to_do(name):
    agent, env = make(name)
    observation, _ = env.reset()
    words, _ = agent.predict(observation)
    observation, *_ = env.step(words)
    with pytest.raises(ValueError, match="pass the state back"):
        agent.predict(observation)


@pytest.mark.parametrize(
    ("name", "settings", "said"),
    [
        ("grid_table", {}, r"holds UnifiedServo.*this agent is GridTable"),
        ("work_plane_servo", {}, r"holds UnifiedServo.*this agent is WorkPlaneServo"),
        ("unified_servo", {"probe_px": 9}, r"probe_px=16.0.*probe_px=9"),
    ],
)
def test_files_of_other_agents_are_refused(tmp_path, name, settings, said):
    make("unified_servo")[0].save(tmp_path / "agent")
    with pytest.raises(ValueError, match=said):
        make(name, **settings)[0].load(tmp_path / "agent")


def test_what_is_damaged_or_no_agent_is_told_without_the_words_of_libraries(monkeypatch):
    agent, written = make("grid_table")[0], [BytesIO() for _ in range(4)]
    agent.save(written[0])
    make("sac")[0].save(written[1])
    np.save(written[2], np.zeros(3))
    np.savez(written[3], np.zeros(3))
    whole, *foreign = (each.getvalue() for each in written)
    for found in (whole[:-40], whole[:300] + bytes(60) + whole[360:], whole[:500], b"no archive", *foreign):
        with pytest.raises(
            ValueError, match="damaged or no saved agent; allowed: a file that save of"
        ) as told:
            agent.load(BytesIO(found))
        assert not any(word in str(told.value) for word in ("pickle", "JSON", "Error"))
    monkeypatch.setattr(files, "MOST_BYTES", 10)
    with pytest.raises(ValueError, match="damaged") as told:
        agent.load(BytesIO(whole))
    assert "unpacked; allowed: 10" in str(told.value.__cause__)


def test_a_file_is_written_whole_or_not_at_all_and_through_no_link(tmp_path):
    """Nothing beside it has a name that anybody could foresee; its mode is that of any file, or stays."""
    (tmp_path / "other").write_text("stays")
    for name in ("agent.npz.partial", "agent.npz.part"):
        (tmp_path / name).symlink_to("other")
    (tmp_path / "agent.npz").write_text("before")
    with pytest.raises(TypeError), files.whole(tmp_path / "agent.npz") as file:
        file.write("no bytes")
    assert (tmp_path / "agent.npz").read_text() == "before"
    with files.whole(tmp_path / "agent.npz") as file:
        file.write(b"after")
    assert (tmp_path / "agent.npz").read_text() == "after"
    assert (tmp_path / "agent.npz").stat().st_mode == (tmp_path / "other").stat().st_mode
    assert (tmp_path / "other").read_text() == "stays"
    (tmp_path / "agent.npz").chmod(0o600)
    (tmp_path / "link").symlink_to("other")
    for name in ("agent.npz", "link"):
        with files.whole(tmp_path / name) as file:
            file.write(b"again")
    assert (tmp_path / "agent.npz").stat().st_mode & 0o777 == 0o600
    assert (tmp_path / "other").read_text() == "stays"
    assert not (tmp_path / "link").is_symlink()
    assert len(list(tmp_path.iterdir())) == 5


def test_what_would_have_to_be_pickled_is_not_written(tmp_path):
    (tmp_path / "agent.npz").write_bytes(b"before")
    with pytest.raises(TypeError, match=r"trials is array\(\[1000.*; allowed: an array of plain numbers"):
        storage.save(tmp_path / "agent.npz", "kind", {"trials": np.array([10**30])}, 0, 3)
    assert (tmp_path / "agent.npz").read_bytes() == b"before"


@pytest.mark.parametrize("name", ["memory", "recurrent_servo", "sac"])
def test_an_agent_is_saved_where_a_link_leads(name, tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("folder/agent")
    make(name)[0].save(tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert make(name)[0].load(tmp_path / "folder/agent").num_timesteps == 0


@pytest.mark.parametrize("name", ["memory", "unified_servo", "random"])
def test_what_was_saved_for_an_arm_of_other_motors_says_so(name, tmp_path):
    make(name)[0].save(tmp_path / "three.npz")
    four = agents.make(name, gym.make("CalFree/Reach-v0", arm=ARMS["scara"]))
    with pytest.raises(ValueError, match=r"three\.npz was saved for 3 motors; this agent's .* has 4"):
        four.load(tmp_path / "three.npz")


class Blind(gym.Wrapper):
    """Tells nothing in info, and a reward only where it is asked for."""

    def __init__(self, env, rewarded):
        super().__init__(env)
        self.rewarded = rewarded

    def reset(self, **arguments):
        return self.env.reset(**arguments)[0], {}

    def step(self, action):
        observation, reward, terminated, truncated, _ = self.env.step(action)
        return observation, reward if self.rewarded else np.nan, terminated, truncated, {}


def test_an_agent_needs_nothing_that_it_does_not_declare(learned):
    name, agent, held_out = learned
    blind = environment(name, tell=agent.privileged, max_episode_steps=30)
    blind.reset(seed=4)
    env = Blind(blind, PriorKnowledge.REWARD in agent.prior_knowledge)
    other = agents.make(name, env, seed=0, **QUICK.get(name, {})).learn(80)
    np.testing.assert_array_equal(words_of(other, held_out), words_of(agent, held_out))
    assert name in QUICK or PriorKnowledge.REWARD not in agent.prior_knowledge
    if agent.privileged:
        with pytest.raises(ValueError, match="tell="):
            agents.make(name, gym.make("CalFree/Reach-v0"))
