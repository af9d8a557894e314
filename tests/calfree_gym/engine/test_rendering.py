"""Geometry against pixels; drawing of models of any size, in any thread, and not in a copied process."""

import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from threading import Thread

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import calfree_gym
from calfree_gym import nominal
from calfree_gym.image import IMAGE_SIZE, PIXELS_PER_UNIT
from calfree_gym.rendering.renderer import Renderer, View
from calfree_gym.rendering.stereo_images import LensMap, StereoImages
from calfree_gym.robot.arms.scene import RADIUS
from calfree_gym.robot.objects import LinesOfSight
from calfree_gym.robot.rays import MARKS_GROUP, SEEN
from calfree_gym.vision.cameras import image_points
from tests.arms.every import arm_named
from tests.arms.own import MODELS
from tests.calfree_gym.environments import assert_same, begun, kinematic, make


@pytest.fixture
def images_of(opengl):
    made = []

    def make(env, size=IMAGE_SIZE, **arguments):
        arms = env.unwrapped.arms
        made.append(StereoImages(arms.simulation, arms.robot.rig, size, **arguments))
        return made[-1]

    yield make
    for each in made:
        each.close()


def green_centre(image):
    """Centre (2,) of what is rather green, in image units."""
    red, green, blue = np.moveaxis(image.astype(float), -1, 0)
    weight = np.clip(green - np.maximum(red, blue) - 10, 0, 60)
    ys, xs = np.indices(weight.shape)
    centre = np.array([(weight * xs).sum(), (weight * ys).sum()]) / weight.sum()
    return (centre + 0.5) * 2 / len(image) - 1


@pytest.mark.parametrize(("kind", "most"), [("wild", 0.5), ("wilder", 2)])
@pytest.mark.parametrize("dynamics", ["physics", "kinematic"])
@pytest.mark.parametrize("mount", calfree_gym.MOUNTS)
def test_rendered_marks_are_where_the_cameras_formulas_put_them(images_of, mount, dynamics, kind, most):
    env = make(camera_mount=mount, world=kind, dynamics=dynamics, occlusion=kind == "wild").unwrapped
    errors, images = [], images_of(env)
    for seed in range(25 if kind == "wild" else 6):
        env.reset(seed=seed)
        world, simulation = env.world.replace(texture=0.0), env.arms.simulation
        if kind == "wild":
            off_centre = np.random.default_rng(seed).uniform(-10, 10, (2, 2))
            world = world.replace(principal_point=off_centre)
            env.set_world(world)
            env.reset()
        _, data = simulation.show(0, simulation.picture())
        point = data.body("object").xpos
        seen = env.arms.true_points[0, 2:]
        for camera, image in enumerate(images.colours(0, world, [MARKS_GROUP])):
            there = data.camera(("left", "right")[camera])
            x, y, z = there.xmat.reshape(3, 3).T @ (point - there.xpos)
            flat = np.array([x, -y]) / -z
            square = flat @ flat
            bent = flat * (1 + world.lens_k1[camera] * square + world.lens_k2[camera] * square**2)
            focal = world.focal_length[camera] * np.array([1, world.pixel_aspect[camera]])
            expected = (bent * focal + world.principal_point[camera]) / (IMAGE_SIZE / 2)
            np.testing.assert_allclose(seen[camera], expected, atol=1e-5)
            errors.append(np.linalg.norm(green_centre(image) - expected) * IMAGE_SIZE / 2)
    assert np.median(errors) < 0.5
    assert max(errors) < most


def _greens(image):
    red, green, blue = np.moveaxis(image.astype(int), -1, 0)
    return np.count_nonzero(green > 1.5 * np.maximum(red, blue))


def test_a_model_s_own_sites_hide_nothing():
    text = (MODELS / "hobby.xml").read_text()
    looks = []
    for size in (0.001, 0.1):
        sites = text.replace("<site ", f'<site size="{size}" rgba="1 1 1 1" ')
        assert sites != text
        env = kinematic(
            arm=calfree_gym.Arm(sites, "tip"), camera_mount="stand", observation="pixels", world="nominal"
        )
        looks.append(env.reset(seed=0)[0])
    np.testing.assert_array_equal(*(look["pixels"] for look in looks))


@pytest.mark.parametrize("arm", ["movemaster", pytest.param("torque", marks=pytest.mark.slow)])
def test_rays_hide_what_pixels_hide(images_of, arm):
    chosen = arm if arm == "movemaster" else arm_named(arm)
    env = kinematic(arm=chosen, camera_mount="stand").unwrapped
    images, rng, compared = images_of(env), np.random.default_rng(0), []
    for seed in range(8):
        env.reset(seed=seed)
        env.set_world(replace(env.world, light_strength=0.0, light_ambient=1.0))
        lines = LinesOfSight(env.arms.simulation, RADIUS * env.arms.robot.rig.scale)
        for _ in range(6):
            env.step(rng.uniform(-0.5, 0.5, env.action_space.shape))
            free = [_greens(image) for image in images.colours(0, env.world, [MARKS_GROUP])]
            seen = [_greens(image) for image in images.colours(0, env.world)]
            shares = lines.shares(0)[2:]
            compared += [(s / f, share) for s, f, share in zip(seen, free, shares, strict=True) if f > 60]
    of_pixels, of_rays = np.array(compared).T
    assert len(compared) > 50
    assert np.mean(of_rays == 1) < 0.98, "something hides it at times"
    assert np.mean(np.abs(of_pixels - of_rays) < 0.25) > 0.9


def camera(focal, offset, k1=0.0, k2=0.0, aspect=1.0):
    lens = {"lens_k1": [k1, k1], "lens_k2": k2, "pixel_aspect": aspect}
    return replace(nominal(), focal_length=[focal] * 2, principal_point=[[offset, -offset]] * 2, **lens)


@pytest.mark.parametrize(
    ("k1", "k2", "aspect", "offset"),
    [
        *((0.0, 0.0, 1.0, 0.0), (0.08, 0.0, 1.0, 12.0), (-0.08, 0.0, 1.0, -7.0)),
        *((-0.1, 0.05, 0.8, 50.0), (0.1, -0.03, 1.25, -30.0)),
    ],
)
def test_a_lens_map_is_the_lens(k1, k2, aspect, offset):
    focal, size = 300.0, 128
    lens = LensMap.of(camera(focal, offset, k1, k2, aspect), 0, size)
    columns, rows = np.meshgrid(*[np.arange(lens.source, dtype=np.float32)] * 2)
    from_column, from_row = map(lens.depths, (columns, rows))  # of the nearest pixel: whence each comes
    flat = np.stack([from_column, lens.source - 1 - from_row], -1) + 0.5
    flat = (flat * 2 / lens.source - 1) * lens.half
    unit = 2 / IMAGE_SIZE
    both = focal * unit * np.array([1, aspect])
    points, _ = image_points(flat, both, np.array([offset, -offset]) * unit, k1, k2, np.inf)
    pixels = (np.arange(size) + 0.5) * 2 / size - 1
    shown = (from_column > 0) & (from_row > 0)
    assert shown.mean() > 0.95
    nearest = 1.3 * max(1, aspect) * focal / IMAGE_SIZE * 2 * lens.half / lens.source * 2
    for axis, way in ((0, pixels), (1, pixels[:, None])):
        assert np.abs(points[..., axis] - way)[shown].max() < nearest
        assert abs(np.mean((points[..., axis] - way)[shown])) < 0.05 * 2 / size, "shifted by part of a pixel"


@pytest.mark.parametrize("size", [8, 16, 33, 64, 84, 96, 127, 256])
@pytest.mark.parametrize("offset", [0.0, 9.0])
def test_a_lens_that_shows_all_has_no_black_border(size, offset):
    lens = LensMap.of(camera(420.0, offset), 0, size)
    assert lens.depths(np.ones((lens.source, lens.source), np.float32)).all()
    white = np.full((lens.source, lens.source, 3), 255, np.uint8)
    assert (lens.colours(white) == 255).all()


def test_depths_are_those_of_the_points(images_of):
    env = kinematic(camera_mount="stand", occlusion=True).unwrapped
    images = images_of(env)
    for seed in range(8):
        env.reset(seed=seed)
        _, depth = env.arms.simulation.pinhole_pixels()
        for camera, rendered in enumerate(images.depths(0, env.world)):
            column, row = ((env.arms.true_points[0, 2 + camera] + 1) * IMAGE_SIZE / 2).astype(int)
            assert rendered[row, column] == pytest.approx(depth[0, 2 + camera] - RADIUS, abs=0.003)


def test_worlds_in_turns_look_as_each_alone_and_covers_are_uploaded_once(images_of, monkeypatch):
    env, uploaded = make(rows=3).unwrapped, []
    env.reset(seed=0)
    worlds = [replace(nominal(), texture=np.array(number)) for number in (0.0, 7.0, 0.0, 9.0, 11.0, 13.0)]
    alone = [images_of(env, 64).colours(0, world) for world in worlds]
    assert len({image[0].mean() for image in alone}) == 5
    together, upload = images_of(env, 64), mujoco.mjr_uploadTexture
    monkeypatch.setattr("mujoco.mjr_uploadTexture", lambda *which: uploaded.append(upload(*which)))
    for turn in [worlds[:4]] * 2 + [worlds] * 2:  # the last are more than are kept
        for world, image in zip(turn, alone, strict=False):
            np.testing.assert_array_equal(together.colours(0, world), image)
        if turn is not worlds:
            assert len(uploaded) == 3 * len(env.arms.simulation.covers)


def test_cameras_that_share_a_shadow_map_see_the_shadows_that_each_sees_alone(images_of):
    env, views = make().unwrapped, []
    env.reset(seed=0)
    images = images_of(env)
    images.prepare(0, env.world)
    draw = images.renderer.draw
    for place in range(2):
        camera = mujoco.MjvCamera()
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, place
        views.append(View(camera, 300, 300))
    for view, (shared, _) in zip(views, draw(views, SEEN), strict=True):
        np.testing.assert_array_equal(shared, draw([view], SEEN)[0][0])
        assert (shared != draw([view], SEEN, shadows=False)[0][0]).mean() > 0.01


SHOWN = (
    "import gymnasium as gym, calfree_gym; e = gym.make('CalFree/Reach-v0', render_mode='rgb_array');"
    "e.reset(seed=0)\ntry: e.render()\nexcept gym.error.DependencyNotInstalled as error: print(error)"
)


@pytest.mark.parametrize(
    ("code", "variables", "said"),
    [
        (SHOWN, {"MUJOCO_GL": "glfw"}, r"needs a screen.*set MUJOCO_GL"),
        (SHOWN, {"MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": "97"}, r"egl.*set MUJOCO_GL"),
        (
            "import calfree_gym",
            {"MUJOCO_GL": "wayland"},
            r"\ngymnasium.error.DependencyNotInstalled: MuJoCo cannot load the renderer of MUJOCO_GL"
            r"[^\n]*egl \(Debian: libegl1[^\n]*\n$",
        ),
    ],
)
def test_a_missing_renderer_is_told_when_an_image_or_mujoco_is_asked_for(code, variables, said):
    inherited = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=inherited | variables, capture_output=True, text=True, check=False)
    assert re.search(said, done.stdout or done.stderr, re.DOTALL)


def test_an_image_without_gl_says_what_to_install_and_without_a_render_mode_there_is_none(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "none-of-these")
    env = begun(make(world="nominal", render_mode="rgb_array").unwrapped)
    with pytest.raises(gym.error.DependencyNotInstalled, match=r"libegl1.*MUJOCO_GL=egl"):
        env.render()
    env = begun(make(world="nominal").unwrapped)
    with pytest.warns(UserWarning, match="give one to gym.make: rgb_array, human"):
        assert env.render() is None


def test_the_viewer_shows_where_the_arm_is_and_without_a_screen_is_an_error(monkeypatch):
    shown = []

    class Window(nullcontext):
        def __init__(self, model, data, **_):
            super().__init__()
            self.data = data

        def lock(self):
            return self

        def sync(self):
            shown.append(self.data.qpos.copy())

        def close(self):
            shown.append("closed")

    viewer = pytest.importorskip("mujoco.viewer")
    monkeypatch.setattr(viewer, "launch_passive", Window)
    monkeypatch.setattr("glfw.init", lambda: True)
    env = begun(kinematic(render_mode="human"))
    env.step(np.array([0.2, 0.0, 0.0]))
    env.render()
    assert len(shown) == 3, "people see what happens without render()"
    np.testing.assert_array_equal(shown[1], shown[2])
    np.testing.assert_array_equal(shown[1], env.unwrapped.arms.simulation.joints()[0])
    assert (shown[0] != shown[1]).any()
    env.close()
    assert shown[-1] == "closed"
    monkeypatch.setattr("glfw.init", lambda: False)
    monkeypatch.setattr(viewer, "launch_passive", lambda *_, **__: sys.exit(1))  # as MuJoCo's viewer would
    with pytest.raises(gym.error.DependencyNotInstalled, match="needs a screen"):
        kinematic(render_mode="human").reset(seed=0)


DRAWS = pytest.mark.usefixtures("opengl")
FRAMES = {"render_mode": "rgb_array", "width": 240, "height": 160}
FORKS = pytest.mark.skipif(not hasattr(os, "fork"), reason="there are no copies of processes")
SECONDS = 60
"""Within which a process ends that does not wait for ever."""


def seen_with(grains, observation):
    spec = mujoco.MjSpec.from_file(str(MODELS / "hobby.xml"))
    for place in np.random.default_rng(0).uniform(-1e-3, 1e-3, (grains, 3)) - [0, 0, 0.3]:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[5e-4, 0, 0], pos=place)
    arm = {"arm": calfree_gym.Arm(spec, "tip"), "world": "nominal", "camera_mount": "stand"}
    env = kinematic(observation=observation, **arm, **FRAMES)
    seen = dict(env.reset(seed=0)[0])
    if observation == "vision":
        seen["frame"] = env.render()
    if observation == "depth":
        for name in ("left_depth", "right_depth"):
            seen[name] = np.minimum(seen[name], 1)  # the background is as far as the model is large
    env.close()
    return seen


@DRAWS
@pytest.mark.parametrize(
    ("observation", "grains"),
    [
        pytest.param("vision", 1_100, marks=pytest.mark.slow),
        *(("vision", 3_000), ("rgb", 3_000), ("pixels", 1_100), ("depth", 3_000)),
    ],
)
def test_a_model_of_many_geoms_is_drawn_whole(observation, grains):
    seen, alone = seen_with(grains, observation), seen_with(0, observation)
    if observation == "vision":
        np.testing.assert_array_equal(seen["observation"][:4], 1)
    for name, without in alone.items():
        if without.ndim > 1:
            far = np.abs(seen[name].astype(float) - without)
            assert far.mean() < 0.002 * np.ptp(without), "arm, marks and object cover more than that"
        else:
            np.testing.assert_allclose(seen[name], without, atol=0.1 / PIXELS_PER_UNIT)


def drawn_by(run):
    envs = [make(observation="rgb", image_size=64, **FRAMES) for _ in range(2)]
    looks = [env.reset(seed=seed)[0] for seed, env in enumerate(envs)]
    words = np.array([0.2, -0.1, 0.1], np.float32)
    for _ in range(2):
        looks += run(lambda env: env.step(words)[0], envs)
    looks += [{"frame": frame} for frame in run(lambda env: env.render(), envs)]
    run(lambda env: env.close(), envs)
    return looks


def here(task, envs):
    return [task(env) for env in envs]


def by_a_thread_each(task, envs):
    done = []
    for env in envs:
        thread = Thread(target=lambda env=env: done.append(task(env)))
        thread.start()
        thread.join()
    return done


def by_a_pool(task, envs):
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(task, envs))


@DRAWS
@pytest.mark.parametrize("run", [by_a_thread_each, by_a_pool])
def test_any_thread_draws_the_same(run):
    assert_same(drawn_by(run), drawn_by(here))


def ended(code, *arguments):
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=True).stdout


ASYNC = """
import sys
from functools import partial
import gymnasium as gym
import calfree_gym

made = partial(gym.make, "calfree_gym:CalFree/Reach-v0", observation="rgb", image_size=64)
env = made()
if sys.argv[2] == "drew":
    env.reset(seed=0)
    env.close()
envs = gym.vector.AsyncVectorEnv([made, made], context=sys.argv[1])
try:
    print(envs.reset(seed=0)[0]["left_image"].std() > 10)
except RuntimeError as error:
    print(error)
"""


@DRAWS
@FORKS
@pytest.mark.parametrize(
    ("context", "before", "said"),
    [("fork", "drew", 'context="spawn"'), ("fork", "drew not", "True"), ("spawn", "drew", "True")],
)
def test_copies_of_a_process_that_drew_say_so_and_do_not_wait_for_ever(context, before, said):
    assert said in ended(ASYNC, context, before)


SITES = {"a": "-.2 .1 0", "b": ".2 .1 0", "c": "-.2 -.1 0", "d": ".2 -.1 0"}


@DRAWS
def test_a_scene_grows_for_whatever_there_is_to_draw(tmp_path, monkeypatch):
    """Here for a rope of 1,500 pieces, behind which a red one would be left out."""
    monkeypatch.chdir(tmp_path)  # where MuJoCo tells that a scene is full
    sites = "".join(f'<site name="{name}" pos="{place}"/>' for name, place in SITES.items())
    rope = '<site site="a"/><site site="b"/>' * 750
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><camera name="eye" pos="0 0 1"/>{sites}</worldbody><tendon>'
        f'<spatial width=".02">{rope}</spatial>'
        '<spatial width=".02" rgba="1 0 0 1"><site site="c"/><site site="d"/></spatial></tendon></mujoco>'
    )
    data, eye = mujoco.MjData(model), mujoco.MjvCamera()
    mujoco.mj_forward(model, data)
    eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
    renderer = Renderer(model, data, 64)
    red, green, _ = np.moveaxis(renderer.draw([View(eye, 64, 64)], ())[0][0].astype(int), -1, 0)
    renderer.close()
    assert np.count_nonzero(red > green + 50) > 20
