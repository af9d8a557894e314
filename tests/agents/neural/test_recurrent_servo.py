"""recurrent_servo: its agent, the file of its weights, and its training."""

import json

import gymnasium as gym
import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

import agents
from agents.neural.recurrent_servo import train
from agents.neural.recurrent_servo.network import KEPT as KEPT_BY_AGENT
from agents.neural.recurrent_servo.network import RecurrentServoNetwork, load_network
from agents.neural.recurrent_servo.robots import FAR, SHAPES, TrainingRobots, Worlds, draw_worlds, worlds_on
from calfree_gym.geometry import quaternion_of
from calfree_gym.image import PIXELS_PER_UNIT
from tests.agents.neural.self_supervised.conftest import LinearWorld

KEPT = KEPT_BY_AGENT["recurrent_servo"]
UNSEEN = 1000  # seed of the first test world; those of training are 100,000 and more


@pytest.fixture
def servo(make_env):
    return agents.make("recurrent_servo", make_env())


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


def test_foreign_states_and_formats(servo, make_env):
    observation, _ = make_env().reset(seed=UNSEEN)
    _, state = servo.predict(observation)
    pair = {key: np.stack([value, value]) for key, value in observation.items()}
    with pytest.raises(ValueError, match="state is of 1 environments, the observation of 2"):
        servo.predict(pair, state)
    with pytest.raises(ValueError, match="the state is of another network; pass the state back"):
        servo.predict(observation, type(state)(*(each[..., :1] for each in state)))
    with pytest.raises(ValueError, match=r"'words': \[3\].*here it is .*'words': \[4\].*as many motors"):
        agents.make("recurrent_servo", LinearWorld(motors=4))


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
        *((part, "damaged or no safetensors") for part in (slice(-40), slice(500), slice(0), slice(9, 99))),
        (None, "holds no known agent; this agent is recurrent_servo"),
    ],
    ids=str,
)
def test_a_file_that_is_damaged_or_wrong_is_told_and_changes_nothing(servo, tmp_path, change, message):
    path, before = tmp_path / "weights.safetensors", servo._network
    with safe_open(KEPT, "pt") as file:
        header = json.loads(file.metadata()["calfree"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    if isinstance(change, dict):
        change = {name: value for name, value in (header | change).items() if value is not None}
    if isinstance(change, slice):
        path.write_bytes(KEPT.read_bytes()[change])
    else:
        save_file(tensors, path, change and {"calfree": json.dumps(change)})
    with pytest.raises(ValueError, match=rf"weights.safetensors.*{message}"):
        servo.load(path)
    assert servo._network is before


@pytest.fixture
def double():
    """Numbers of double precision: differences of losses are then exact enough."""
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


def test_training_robots_move_and_see_as_the_environment(mount):
    seeds = range(300_000, 300_004)
    env = gym.make_vec(
        "CalFree/Reach-v0", num_envs=4, dynamics="kinematic", camera_mount=mount, terminate_on_success=False
    )
    env.reset(seed=list(seeds))
    robots = TrainingRobots(worlds(mount), 4)
    robots._world = worlds(mount)
    robots._life = robots._life._replace(order=torch.arange(3).repeat(4, 1), sign=torch.ones(4, 3))
    _, info = env.reset(options={"object": robots._object.numpy()})
    rng = np.random.default_rng(0)
    for _ in range(6):
        words = rng.uniform(-0.8, 0.8, (4, 3)).astype(np.float32)
        observation, *_, info = env.step(words)
        robots.move(torch.tensor(words), torch.ones(4, dtype=torch.bool))
        look = robots.look()
        np.testing.assert_allclose(look.registers, observation["observation"][:, 4:], atol=1e-6)
        true = info["truth"]["points"].reshape(4, 4, 2)
        visible = observation["observation"][:, :4] > 0.5
        assert (np.abs(true).max(2) <= 1)[visible].all()
        np.testing.assert_allclose(look.true_points.numpy()[visible], true[visible], atol=1e-4)
        seen_here = look.visible.numpy() | (robots._life.dropout > 0).numpy()[:, None]
        np.testing.assert_array_equal(seen_here & visible, visible)
        assert not (look.visible.numpy() & ~visible).any()


def worlds(mount="waist", count=4, first_seed=300_000):
    return worlds_on(torch.device("cpu"), draw_worlds(count, mount, first_seed))


def test_a_changed_camera_sees_what_one_of_the_environment_sees_there(mount, make_env):
    robots = TrainingRobots(worlds(mount, 1), 60)
    before = robots._world
    robots.change_cameras(torch.ones(60, dtype=torch.bool))
    after, look = robots._world, robots.look()
    changed = (before.axes != after.axes).flatten(2).any(2)
    assert changed.any()
    assert (changed.sum(1) <= 1).all()
    assert look.visible.float().mean() > 0.9
    env = make_env(mount, keep_in_view=False).unwrapped
    for row in range(6):
        env.reset(seed=300_000)
        there = env.world.replace(
            camera_orientation=[quaternion_of(axes.double().numpy()) for axes in after.axes[row]],
            camera_position=after.position[row].numpy(),
            focal_length=after.focal[row].numpy() * PIXELS_PER_UNIT,
        )
        env.set_world(there)
        *_, info = env.reset(options={"object": robots._object[row].numpy()})
        np.testing.assert_allclose(
            look.true_points[row].flatten(), info["truth"]["points"].clip(-FAR, FAR), atol=1e-4
        )


class LinearServo(RecurrentServoNetwork):
    """Test words and a linear feedback: simple enough for differences of the loss to be exact."""

    def __init__(self):
        super().__init__(hidden=4)
        self.gain = torch.nn.Parameter(0.05 * torch.tensor([[1.0, -1.0, 1.0, 1.0]]).repeat(3, 1))

    def forward(self, points, visible, registers, memory):
        distance = (points[:, :2] - points[:, 2:]).flatten(1)
        return self._tests(memory.looks) + distance @ self.gain.T, memory._replace(looks=memory.looks + 1)


@pytest.mark.parametrize("finishing", [0.0, 1.0])
def test_the_gradient_through_the_robots_is_that_of_the_loss(finishing, double, monkeypatch):
    monkeypatch.setattr(train, "GRADIENT_BOUND", np.inf)
    network, there = LinearServo(), Worlds(*(part.double() for part in worlds()))

    def loss():
        torch.manual_seed(0)
        robots, memory = TrainingRobots(there, 8), network.begin(8)
        return train.make_window(network, robots, memory, 3, torch.tensor(finishing), train.go_on)[0].loss

    loss().backward()
    weights = (network.gain, network.test_words)
    square = sum(each.grad.square().sum().item() for each in weights)
    ends = []
    for way in (1e-5, -2e-5):
        with torch.no_grad():
            for each in weights:
                each.add_(way / square**0.5 * each.grad)
            ends.append(loss().item())
    assert (ends[0] - ends[1]) / 2e-5 == pytest.approx(square**0.5, rel=1e-3)


@pytest.mark.slow
def test_training_lowers_the_loss(monkeypatch):
    """Below that of the same robots whose network does not learn: it falls within each life anyway."""
    monkeypatch.setattr(train, "FINISHING", (1.0, 2.0))  # the same loss all the time
    late = []
    for rate in (0.0, 0.005):
        torch.manual_seed(0)
        network, robots = RecurrentServoNetwork(hidden=8, features=4), TrainingRobots(worlds(), 64)
        late.append(
            np.mean([window.loss.item() for window in train.train(network, robots, 6, rate, 60)][30:])
        )
    assert late[1] < 0.95 * late[0]


@pytest.mark.parametrize(("name", "options"), [("recurrent_servo", []), ("in_context", ["--features", "4"])])
def test_the_command_writes_a_file_that_the_agent_reads(name, options, make_env, tmp_path, capsys):
    out, drawn = tmp_path / "tiny.safetensors", tmp_path / "worlds.npz"
    tiny = ["--worlds-file", str(drawn), "--worlds-a-mount", "2", "--robots", "2", "--updates", "2"]
    for _ in range(2):  # with worlds that are drawn, and with these again
        train.main(["--out", str(out), *tiny, "--hidden", "8", "--motions", "3", "--device", "cpu", *options])
    assert capsys.readouterr().out.count("4 worlds") == 2
    servo = agents.make(name, make_env(), weights=str(out))
    assert servo.training["worlds"].startswith("wild, kinematic, seeds 100000 to 100003")
    network, _, motions, _ = load_network(out, servo._shapes, name)
    assert (network.hidden, motions) == (8, 0)
    assert servo._shapes == SHAPES
