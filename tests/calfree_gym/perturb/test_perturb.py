"""Perturb in somebody else's environment: what acts, where and how long, and what it refuses."""

import pickle
from functools import partial

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from calfree_gym import Perturb
from calfree_gym.perturb.scope import ALLOWED
from calfree_gym.perturbations import TYPES
from tests.calfree_gym.environments import assert_same, begun, kinematic
from tests.calfree_gym.perturb.table_top import TableTop
from tests.calfree_gym.perturb.workbench import CAMERAS, HOME, Workbench, arrays, steps

KNOCK, BACK = 3, 6
"""Steps before which something is knocked, and undone."""
SETTINGS = {
    "camera_aim": {"degrees": 10},
    "camera_roll": {"degrees": 20},
    "camera_shift": {"metres": 0.1},
    "camera_zoom": {"factor": 1.3},
    "exposure": {"factor": 0.7},
    "blur": {"px": 8},
    "image_noise": {"levels": 10},
    "lens": {"k1": -0.2},
    "dead_zone": {"words": 0.9},
    "point_dropout": {"share": 1.0},
}


POINTS = dict.fromkeys(CAMERAS)
"""Images that somebody else makes."""


def knock(kind, **settings):
    do = {"type": kind, **SETTINGS.get(kind, {}), **settings}
    return [{"at": {"step": KNOCK}, "do": do}, {"at": {"step": BACK}, "undo": 0}]


@pytest.fixture(scope="module")
def bare():
    return steps(Workbench(CAMERAS))


@pytest.mark.parametrize(
    ("kind", "camera"),
    [(kind, camera) for kind in list(SETTINGS)[:4] for camera in CAMERAS]
    + [(kind, "front") for kind in list(SETTINGS)[4:8]]
    + [("light", None)],
)
def test_images_differ_exactly_while_the_knock_lasts_and_nothing_else_does(bare, kind, camera):
    seen = camera or "front", "front" if camera == "wrist" else "wrist"
    env = Perturb(Workbench(seen), knock(kind, **({"camera": camera} if camera else {})), seed=0)
    before = arrays(env.unwrapped.model)
    found = steps(env)
    for name in seen:
        both = zip(bare, found, strict=True)
        differ = [(one["pixels"][name] != other["pixels"][name]).any() for one, other in both]
        touched = camera in (None, name)
        assert differ == [touched and KNOCK < i <= BACK for i in range(len(found))], name
    assert_same([each["state"] for each in found], [each["state"] for each in bare])
    assert_same(arrays(env.unwrapped.model), before)


def test_a_camera_that_looks_at_a_body_may_be_turned_before_the_first_reset():
    do = {"type": "camera_roll", "camera": "looker", "degrees": 20}
    env = begun(Perturb(Workbench(), [{"at": {"episode": 0}, "do": do}], seed=0, images=POINTS), None)
    bare = begun(Workbench(), None)
    rolled, axes = (each.unwrapped.data.camera("looker").xmat.reshape(3, 3) for each in (env, bare))
    np.testing.assert_allclose(rolled[:, 2], axes[:, 2], atol=0.5)
    assert np.degrees(np.arccos((axes.T @ rolled)[1, 1])) == pytest.approx(20, abs=5)


@pytest.mark.parametrize("camera", CAMERAS)
def test_cameras_are_turned_and_moved_as_far_as_is_said(camera):
    def pose(schedule):
        env = Perturb(Workbench(), schedule, seed=0, images=POINTS)
        steps(env, KNOCK + 1)
        there = env.unwrapped.data.camera(camera)
        return there.xpos.copy(), there.xmat.reshape(3, 3).copy()

    position, axes = pose([])
    after, turned = pose(knock("camera_aim", camera=camera, direction=0.0))
    np.testing.assert_allclose(after, position, atol=1e-12)
    turn, apart = axes.T @ turned, 0.03 if camera == "looker" else 1e-9  # it followed the arm until then
    right = [np.sin(np.radians(10)), 0, -np.cos(np.radians(10))]
    np.testing.assert_allclose(-turn[:, 2], right, atol=apart)
    np.testing.assert_allclose(turn[:, 1], [0, 1, 0], atol=apart)
    _, rolled = pose(knock("camera_roll", camera=camera))
    np.testing.assert_allclose(rolled[:, 2], axes[:, 2], atol=apart)
    moved, kept = pose(knock("camera_shift", camera=camera, azimuth=90.0, elevation=0.0))
    assert np.linalg.norm(moved - position) == pytest.approx(0.1)
    np.testing.assert_allclose(kept, axes, atol=apart)
    if camera != "wrist":
        np.testing.assert_allclose(moved - position, [0, 0.1, 0], atol=1e-9)


def test_a_zoom_is_of_the_focal_length():
    env = Perturb(Workbench(), knock("camera_zoom", camera="front"), seed=0, images=POINTS)
    steps(env, KNOCK + 1)
    half = np.tan(np.radians(env.unwrapped.model.camera("front").fovy[0]) / 2)
    assert np.tan(np.radians(25)) / half == pytest.approx(1.3)


@pytest.mark.parametrize(
    ("joint", "degrees", "shift"), [("shoulder", 10, np.radians(10)), ("reach", 5, 0.05)]
)
def test_a_joint_zero_moves_the_arm_and_not_what_its_encoder_tells(joint, degrees, shift):
    schedule = [{"at": {"episode": 0}, "do": {"type": "joint_zero", "joint": joint, "degrees": degrees}}]
    env, other = Perturb(Workbench(), schedule, seed=0), Workbench()
    observation, _ = env.reset()
    np.testing.assert_array_equal(observation["state"], HOME)
    other.reset()
    other.data.joint(joint).qpos += shift
    mujoco.mj_kinematics(other.model, other.data)
    there = env.unwrapped.data.site("tip").xpos
    np.testing.assert_allclose(there, other.data.site("tip").xpos, atol=1e-12)


def sent(schedule, actions, **arguments):
    env = Workbench()
    perturbed = begun(Perturb(env, schedule, seed=0, **arguments), None)
    found = []
    for action in actions:
        perturbed.step(np.asarray(action, np.float32))
        found.append(env.data.ctrl.copy())
    return np.array(found)


def test_motors_are_at_fault_about_where_the_arm_rests():
    at_rest = HOME.astype(np.float32)
    out = [0.6, 0.02]
    for kind, settings, there in (
        ("motor_sign", {}, 0.2),
        ("motor_gain", {"factor": 1.5}, 0.7),
        ("shortfall", {"share": 0.5}, 0.5),
        ("longest_motion", {"words": 0.1}, 0.4 + 0.13),
        ("dead_zone", {"words": 0.5}, 0.4),
    ):
        motor = {} if kind in ("shortfall", "longest_motion") else {"motor": "shoulder"}
        schedule = [{"at": {"step": 1}, "do": {"type": kind, **settings, **motor}}]
        found = sent([*schedule, {"at": {"step": 3}, "undo": 0}], [out, out, at_rest, out])
        np.testing.assert_allclose(found[:, 0], [0.6, there, 0.4, 0.6], atol=1e-6, err_msg=kind)
        if motor:
            np.testing.assert_array_equal(found[:, 1], np.float32([0.02, 0.02, 0.05, 0.02]))


@pytest.mark.parametrize("fault", [{"type": "motor_sign"}, {"type": "dead_zone", "words": 0.2}])
def test_rescaled_actions_are_at_fault_about_the_same_place(fault):
    faults = [{"at": {"step": 0}, "do": {**fault, "motor": "shoulder"}}]
    scaled = gym.wrappers.TimeLimit(gym.wrappers.RescaleAction(Workbench(), -1, 2), 9)
    plain = Workbench()
    outside = gym.wrappers.RescaleAction(scaled, plain.action_space.low, plain.action_space.high)
    envs = [begun(Perturb(each, faults, seed=0), None) for each in (plain, scaled, outside)]
    for position in ([0.4, 0.05], [0.6, 0.02], [0.1, 0.0]):
        low, high = plain.model.actuator_ctrlrange.T
        word = -1 + 3 * (np.array(position) - low) / (high - low)
        for env, action in zip(envs, (position, word, position), strict=True):
            env.step(np.float32(action))
            np.testing.assert_allclose(env.unwrapped.data.ctrl, plain.data.ctrl, atol=1e-6)


@pytest.mark.parametrize(
    ("box", "action", "there"),
    [
        (gym.spaces.Box(-10, 10, (3,), np.int64), np.array([1, 4, -10]), [1, 3, -7]),
        (gym.spaces.Box(-10.0, 10.0, (3,), np.float32), [1, 4, -10], [0.7, 2.8, -7]),
        (gym.spaces.Box(np.float32([-10, 2, -10]), np.float32([10, 2, 10])), [1.0, 2.0, -10.0], [0.7, 2, -7]),
    ],
    ids=["whole numbers", "whole numbers of others", "no range"],
)
def test_actions_of_any_kind_of_numbers_are_executed_as_such(box, action, there):
    gains = [each for motor in range(3) for each in do("motor_gain", motor=f"action{motor}", factor=0.7)]
    env = begun(Perturb(Canvas(box), gains, seed=0), None)
    for _ in range(2):
        env.step(action)
    assert env.unwrapped.got.dtype == box.dtype or isinstance(action[0], float)
    np.testing.assert_allclose(env.unwrapped.got, there, atol=1e-6)


def test_an_action_of_another_length_is_told_while_a_motor_is_at_fault():
    env = begun(Perturb(Workbench(), do("motor_gain"), seed=0), None)
    env.step(HOME)
    with pytest.raises(ValueError, match=r"the action has shape \(3,\); it must have \(2,\)"):
        env.step(np.zeros(3))


def test_what_the_environment_perturbs_itself_is_counted_too():
    own = [
        {"at": {"motion": 0}, "do": {"type": "camera_roll"}},
        {"at": {"motion": 1}, "do": {"type": "blur"}},
    ]
    env = Perturb(kinematic(perturbations=own), do("latency"), seed=0)
    infos = [env.reset(seed=0)[1]] + [env.step(np.zeros(3))[-1] for _ in range(3)]
    assert [info["perturbed"] for info in infos] == [0, 1, 2, 0]
    assert all(isinstance(info["perturbed"], np.int64) for info in infos)


def test_repeatability_is_in_hundredths_of_the_range():
    do = {"type": "repeatability", "motor": "reach", "degrees": 2}
    found = sent([{"at": {"step": 0}, "do": do}], [[0.0, 0.0]] * 400)
    assert found[:, 1].std() == pytest.approx(0.02 * 0.2, rel=0.1)
    assert (found[:, 0] == 0).all()


def test_observations_come_late_or_not_at_all():
    plain = steps(Workbench(["front"]), 6)
    schedule = [{"at": {"step": 2}, "do": {"type": "latency", "motions": 2}}]
    late = steps(Perturb(Workbench(["front"]), schedule, seed=0), 6)
    assert_same(late, [plain[i] for i in (0, 1, 2, 1, 2, 3, 4)])
    schedule = [{"at": {"episode": 0}, "do": {"type": "point_dropout", "share": 1.0}}]
    lost = steps(Perturb(Workbench(["front"]), schedule, seed=0, late=["pixels"]), 6)
    assert_same(lost, [each | {"pixels": plain[0]["pixels"]} for each in plain])


@pytest.mark.parametrize("kind", sorted(TYPES))
def test_every_kind_acts_or_is_refused_before_the_first_step(bare, kind):
    if kind not in ALLOWED:
        message = f"schedule.0: {kind} needs a robot of calfree's own; .*camera_aim"
        with pytest.raises(ValueError, match=message):
            Perturb(Workbench(), knock(kind))
        return
    found = steps(Perturb(Workbench(["front"]), knock(kind), seed=3))
    without = [{"pixels": {"front": each["pixels"]["front"]}, "state": each["state"]} for each in bare]
    assert_same(found[: KNOCK + 1], without[: KNOCK + 1])
    assert pickle.dumps(found) != pickle.dumps(without)


def log(env, episodes=4, seeds=None):
    found = []
    for episode in range(episodes):
        looks = [env.reset(seed=seeds[episode] if seeds else None)]
        for step in range(4):
            looks.append(looks[0] if step == 0 else env.step(HOME.astype(np.float32)))
            found.append([each.to_dict() for each in env.applied])
            assert looks[-1][-1]["perturbed"] == len(env.applied)
    return found


LIFE = [
    {"every": {"step": 4}, "do": {"type": "camera_aim"}},
    {"at": {"episode": 1}, "do": {"type": "motor_gain"}},
    {"drift": {"per": "step"}, "do": {"type": "light"}},
]


def test_the_same_seed_draws_the_same_and_a_seed_of_a_reset_begins_nothing_anew():
    first = log(Perturb(Workbench(), LIFE, seed=5, images=POINTS))
    assert [len(each) for each in first] == [0, 0, 1, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0]
    assert log(Perturb(Workbench(), LIFE, seed=5, images=POINTS), seeds=[7, 7, 7, 7]) == first
    assert log(Perturb(Workbench(), LIFE, images=POINTS), seeds=[5, 9, None, 9]) == first
    assert log(Perturb(Workbench(), LIFE, seed=6, images=POINTS)) != first


def test_a_schedule_of_each_episode_begins_anew_with_other_draws():
    env = Perturb(Workbench(), knock("camera_aim", degrees=None), seed=5, per="episode", images=POINTS)
    drawn = []
    for _ in range(2):
        env.reset()
        assert env.world == env._built
        for step in range(BACK + 1):
            env.step(HOME)
            assert (env.world == env._built) == (step not in range(KNOCK, BACK))
            drawn += env.applied
    assert [each.type for each in drawn] == ["camera_aim", "undo"] * 2
    assert drawn[0] != drawn[2]
    with pytest.raises(ValueError, match=r"schedule\.1 counts episodes"):
        Perturb(Workbench(), LIFE, per="episode", images=POINTS)


@pytest.mark.parametrize("seed", [None, 5])
def test_a_reset_with_a_seed_repeats_the_draws_of_its_episode_and_of_those_after_it(seed):
    schedule = [{"at": {"step": 1}, "do": {"type": kind}} for kind in ("camera_aim", "image_noise")]

    def episodes(env, seeds):
        drawn = []
        for each in seeds:
            env.reset(seed=each)
            seen = [env.step(HOME.astype(np.float32))[0]["pixels"]["front"] for _ in range(3)]
            drawn.append((env.world, np.array(seen).tobytes()))
        return drawn

    env = Perturb(Workbench(["front"]), schedule, seed=seed, per="episode")
    once, next_one, other = episodes(env, [7, None, 8])
    assert episodes(env, [7, None]) == [once, next_one]
    assert episodes(Perturb(Workbench(["front"]), schedule, seed=seed, per="episode"), [7]) == [once]
    assert len({seen for _, seen in (once, next_one, other)}) == 3


def test_unperturbed_is_as_built_to_the_bit_and_no_undo_comes_back():
    more = [{"at": {"step": 1}, "do": {"type": kind}} for kind in ("camera_shift", "joint_zero")]
    env = Perturb(Workbench(), [*LIFE, *more], images=POINTS)
    before = arrays(env.unwrapped.model)
    log(env)
    assert any((array != before[name]).any() for name, array in arrays(env.unwrapped.model).items())
    env.unperturbed()
    assert_same(arrays(env.unwrapped.model), before)
    env = Perturb(Workbench(), knock("camera_roll"), seed=0, images=POINTS)
    steps(env, KNOCK + 1)
    env.unperturbed()
    for _ in range(4):
        env.step(HOME)
    assert env.world == env._built


def test_a_closed_one_leaves_the_model_as_built():
    env = Perturb(Workbench(), [*knock("camera_roll"), *do("light"), *do("joint_zero")], images=POINTS)
    before = arrays(env.unwrapped.model)
    steps(env, KNOCK + 1)
    env.close()
    assert_same(arrays(env.unwrapped.model), before)
    Perturb(Workbench()).close()


def test_a_model_that_is_built_anew_is_found_again():
    schedule = [{"at": {"episode": 0}, "do": {"type": "camera_aim", "camera": "front", "degrees": 10}}]
    plain, other = (Perturb(Workbench(["front"], rebuilds), schedule, seed=0) for rebuilds in (False, True))
    for _ in range(2):
        one, two = ([each["pixels"] for each in steps(env, 3)[1:]] for env in (plain, other))
        assert_same(one, two)
    other.unperturbed()
    np.testing.assert_array_equal(other.unwrapped.model.cam_quat, Workbench().model.cam_quat)


def test_it_goes_on_after_a_pickle_and_as_a_copy_in_mid_episode():
    env = Perturb(Workbench(), knock("camera_aim", camera="looker"), seed=0, images=POINTS)
    steps(env, KNOCK + 1)
    again = pickle.loads(pickle.dumps(env))
    for _ in range(BACK):
        assert_same(*(each.step(HOME.astype(np.float32)) for each in (env, again)))
        assert_same(again.unwrapped.model.cam_quat, env.unwrapped.model.cam_quat)
    assert (again.unwrapped.model.cam_mode == Workbench().model.cam_mode).all()


class Canvas(gym.Env):
    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(self, action_space=None, image=None):
        self.render_mode = "rgb_array"
        self.action_space = action_space or gym.spaces.Box(0.0, 512.0, (2,), np.float32)
        self.observation_space = image or gym.spaces.Box(0, 255, (24, 32, 3), np.uint8)

    def render(self):
        return np.full((24, 32, 3), 100, np.uint8)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.full(self.observation_space.shape, 100, self.observation_space.dtype), {}

    def step(self, action):
        self.got = action
        return self.reset()[0], 0.0, False, False, {}


def do(kind, **settings):
    return [{"at": {"step": 1}, "do": {"type": kind, **settings}}]


FRONT = r"names the camera 'frnt' \(did you mean front\?\), which there is not; .*: front, looker, wrist"
COLOURS = r"acts on images \(h, w, 3\) or \(3, h, w\) of uint8"
AIM, BLURRED = do("camera_aim"), do("blur")


@pytest.mark.parametrize(
    ("schedule", "arguments", "message"),
    [
        (do("camera_aim", camera="frnt"), {}, FRONT),
        (do("camera_aim", camera="wrist"), {}, r"no image .* 'wrist'; give images=.'wrist': KEYS.*adapter="),
        (do("camera_aim", camera="render"), {"images": {"render": ()}}, "'render' is the viewer's .*front"),
        (AIM, {"images": {}}, "no image shows a camera; give images="),
        (BLURRED, {"images": {"wrist": None}}, "acts on images as they are delivered, and none of 'wrist'"),
        (BLURRED, {"images": {"wrist": "state"}}, COLOURS),
        (BLURRED, {"images": {"wrst": "state"}}, r"images names .* 'wrst' \(did you mean wrist\?\)"),
        (BLURRED, {"images": {"wrist": ("pixels", "top")}}, "'pixels/top', but observations have: pixels/fr"),
        (do("latency"), {"late": ["stat"]}, "late names 'stat', but observations have: pixels/front, state"),
        (
            do("latency"),
            {"late": "state"},
            r"late is 'state'; it must be a list of parts, such as \['state'\]",
        ),
        (do("latency"), {"late": [("pixels", 0)]}, "late names 'pixels/0', but observations have: pixels/fr"),
        (do("latency"), {"late": [3]}, "late is 3; allowed: the key of a part"),
        (do("latency"), {"late": 5}, r"late is 5; it must be a list of parts"),
        (BLURRED, {"images": ["wrist"]}, r"images is \['wrist'\]; it must be keys by camera"),
        (BLURRED, {"images": {"wrist": 3}}, r"images\.wrist is 3; allowed: the key of a part"),
        (do("motor_sign", motor="elbow"), {}, r"schedule\.0: motor_sign.motor is 'elbow'; allowed: s"),
        (do("joint_zero", joint="elbow"), {}, r"schedule\.0: joint_zero.joint is 'elbow'; allowed: s"),
        (do("link_length"), {}, r"schedule\.0: link_length needs a robot of calfree's own"),
        (do("camera_am"), {}, r"schedule\.0\.do\.type is 'camera_am' \(did you mean camera_aim"),
        ([], {"per": "live"}, r"per is 'live' \(did you mean life\?\)"),
        ([], {"seed": -1}, "seed is -1; it must be a whole number from 0"),
    ],
)
def test_what_cannot_be_is_refused(schedule, arguments, message):
    env = Workbench(["front"])
    before = arrays(env.model)
    with pytest.raises(ValueError, match=message):
        Perturb(env, schedule, **arguments)
    assert_same(arrays(env.model), before)


def test_parts_of_a_tuple_cannot_be_named():
    both = gym.spaces.Dict(views=gym.spaces.Tuple([BOX(0, 255, (24, 32, 3), np.uint8)]))
    for name, given in (("images", {"render": ("views", 0)}), ("late", [("views", 0)])):
        with pytest.raises(
            ValueError, match=rf"{name} names 'views/0', .*: views; what is in a Tuple cannot"
        ):
            Perturb(Canvas(image=both), do("latency"), **{name: given})


@pytest.mark.parametrize(("mode", "more"), [(None, ""), ("rgb_array", ", exposure, blur, image_noise, lens")])
def test_a_model_without_a_camera_is_told_with_what_is_possible(mode, more):
    env = gym.make("Reacher-v5", render_mode=mode)
    with pytest.raises(
        ValueError, match="camera_roll: the model has no camera; possible here: light"
    ) as caught:
        Perturb(env, do("camera_roll", camera="side"))
    assert str(caught.value).endswith("dead_zone" + more)
    for kind in str(caught.value).partition("here: ")[2].split(", "):
        Perturb(env, do(kind))


def test_one_in_the_other_is_refused():
    with pytest.raises(ValueError, match="in a Perturb already: give that one the whole schedule"):
        Perturb(gym.wrappers.TimeLimit(Perturb(Workbench()), 5))


@pytest.mark.parametrize("kind", ["camera_aim", "light", "joint_zero"])
def test_where_no_model_is_found_it_says_how_to_tell(kind):
    with pytest.raises(ValueError, match="no MuJoCo model is found behind Canvas") as caught:
        Perturb(Canvas(), do(kind))
    advice = str(caught.value)
    code = advice[advice.index("    from ") : advice.index("    Perturb(env")]
    names = {}
    exec("\n".join(line[4:] for line in code.splitlines()), names)
    env = Workbench(["front"])
    env.sim = env
    perturbed = Perturb(env, do("camera_aim", camera="front"), adapter=names["Mine"]())
    assert perturbed.parts.cameras == ("front",)


def test_without_mujoco_images_actions_and_observations_are_perturbed():
    schedule = [*do("exposure", factor=0.5), *do("motor_sign", motor="action1"), *do("latency", motions=1)]
    env = begun(Perturb(Canvas(), schedule, seed=0, images={"render": ()}), None)
    for there in (100, 100, 50):
        observation, *_ = env.step(np.float32([56, 56]))
        assert (observation == there).all()
    assert env.unwrapped.got.tolist() == [56, 512 - 56]
    assert (env.render() == 50).all()


class Depths(gym.ObservationWrapper):
    """Adds images to those of a workbench: one that is cropped, and what each pixel shows."""

    def __init__(self, env):
        super().__init__(env)
        crop, kinds = gym.spaces.Box(0, 255, (8, 8, 3), np.uint8), gym.spaces.Box(0, 9, (8, 8, 1), np.int32)
        more = {"wide": gym.spaces.Dict(front=crop), "seg": gym.spaces.Dict(front=kinds)}
        self.observation_space = gym.spaces.Dict({**env.observation_space.spaces, **more})

    def observation(self, observation):
        crop = observation["pixels"]["front"][-8:, -8:]
        return {**observation, "wide": {"front": crop}, "seg": {"front": crop[..., :1].astype(np.int32)}}


def test_all_colour_images_of_one_camera_are_at_fault():
    schedule = [{"at": {"step": 1}, "do": {"type": "exposure", "camera": "front", "factor": 0.5}}]
    env, bare = Perturb(Depths(Workbench(["front"])), schedule, seed=0), Depths(Workbench(["front"]))
    for step, (found, plain) in enumerate(zip(steps(env, 2), steps(bare, 2), strict=True)):
        assert_same(found["seg"], plain["seg"])
        for images in ("pixels", "wide"):
            dark = plain[images]["front"] * (0.5 if step == 2 else 1)
            np.testing.assert_allclose(found[images]["front"], dark, atol=1, err_msg=f"{images} {step}")
            assert found[images]["front"].any()


BOX = gym.spaces.Box
OF_ACTIONS = r"motor_gain acts on actions that are numbers \(m,\), each in a range"


@pytest.mark.parametrize(
    ("kind", "arguments", "message"),
    [
        ("motor_gain", {"action_space": gym.spaces.Discrete(3)}, OF_ACTIONS),
        ("motor_gain", {"action_space": BOX(-np.inf, np.inf, (2,))}, OF_ACTIONS),
        ("exposure", {"image": BOX(0, 1, (24, 32, 3), np.float32)}, COLOURS),
        ("exposure", {"image": BOX(0, 255, (4, 24, 32, 3), np.uint8)}, COLOURS),
        ("exposure", {"image": BOX(0, 255, (24, 32, 1), np.uint8)}, COLOURS),
    ],
)
def test_actions_without_a_range_and_images_of_other_kinds_are_refused(kind, arguments, message):
    with pytest.raises(ValueError, match=message):
        Perturb(Canvas(**arguments), do(kind), images={"render": ()})


class Randomised(TableTop):
    """Its cameras and its lamp are others in every episode."""

    def reset(self, *, seed=None, options=None):
        found = super().reset(seed=seed)
        self.model.cam_pos[0] = np.add([0, 0, 1], self.np_random.uniform(-0.1, 0.1, 3))
        self.model.cam_fovy[:] = self.np_random.uniform(40, 60, 2)
        self.model.light_diffuse[0] = self.np_random.uniform(0.4, 1)
        return found


def test_what_the_environment_itself_changes_at_a_reset_is_what_knocks_begin_from():
    knocks = {
        "camera_aim": {"degrees": 10.0, "direction": 0.0, "camera": "top"},
        "camera_zoom": {"factor": 1.25, "camera": "top"},
        "camera_shift": {"camera": "front"},
    }
    schedule = [{"at": {"episode": 0}, "do": {"type": kind, **do}} for kind, do in knocks.items()]
    undone = [{"at": {"episode": 2}, "undo": place} for place in range(3)]
    bare, knocked = (
        Randomised(),
        Perturb(Randomised(), schedule + undone, seed=1, images={"top": None, "front": None}),
    )
    model, built, shifts = knocked.unwrapped.model, TableTop().model, []
    for seed in (3, 4, 5):
        bare.reset(seed=seed)
        knocked.reset(seed=seed)
        np.testing.assert_array_equal(model.light_diffuse, bare.model.light_diffuse)
        np.testing.assert_array_equal(model.cam_pos[0], bare.model.cam_pos[0])
        if seed < 5:
            half = np.tan(np.radians(bare.model.cam_fovy[0]) / 2) / 1.25
            assert model.cam_fovy[0] == pytest.approx(np.degrees(2 * np.arctan(half)))
            assert 2 * np.arccos(abs(model.cam_quat[0] @ built.cam_quat[0])) == pytest.approx(np.radians(10))
            shifts.append(model.cam_pos[1] - built.cam_pos[1])
            np.testing.assert_allclose(shifts[-1], shifts[0])
            assert shifts[-1].any()
    for name in ("cam_pos", "cam_quat", "cam_fovy"):
        np.testing.assert_array_equal(getattr(model, name), getattr(bare.model, name))


class MovedBench(Workbench):
    """Its first camera and its lamp are others in every episode."""

    def reset(self, *, seed=None, options=None):
        rng = np.random.default_rng(seed)
        self.model.cam_pos[0] = np.add([0, -1.2, 0.6], rng.uniform(-0.1, 0.1, 3))
        self.model.cam_fovy[0] = rng.uniform(45, 55)
        self.model.light_diffuse[0] = rng.uniform(0.3, 0.6)
        return super().reset(seed=seed)


@pytest.mark.parametrize("kind", ["camera_roll", "light"])
def test_images_of_an_environment_that_changes_its_model_are_knocked_at_once_and_come_back(kind):
    def images(env):
        episodes = [steps(env, 3, seed) for seed in (3, 4)]
        return [each["pixels"]["front"].astype(int) for episode in episodes for each in episode[1:]]

    given = {"degrees": 180.0, "camera": "front"} if kind == "camera_roll" else {}
    schedule = [{"at": {"step": 0}, "do": {"type": kind, **given}}, {"at": {"step": 5}, "undo": 0}]
    bare = images(MovedBench(["front"]))
    knocked = images(Perturb(MovedBench(["front"]), schedule, seed=0))
    for there, now in zip(bare[:5], knocked, strict=False):
        assert np.abs(there - now).mean() > 3
        if kind == "camera_roll":
            assert np.abs(there[::-1, ::-1] - now).mean() < 0.3
    np.testing.assert_array_equal(knocked[5], bare[5])


def test_a_call_that_the_environment_refuses_and_that_comes_again_is_knocked_once():
    class Refusing(TableTop):
        refuses = False

        def reset(self, *, seed=None, options=None):
            if self.refuses:
                raise RuntimeError("stuck")
            return super().reset(seed=seed)

        def step(self, action):
            if self.refuses:
                raise RuntimeError("stuck")
            return super().step(action)

    do = {"type": "motor_gain", "factor": 0.5, "motor": "action0"}
    env = Perturb(Refusing(), [{"at": {"step": 2}, "do": do}, {"at": {"episode": 1}, "do": do}], seed=0)
    env.reset(seed=0)
    for _ in range(2):
        env.step(np.zeros(3))
    for call, gain in ((partial(env.step, np.zeros(3)), 0.5), (env.reset, 0.25)):
        env.unwrapped.refuses = True
        for _ in range(2):
            with pytest.raises(RuntimeError, match="stuck"):
                call()
        env.unwrapped.refuses = False
        assert call()[-1]["perturbed"] == 1
        assert env.world.motor_gain.tolist() == [gain, 1, 1]
