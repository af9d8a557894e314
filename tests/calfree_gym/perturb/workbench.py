"""A small environment of somebody else's: an arm of two joints, three cameras, a lamp, images and a state."""

import gymnasium as gym
import mujoco
import numpy as np

XML = """
<mujoco>
  <visual><headlight ambient="0.2 0.2 0.2" diffuse="0.3 0.3 0.3"/></visual>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <camera name="front" pos="0 -1.2 0.6" xyaxes="1 0 0 0 0.5 1" fovy="50"/>
    <camera name="looker" pos="0.8 -0.8 0.8" mode="targetbody" target="forearm"/>
    <light name="lamp" pos="0.3 0.2 2" dir="-0.1 -0.1 -1" castshadow="false" diffuse="0.5 0.4 0.4"/>
    <geom type="plane" size="1 1 0.1" rgba="0.3 0.5 0.3 1"/>
    <geom type="box" size="0.05 0.05 0.05" pos="0.3 0.1 0.05" rgba="0.8 0.2 0.2 1"/>
    <body name="upper" pos="0 0 0.3">
      <joint name="shoulder" axis="0 1 0" damping="2"/>
      <geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0"/>
      <body name="forearm" pos="0.3 0 0">
        <joint name="reach" type="slide" axis="1 0 0" damping="5"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0.2 0 0" rgba="0.2 0.2 0.8 1"/>
        <camera name="wrist" pos="0 0 0.2" xyaxes="0 -1 0 1 0 0.3"/>
        <camera name="follower" pos="0 -0.6 0.2" xyaxes="1 0 0 0 0.3 1" mode="trackcom"/>
        <site name="tip" pos="0.2 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="60" ctrlrange="-1 1.6"/>
    <position name="reach" joint="reach" kp="200" ctrlrange="-0.1 0.1"/>
  </actuator>
</mujoco>
"""
CAMERAS = ("front", "looker", "wrist", "follower")
SIZE = 36, 48
HOME = np.array([0.4, 0.05])


class Workbench(gym.Env):
    """Actions are positions of the joints (2,); observed are images, and positions.

    Args:
        cameras: Those of which images are observed.
        rebuilds: Whether each reset builds the model anew.
        render_mode: None or "rgb_array", of the first camera.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012

    def __init__(self, cameras=(), rebuilds=False, render_mode=None):
        self.cameras, self.rebuilds, self.render_mode = cameras, rebuilds, render_mode
        self._build()
        self.action_space = gym.spaces.Box(*self.model.actuator_ctrlrange.T.astype(np.float32))
        image = gym.spaces.Box(0, 255, (*SIZE, 3), np.uint8)
        self.observation_space = gym.spaces.Dict(
            pixels=gym.spaces.Dict({name: image for name in cameras}),
            state=gym.spaces.Box(-np.inf, np.inf, (2,), np.float64),
        )

    def _build(self):
        self.model = mujoco.MjModel.from_xml_string(XML)
        self.data = mujoco.MjData(self.model)
        self.renderer = None

    def image(self, camera):
        from calfree_gym.rendering.renderer import Renderer, View  # it needs a newer MuJoCo than Perturb

        if self.renderer is None:
            self.renderer = Renderer(self.model, self.data, max(SIZE))
        view = mujoco.MjvCamera()
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, self.model.camera(camera).id
        ((image, _),) = self.renderer.draw([View(view, *SIZE[::-1])], range(6))
        return image[::-1].copy()

    def render(self):
        return self.image("front")

    def _observed(self):
        return {"pixels": {name: self.image(name) for name in self.cameras}, "state": self.data.qpos.copy()}

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        if self.rebuilds:
            self.close()
            self._build()
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self.data.ctrl[:] = HOME
        mujoco.mj_forward(self.model, self.data)
        return self._observed(), {}

    def step(self, action):
        self.data.ctrl[:] = np.clip(action, self.action_space.low, self.action_space.high)
        mujoco.mj_step(self.model, self.data, 10)
        return self._observed(), 0.0, False, False, {}

    def close(self):
        self.renderer = None


def steps(env, count=8, seed=0):
    actions = np.random.default_rng(1).uniform(env.action_space.low, env.action_space.high, (count, 2))
    found = [env.reset(seed=seed)[0]]
    found += [env.step(action.astype(np.float32))[0] for action in actions]
    return found


def arrays(model):
    names = [name for name in dir(model) if isinstance(getattr(model, name), np.ndarray)]
    head = model.vis.headlight
    return {name: getattr(model, name).copy() for name in names} | {
        "ambient": head.ambient.copy(),
        "diffuse": head.diffuse.copy(),
    }
