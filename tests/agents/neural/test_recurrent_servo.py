"""recurrent_servo: its agent, the file of its weights, and its training."""

import json

import gymnasium as gym
import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

import agents
from agents.base.prior_knowledge import PriorKnowledge
from agents.neural.recurrent_servo import train
from agents.neural.recurrent_servo.network import KEPT, RecurrentServoNetwork, load_network
from agents.neural.recurrent_servo.robots import Disturbances, TrainingRobots
from tests.agents.neural.self_supervised.conftest import LinearWorld

UNSEEN = 1000
"""Seed of the first test world; those of training are 100,000 and more."""


@pytest.fixture
def servo(make_env):
    return agents.make("recurrent_servo", make_env())


def test_it_reaches_the_object_in_worlds_that_it_never_saw(reach, mount):
    share, motions, _ = reach("recurrent_servo", range(UNSEEN, UNSEEN + 8), mount)
    assert share == 1
    assert motions <= 8


def test_it_and_its_kept_file_say_what_it_is_built_on(servo):
    assert {PriorKnowledge.TRAINING_WORLDS, PriorKnowledge.IMAGE_SCALE} <= servo.prior_knowledge
    assert PriorKnowledge.MOTOR_ORDER not in servo.prior_knowledge
    assert servo.privileged == ()
    assert KEPT.stat().st_size < 1_000_000
    training = servo.training
    assert training["worlds_from"] >= 50_000
    assert training["updates_made"] == training["updates"]
    assert training["cpu_minutes"] > 0
    assert f"--seed {training['seed']} " in training["command"]
    assert {"python", "torch", "numpy", "mujoco", "gymnasium"} <= training["versions"].keys()


def test_learning_changes_nothing_but_the_count_of_motions(servo, tmp_path):
    before = {name: tensor.clone() for name, tensor in servo._network.state_dict().items()}
    servo.learn(70)
    assert servo.num_timesteps == 70
    for name, tensor in servo._network.state_dict().items():
        assert torch.equal(tensor, before[name])


def test_a_row_that_begins_a_trial_forgets_and_the_others_go_on(servo):
    batch = gym.make_vec("CalFree/Reach-v0", num_envs=2, dynamics="kinematic")
    first, _ = batch.reset(seed=UNSEEN)
    _, state = servo.predict(first)
    second, *_ = batch.step(np.full((2, 3), 0.1, np.float32))
    onward, _ = servo.predict(second, state)
    mixed, after = servo.predict(second, state, np.array([True, False]))
    fresh, _ = servo.predict(second, None, np.array([True, True]))
    np.testing.assert_array_equal(mixed, [fresh[0], onward[1]])
    assert not np.array_equal(fresh[1], onward[1])
    assert after.looks.tolist() == [1, 2]


def test_foreign_states(servo, make_env):
    observation, _ = make_env().reset(seed=UNSEEN)
    _, state = servo.predict(observation)
    pair = {key: np.stack([value, value]) for key, value in observation.items()}
    with pytest.raises(ValueError, match="state is of 1 environments, the observation of 2"):
        servo.predict(pair, state)
    with pytest.raises(ValueError, match="the state is of another network; pass the state back"):
        servo.predict(observation, type(state)(*(each[..., :1] for each in state)))


def test_another_observation_format_is_refused():
    with pytest.raises(ValueError, match=r"'words': \[3\].*here it is .*'words': \[4\].*as many motors"):
        agents.make("recurrent_servo", LinearWorld(motors=4))


def test_damaged_and_foreign_files(servo, tmp_path):
    whole = KEPT.read_bytes()
    path = tmp_path / "weights.safetensors"
    for damaged in (whole[:-40], whole[:500], b"no tensors", b""):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match="damaged or no safetensors"):
            servo.load(path)
    torch.save({"weights": torch.zeros(3)}, path)
    with pytest.raises(ValueError, match="damaged or no safetensors"):
        servo.load(path)
    save_file({"weights": torch.zeros(3)}, path)
    with pytest.raises(ValueError, match="holds no known agent; this agent is recurrent_servo"):
        servo.load(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ([1], r"damaged: its header is \[1\]; it must be a mapping"),
        ({"hidden": None}, "damaged: its header has no hidden"),
        ({"training": None, "num_timesteps": None}, "no num_timesteps, training"),
        ({"hidden": "x"}, "damaged: hidden is 'x'; it must be a whole number, 1 or more"),
        ({"hidden": 3}, "damaged: hidden is 3, but its unit.weight_hh is"),
        ({"hidden": 10**9}, "damaged: hidden is 1000000000"),
        ({"num_timesteps": -1}, "damaged: num_timesteps is -1"),
        ({"training": "x"}, "damaged: training is 'x'; it must be a mapping"),
        ({"observation_format": 3}, "with the observation format 3; here it is"),
    ],
    ids=str,
)
def test_a_header_that_is_wrong_is_told_and_changes_nothing(servo, tmp_path, change, message):
    with safe_open(KEPT, "pt") as file:
        header = json.loads(file.metadata()["calfree"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    if isinstance(change, dict):
        changed = {name: value for name, value in (header | change).items() if value is not None}
    else:
        changed = change
    path, before = tmp_path / "weights.safetensors", servo._network
    save_file(tensors, path, {"calfree": json.dumps(changed)})
    with pytest.raises(ValueError, match=rf"weights.safetensors.*{message}"):
        servo.load(path)
    assert servo._network is before


def test_derivatives_are_those_of_the_image_points():
    """Against the secant over a hundred times as long a displacement of each register, both ways."""
    near, size = TrainingRobots(2, "waist", 300_000).begin(), 0.02
    for motor in range(3):
        true = []
        for sign in (1, -1):
            words = np.zeros((2, 3), np.float32)
            words[:, motor] = sign * size
            again = TrainingRobots(2, "waist", 300_000)
            again.begin()
            true.append(again.move(words).true_points)
        secant = (true[0] - true[1]) / (2 * size)
        np.testing.assert_allclose(near.derivatives[..., motor], secant, atol=0.03)


def test_a_camera_that_rolls_in_training_rolls_as_in_the_environment(make_env):
    """A roll of the world's camera turns its image points about the centre."""
    roll = [{"at": {"motion": 0}, "do": {"type": "camera_roll", "camera": "left", "degrees": 25}}]
    seen = []
    for perturbations in (None, roll):
        env = make_env(perturbations=perturbations, keep_in_view=False)
        env.reset(seed=UNSEEN)
        *_, info = env.step(np.zeros(3, np.float32))
        seen.append(info["truth"]["points"].reshape(1, 4, 2))
    befall = Disturbances(1, 3, np.random.default_rng(0))
    angle = np.radians(25)
    found = []
    for sign in (1, -1):
        turn = [[np.cos(angle), -sign * np.sin(angle)], [sign * np.sin(angle), np.cos(angle)]]
        befall._map = torch.tensor([[turn, np.eye(2).tolist()]], dtype=torch.float64)
        befall._shift = torch.zeros(1, 2, 2, dtype=torch.float64)
        found.append(np.abs(befall.in_images(torch.tensor(seen[0])).numpy() - seen[1]).max())
    assert min(found) < 1e-6 < max(found)


def test_what_befalls_motors_and_points():
    befall = Disturbances(50, 3, np.random.default_rng(1))
    words = torch.rand(50, 3) - 0.5
    torch.testing.assert_close(befall.to_robot(befall.to_network(words)), words)
    points = torch.full((50, 4, 2), 0.2)
    kept, seen = befall.measured(points, torch.ones(50, 4, dtype=torch.bool))
    assert (kept - points).abs()[seen].max() < 0.1
    lost, unseen = befall.measured(-points, torch.zeros(50, 4, dtype=torch.bool))
    assert not unseen.any()
    torch.testing.assert_close(lost, kept)


class LinearServo(RecurrentServoNetwork):
    """Test words and a linear feedback: simple enough for differences of the loss to be exact."""

    def __init__(self):
        super().__init__(hidden=4)
        self.gain = torch.nn.Parameter(0.05 * torch.tensor([[1.0, -1.0, 1.0, 1.0]]).repeat(3, 1))

    def forward(self, points, visible, registers, memory):
        distance = (points[:, :2] - points[:, 2:]).flatten(1)
        return self._tests(memory.looks) + distance @ self.gain.T, memory._replace(looks=memory.looks + 1)


@pytest.mark.parametrize("finishing", [0, 1])
def test_the_gradient_through_the_black_box_is_that_of_the_loss(finishing, monkeypatch):
    """Against the difference of the losses of the same trial, made again with changed weights."""
    monkeypatch.setattr(train, "GRADIENT_BOUND", np.inf)

    def loss():
        robots = TrainingRobots(4, "waist", 300_000)
        return train.make_episode(network, robots, 3, finishing, np.random.default_rng(0)).loss

    network = LinearServo()
    loss().backward()
    weights = (network.gain, network.test_words)
    square = sum(each.grad.square().sum().item() for each in weights)
    ends = []
    for way in (1e-3, -2e-3):
        with torch.no_grad():
            for each in weights:
                each.add_(way / square**0.5 * each.grad)
            ends.append(loss().item())
    assert (ends[0] - ends[1]) / 2e-3 == pytest.approx(square**0.5, rel=0.05)


def test_training_lowers_the_loss():
    torch.manual_seed(0)
    network, robots = LinearServo(), TrainingRobots(4, "waist", 200_000)
    trials = train.train(network, [robots], 30, 3, 0.5, np.random.default_rng(0))
    losses = [trial.loss.item() for trial in trials]
    assert np.mean(losses[-10:]) < 0.95 * np.mean(losses[:10])


def test_the_command_writes_a_file_that_the_agent_reads(make_env, tmp_path, capsys):
    out = tmp_path / "tiny.safetensors"
    train.main(["--out", str(out), "--groups", "1", "--robots", "2", "--updates", "2", "--hidden", "8"])
    assert "2 worlds" in capsys.readouterr().out
    servo = agents.make("recurrent_servo", make_env(), weights=str(out))
    assert servo.training["worlds"].startswith("wild, kinematic, seeds 100000 to 100001")
    network, _, motions = load_network(out, servo._shapes)
    assert (network.hidden, motions) == (8, 0)
