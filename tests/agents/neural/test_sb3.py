"""The adapter of stable-baselines3: algorithms by name, networks' inputs, rows, files that run nothing."""

import io
import json
import os
import pickle
import tempfile
import zipfile
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import stable_baselines3
import torch
import yaml
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import DummyVecEnv

import agents
from agents.neural.sb3.inputs import ImageDistance, flattened
from agents.registry import SB3
from tests.agents.neural.quick import QUICK

CONFIGS = Path(__file__).parents[3] / "configs" / "agents"


def make(name="sac", env=None, **settings):
    env = env or gym.make("CalFree/ReachDense-v0", dynamics="kinematic", camera_mount="stand")
    return agents.make(name, env, **{**QUICK[name], **settings})


def rows_of_one_world(rows=4):
    return gym.make_vec(
        "CalFree/ReachDense-v0",
        num_envs=rows,
        dynamics="kinematic",
        world="nominal",
        autoreset_mode=AutoresetMode.SAME_STEP,
    )


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"algorithm": "sb3_contrib.CrosQ"},
            r"'sb3_contrib.CrosQ' \(did you mean sb3_contrib.CrossQ.*allowed:",
        ),
        (
            {"algorithm": "stable_baselines.SAC"},
            r"did you mean stable_baselines3.SAC.*allowed: .*sb3_contrib.TQC",
        ),
        ({"algorithm": "os.system"}, r"algorithm is 'os.system'; allowed: stable_baselines3.A2C"),
        (
            {"algorithm": "sb3_contrib.TQC", "n_epochs": 3},
            r"has no setting 'n_epochs'.*top_quantiles_to_drop",
        ),
        ({"algorithm": "stable_baselines3.DQN"}, "only supports .*Discrete"),
        ({"replay_buffer_class": "HerReplayBufer"}, "did you mean HerReplayBuffer"),
        ({"policy_kwargs": {"activation_fn": "Silu"}}, "activation_fn is 'Silu'.*allowed: .*SiLU"),
        ({"action_noise": -1}, "action_noise is -1"),
        ({"distance_scales": [0]}, "distance_scales is 0"),
        ({"rows": 0}, "rows is 0"),
        (
            {"algorithm": "sb3_contrib.CrossQ", "replay_buffer_class": "HerReplayBuffer"},
            "observations by key",
        ),
    ],
    ids=str,
)
def test_wrong_settings_say_what_is_allowed(settings, message):
    env = gym.make("CalFree/ReachDense-v0")
    with pytest.raises(ValueError, match=message):
        agents.make("sb3", env, **settings)


@pytest.mark.parametrize("name", SB3)
def test_a_name_is_its_file_and_settings_given_override_it(name):
    tuned = yaml.safe_load((CONFIGS / f"{name}.yaml").read_text())
    by_name = make(name)._model
    assert f"{type(by_name).__module__.split('.')[0]}.{type(by_name).__name__}" == tuned["algorithm"]
    assert by_name.gamma == tuned["gamma"]
    assert make(name, gamma=0.123)._model.gamma == 0.123


def test_networks_get_the_image_distance():
    observation = gym.make("CalFree/Reach-v0").reset(seed=0)[0]
    space = gym.make("CalFree/Reach-v0").observation_space
    d = observation["achieved_goal"] - observation["desired_goal"]
    flat = torch.as_tensor(flattened(observation))[None]
    by_key = {key: torch.as_tensor(value)[None] for key, value in observation.items()}
    extractor = ImageDistance(space, 4, (1, 8))
    for features in (extractor(flat), extractor(by_key)):
        assert features.shape == (1, extractor.features_dim)
        np.testing.assert_allclose(features[0, :15], gym.spaces.flatten(space, observation))
        np.testing.assert_allclose(features[0, 15:], np.tanh([*d, *(8 * d)]), atol=1e-6)


@pytest.mark.parametrize("name", SB3)
def test_batches_get_the_words_of_single_observations(name):
    agent = make(name)
    batch = rows_of_one_world(3)
    observations, _ = batch.reset(seed=5)
    state, states = None, [None] * 3
    start = np.ones(3, bool)
    for _ in range(4):
        words, state = agent.predict(observations, state, start)
        for i in range(3):
            single = {key: value[i] for key, value in observations.items()}
            one, states[i] = agent.predict(single, states[i])
            np.testing.assert_allclose(words[i], one, atol=1e-6)
        observations, *_ = batch.step(words)
        start = np.zeros(3, bool)


def test_a_recurrent_network_remembers_within_a_trial_and_not_beyond():
    agent = make("recurrent_ppo").learn(60)
    observation = gym.make("CalFree/Reach-v0", camera_mount="stand").reset(seed=0)[0]
    first, state = agent.predict(observation)
    later, _ = agent.predict(observation, state)
    assert not np.array_equal(first, later)
    again, _ = agent.predict(observation, state, episode_start=np.array([True]))
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize("name", ["ppo", "recurrent_ppo", "sac"])
def test_rows_learn_together_and_their_motions_are_summed(name):
    agent, seen = make(name, rows_of_one_world(4)), []
    before = [parameter.clone() for parameter in agent._model.policy.parameters()]
    agent.learn(211, callback=lambda progress: seen.append(progress.num_timesteps) or True)
    assert seen == list(range(4, 212, 4))
    after = agent._model.policy.parameters()
    assert any(not torch.equal(*pair) for pair in zip(before, after, strict=True))
    with pytest.raises(ValueError, match="got 3 motions; its 4 rows make 4 at once"):
        agent.learn(3)


def weights(agent):
    return torch.cat([parameter.detach().flatten() for parameter in agent._model.policy.parameters()])


@pytest.mark.parametrize("name", ["ppo", "recurrent_ppo"])
@pytest.mark.parametrize("rows", [1, 4])
def test_every_whole_rollout_teaches_however_motions_are_divided(name, rows):
    rollout = 20 * rows
    divided, at_once = (make(name, rows_of_one_world(4) if rows == 4 else None) for _ in range(2))
    for updates in (2, 4, 6):  # epochs
        before = weights(divided)
        divided.learn(rollout)
        assert not torch.equal(before, weights(divided))
        assert divided._model._n_updates == updates
    at_once.learn(3 * rollout)
    assert at_once._model._n_updates == 6
    assert divided.num_timesteps == at_once.num_timesteps == 3 * rollout
    before = weights(divided)
    divided.learn(rollout - 1)
    assert torch.equal(before, weights(divided))


@pytest.mark.parametrize("rows", [1, 4])
def test_off_policy_motions_in_parts_are_all_kept_and_teach(rows):
    settings = {"train_freq": 4, "learning_starts": 0, "gradient_steps": 2}
    agent = make("sac", rows_of_one_world(4) if rows == 4 else None, **settings)
    for part in range(1, 21):
        agent.learn(4 * rows)
        assert agent._model.replay_buffer.pos == 4 * part
        assert agent._model._n_updates == 2 * part
    agent.learn(3 * rows)
    assert agent._model.replay_buffer.pos == 82
    assert agent._model._n_updates == 40


@pytest.mark.parametrize(("name", "setting"), [("ppo", {}), ("sac", {"train_freq": 4}), ("sac", {})])
def test_any_number_of_motions_is_never_exceeded(name, setting):
    for rows in (1, 4):
        env = rows_of_one_world(4) if rows == 4 else None
        agent, made = make(name, env, **setting), 0
        for asked in (4, 5, 19, 20, 21, 39, 41, 80):
            seen = []
            agent.learn(
                asked, callback=lambda progress, seen=seen: seen.append(progress.num_timesteps) or True
            )
            assert seen == list(range(made + rows, made + asked + 1, rows))
            made = seen[-1]
            assert agent.num_timesteps == agent._model.num_timesteps == made


def test_where_updates_wait_for_a_whole_trial_its_last_motion_is_kept():
    env = gym.make("CalFree/ReachDense-v0", dynamics="kinematic", max_episode_steps=6, tolerance_px=0.001)
    agent = make("sac", env, train_freq=(1, "episode"), learning_starts=0)
    agent.learn(12)
    assert agent._model.replay_buffer.pos == 12
    assert agent._model._n_updates == 2


def test_a_rollout_is_as_long_in_one_environment_as_in_rows():
    settings = {"rows": 4, "n_steps": 5, "batch_size": 10}
    assert make("ppo", **settings)._model.n_steps == 20
    assert make("ppo", rows_of_one_world(4), **settings)._model.n_steps == 5


def test_hindsight_says_where_it_is_not_valid():
    with pytest.warns(UserWarning, match="hindsight relabelling is not valid on the waist mount"):
        make("sac_her", gym.make("CalFree/Reach-v0", camera_mount="waist"))


def test_hindsight_relabels_with_places_that_the_gripper_came_to():
    agent = make("sac_her").learn(130)
    sample = agent._model.replay_buffer.sample(60)
    reached = agent._model.replay_buffer.next_observations["achieved_goal"][:130, 0]
    relabelled = [
        goal for goal in sample.observations["desired_goal"].numpy() if (goal == reached).all(1).any()
    ]
    assert len(relabelled) > 20


def test_learning_leaves_no_folders_behind(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    for name in ("sac", "ppo"):
        agent = make(name).learn(30)
        agent.save(tmp_path / "agent.zip")
        make(name).load(tmp_path / "agent.zip").learn(30)
    assert os.listdir(tmp_path) == ["agent.zip"]


def test_files_of_other_learners_are_refused(tmp_path):
    saved = tmp_path / "sac.zip"
    make().save(saved)
    for name, settings, message in (
        ("td3", {}, "algorithm stable_baselines3.SAC; this one has stable_baselines3.TD3"),
        ("sac", {"word_limit": 0.77}, r"'limit': [\d.]+.*this one has .*'limit': 0.77"),
        ("sac", {"net_arch": [17]}, r"'net_arch': \[16\].*this one has .*'net_arch': \[17\]"),
        ("sac", {"distance_scales": []}, "'distance_scales'.*this one has"),
    ):
        with pytest.raises(ValueError, match=message):
            make(name, **settings).load(saved)
    more = gym.make("CalFree/ReachDense-v0", tell=("joint_angles",))
    with pytest.raises(ValueError, match=r"'observation': \[7\].*this one has .*'joint_angles': \[5\]"):
        make(env=more).load(saved)
    saved.write_bytes(saved.read_bytes()[:200])
    with pytest.raises(ValueError, match="damaged or no saved learner"):
        make().load(saved)
    with zipfile.ZipFile(saved, "w") as archive:
        archive.writestr("readme.txt", "nothing")
    with pytest.raises(ValueError, match=r"holds readme.txt; a saved learner holds calfree.json"):
        make().load(saved)
    with pytest.raises(FileNotFoundError):
        make().load(tmp_path / "nowhere.zip")


class Bomb:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (Path(self.path),)


@pytest.mark.parametrize("form", ["ours", "foreign", "bare"])
def test_a_malicious_file_executes_nothing(form, tmp_path):
    """Pickles in every place where one could stand; `trusted` proves that they are live."""
    saved, crater = tmp_path / "agent.zip", tmp_path / "crater"
    agent = make()
    payload = io.BytesIO()
    torch.save({"parameters": Bomb(crater), "variables": {}}, payload)
    entries = {"ours": ("calfree.json", "parameters.pt"), "foreign": ("data", "policy.pth")}
    if form == "bare":
        saved.write_bytes(pickle.dumps(Bomb(crater)))
    else:
        agent.save(saved)
        with zipfile.ZipFile(saved) as archive:
            header = archive.read("calfree.json")
        with zipfile.ZipFile(saved, "w") as archive:
            archive.writestr(entries[form][0], header)
            archive.writestr(entries[form][1], payload.getvalue())
    message = "damaged or no saved learner" if form == "bare" else r"load\(path, trusted=True\)"
    with pytest.raises(ValueError, match=message):
        agent.load(saved)
    assert not crater.exists()
    if form != "bare":
        with pytest.raises(ValueError, match=r"damaged|do not fit"):
            agent.load(saved, trusted=True)
        assert crater.exists()


def test_a_file_of_stable_baselines3_itself_loads_without_its_pickles(tmp_path):
    """Its `data` holds pickled objects among the JSON; a broken one there harms nothing."""
    saved = tmp_path / "foreign.zip"
    env = gym.make("CalFree/ReachDense-v0", dynamics="kinematic", world="nominal")
    foreign = stable_baselines3.SAC(
        "MultiInputPolicy", DummyVecEnv([lambda: env]), policy_kwargs={"net_arch": [16]}, learning_starts=5
    )
    foreign.set_logger(stable_baselines3.common.logger.Logger(None, []))
    foreign.learn(20).save(saved)
    agent = make(distance_scales=[], word_limit=1.0).load(saved)
    assert agent.num_timesteps == 20
    observation, _ = env.reset(seed=1)
    words = foreign.predict(observation, deterministic=True)[0]
    np.testing.assert_allclose(agent.predict(observation)[0], words, atol=1e-6)
    with pytest.raises(ValueError, match=r"do not fit this learner.*stable_baselines3.SAC"):
        make().load(saved)
    with pytest.raises(ValueError, match=r"do not fit this learner.*stable_baselines3.TD3"):
        make("td3", distance_scales=[]).load(saved)


def altered(path, header=None, parameters=None, variables=None):
    """Rewrites a saved learner with parts of its header or tensors replaced; bytes stand for the header."""
    with zipfile.ZipFile(path) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    if not isinstance(header, bytes):
        header = json.dumps(json.loads(entries["calfree.json"]) | (header or {})).encode()
    tensors = torch.load(io.BytesIO(entries["parameters.pt"]), weights_only=True)
    tensors["parameters"] = (tensors["parameters"] | parameters) if parameters else tensors["parameters"]
    tensors["variables"] = (tensors["variables"] | variables) if variables else tensors["variables"]
    content = io.BytesIO()
    torch.save(tensors, content)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("calfree.json", header)
        archive.writestr("parameters.pt", content.getvalue())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"header": b"[" * 200_000}, "damaged: RecursionError"),
        ({"header": b"[1]"}, "damaged"),
        ({"header": {"motions": -5}}, "damaged: motions is -5; it must be a whole number, 0 or more"),
        ({"header": {"motions": True}}, "damaged: motions is True"),
        ({"header": {"updates": "x"}}, "damaged: updates is 'x'"),
        ({"header": {"about": [1]}}, r"damaged: .*about is \[1\]; it must be a mapping"),
        ({"header": {"about": None}}, "damaged: .*about is None"),
        ({"parameters": {3: {}}}, "damaged: parameters are .*mapping of names"),
        ({"parameters": {"policy": {"x": torch.zeros(1)}}}, "do not fit this learner"),
        ({"variables": {"log_ent_coef": torch.zeros(7)}}, "log_ent_coef is tensor.*it must be finite"),
        ({"variables": {"log_ent_coef": torch.full((1,), torch.nan)}}, "log_ent_coef is tensor"),
        ({"variables": {"log_ent_coef": 3}}, "log_ent_coef is 3"),
    ],
    ids=lambda value: str(value)[:60],
)
def test_an_altered_file_is_told_and_changes_nothing(tmp_path, change, message):
    other, agent, path = make(seed=1), make(), tmp_path / "sac.zip"
    with torch.no_grad():
        other._model.log_ent_coef += 1
    other.save(path)
    altered(path, **change)
    before, coefficient = weights(agent), agent._model.log_ent_coef.clone()
    with pytest.raises(ValueError, match=rf"sac.zip.*{message}"):
        agent.load(path)
    assert torch.equal(before, weights(agent))
    assert torch.equal(coefficient, agent._model.log_ent_coef)
    assert agent.num_timesteps == 0


def test_a_refused_file_changes_nothing(tmp_path):
    make("td3", distance_scales=[]).save(tmp_path / "td3.zip")
    agent = make(distance_scales=[])
    before = [parameter.clone() for parameter in agent._model.policy.parameters()]
    with zipfile.ZipFile(tmp_path / "td3.zip") as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    header = entries["calfree.json"].replace(b"stable_baselines3.TD3", b"stable_baselines3.SAC")
    with zipfile.ZipFile(tmp_path / "liar.zip", "w") as archive:
        archive.writestr("calfree.json", header)
        archive.writestr("parameters.pt", entries["parameters.pt"])
    with pytest.raises(ValueError, match=r"this one has|do not fit"):
        agent.load(tmp_path / "liar.zip")
    for old, new in zip(before, agent._model.policy.parameters(), strict=True):
        assert torch.equal(old, new)
