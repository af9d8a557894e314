"""Files of the adapter of stable-baselines3: none runs anything, and one that is refused changes nothing."""

import io
import json
import pickle
import zipfile
from functools import partial
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import stable_baselines3
import torch
from stable_baselines3.common.vec_env import DummyVecEnv

from calfree_gym import files
from tests.agents.neural.sb3_learners import make, weights


def test_files_of_other_learners_are_refused(tmp_path):
    saved, more = tmp_path / "sac.zip", gym.make("CalFree/ReachDense-v0", tell=("joint_angles",))
    make().save(saved)
    for name, settings, message in (
        ("td3", {}, "algorithm stable_baselines3.SAC; this one has stable_baselines3.TD3"),
        ("sac", {"word_limit": 0.77}, r"'limit': [\d.]+.*this one has .*'limit': 0.77"),
        ("sac", {"net_arch": [17]}, r"'net_arch': \[16\].*this one has .*'net_arch': \[17\]"),
        ("sac", {"distance_scales": []}, "'distance_scales'.*this one has"),
        ("sac", {"env": more}, r"'observation': \[7\].*this one has .*'joint_angles': \[5\]"),
    ):
        with pytest.raises(ValueError, match=message):
            make(name, **settings).load(saved)
    saved.write_bytes(saved.read_bytes()[:200])
    with pytest.raises(ValueError, match="damaged or no saved learner"):
        make().load(saved)
    with zipfile.ZipFile(saved, "w") as archive:
        archive.writestr("readme.txt", "nothing")
    with pytest.raises(ValueError, match=r"holds readme.txt; a saved learner holds calfree.json"):
        make().load(saved)


def test_what_is_not_needed_stays_packed_and_what_is_too_large_is_refused(tmp_path, monkeypatch):
    make().save(tmp_path / "sac.zip")
    with zipfile.ZipFile(tmp_path / "sac.zip", "a") as archive:
        archive.writestr("extra", b"damaged later")
    content = (tmp_path / "sac.zip").read_bytes()
    (tmp_path / "sac.zip").write_bytes(content.replace(b"damaged", b"DAMAGED", 1))
    make().load(tmp_path / "sac.zip")
    monkeypatch.setattr(files, "MOST_BYTES", 1000)
    with pytest.raises(ValueError, match=r"it has \d+ bytes unpacked; allowed: 1000"):
        make().load(tmp_path / "sac.zip")


def test_what_unpacks_too_much_inside_a_zip_is_refused(tmp_path, monkeypatch):
    make().save(tmp_path / "sac.zip")
    with zipfile.ZipFile(tmp_path / "sac.zip") as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    (tensors,) = (name for name, content in entries.items() if zipfile.is_zipfile(io.BytesIO(content)))
    larger = io.BytesIO(entries[tensors])
    with zipfile.ZipFile(larger, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data/more", bytes(10_000_000))
    with zipfile.ZipFile(tmp_path / "sac.zip", "w") as archive:
        for name, content in (entries | {tensors: larger.getvalue()}).items():
            archive.writestr(name, content)
    monkeypatch.setattr(files, "MOST_BYTES", 10_000_000)
    with pytest.raises(ValueError, match=r"is damaged.* bytes unpacked; allowed: 10000000"):
        make().load(tmp_path / "sac.zip")
    monkeypatch.setattr(files, "MOST_BYTES", 15_000_000)
    make().load(tmp_path / "sac.zip")
    with zipfile.ZipFile(tmp_path / "sac.zip", "a") as archive:
        archive.writestr("second.pth", larger.getvalue())
    with pytest.raises(ValueError, match=r"is damaged.* bytes unpacked; allowed: 15000000"):
        make().load(tmp_path / "sac.zip")


class Bomb:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (Path(self.path),)


@pytest.mark.parametrize("form", ["ours", "foreign", "bare"])
def test_a_malicious_file_executes_nothing(form, tmp_path):
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


STATE = {"step": 1, "exp_avg": torch.zeros(16), "exp_avg_sq": torch.zeros(16)}
"""Of an optimizer, for the biases of a layer of 16."""


def states(state, parameter=1):
    return {"parameters": {"actor.optimizer": {"state": {parameter: state}}}}


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
        (states({}), "state of parameter 1 in actor.optimizer has ; it must have step, exp_avg, exp_avg_sq"),
        (states({**STATE, "more": 1}), "has step, exp_avg, exp_avg_sq, more; it must have step, exp_avg"),
        (states(STATE, 99), "parameter 99 in actor.optimizer has step, .*; it must have $"),
        (states({**STATE, "exp_avg": torch.zeros(1)}), r"exp_avg of .* is tensor.* of torch.Size\(\[16"),
        (states({**STATE, "exp_avg": torch.zeros(16, dtype=int)}), "exp_avg of .* must be finite, torch.fl"),
        (states({**STATE, "exp_avg_sq": -torch.ones(16)}), "exp_avg_sq of .* has -1; it must be 0 or more"),
        (states({**STATE, "step": torch.zeros(2)}), r"step of .* it must be finite, .* of torch.Size\(\[\]"),
        (states({**STATE, "step": -1}), "step of .* has -1; it must be 0 or more"),
        (states({**STATE, "step": float("nan")}), "step of .* it must be finite"),
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


def test_weights_that_are_not_finite_are_refused(tmp_path):
    broken, agent = make(), make()
    with torch.no_grad():
        next(broken._model.policy.actor.parameters())[:] = torch.nan
    broken.save(tmp_path / "sac.zip")
    with pytest.raises(ValueError, match=r"weight of policy is tensor.* it must be finite"):
        agent.load(tmp_path / "sac.zip")
    assert torch.isfinite(weights(agent)).all()


@pytest.mark.parametrize("name", ["sac", "ppo", "td3", "crossq", "recurrent_ppo"])
def test_of_an_optimizer_what_it_has_seen_is_loaded_and_settings_stay(name, tmp_path):
    trained, agent, path = make(name).learn(120), make(name), tmp_path / "agent.zip"
    trained.save(path)
    kept = {key: each for key, each in trained._model.get_parameters().items() if "optimizer" in key}
    settings = {key: agent._model.get_parameters()[key]["param_groups"] for key in kept}
    strange = {"lr": float("nan"), "betas": 5, "foreach": "x"}
    altered(path, parameters={key: {**each, "param_groups": [strange]} for key, each in kept.items()})
    agent.load(path)
    for key, each in kept.items():
        found = agent._model.get_parameters()[key]
        assert found["param_groups"] == settings[key]
        assert found["state"].keys() == each["state"].keys()
        for number, state in each["state"].items():
            for what, value in state.items():
                assert torch.equal(torch.as_tensor(found["state"][number][what]), torch.as_tensor(value))
    assert any(each["state"] for each in kept.values())
    assert torch.isfinite(weights(agent.learn(120))).all()


def test_who_loads_forgets_the_motions_of_the_life_before(tmp_path):
    make().save(tmp_path / "new.zip")
    agent = make().learn(60)
    assert agent._model.replay_buffer.pos
    agent.load(tmp_path / "new.zip")
    assert agent._model.replay_buffer.size() == 0


def test_who_loads_learns_from_its_own_trials_alone(tmp_path):
    made = partial(make, "sac_her")
    made().save(tmp_path / "new.zip")
    agent = made().learn(150).load(tmp_path / "new.zip")
    agent.learn(130)
    assert np.count_nonzero(agent._model.replay_buffer.ep_length) <= 130
