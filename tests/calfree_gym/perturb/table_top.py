"""A small environment of somebody else's: a hand that is pushed about over a table, and two cameras."""

import gymnasium as gym
import mujoco
import numpy as np

STEP = 0.02
"""How far an action of 1 moves the hand (m)."""
XML = """
<mujoco>
  <worldbody>
    <camera name="top" pos="0 0 1" xyaxes="1 0 0 0 1 0" fovy="60"/>
    <camera name="front" pos="0 -1 0.2" xyaxes="1 0 0 0 0 1" fovy="50"/>
    <light name="lamp" pos="0 0 2"/>
    <geom type="plane" size="1 1 0.1"/>
    <body name="hand" mocap="true" pos="0 0 0.2"><geom size="0.02"/><site name="tip"/></body>
    <body name="thing" mocap="true"><geom size="0.02"/><site name="thing"/></body>
  </worldbody>
</mujoco>
"""


class TableTop(gym.Env):
    """Observed is where the hand and the thing are (6,); the task is to bring them together, to 2 cm."""

    def __init__(self, steps=60):
        self.model = mujoco.MjModel.from_xml_string(XML)
        self.data = mujoco.MjData(self.model)
        self.action_space = gym.spaces.Box(-1, 1, (3,), np.float32)
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (6,), np.float64)
        self.limit, self.seeds = steps, []

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.seeds.append(seed)
        mujoco.mj_resetData(self.model, self.data)
        self.data.mocap_pos[1] = self.np_random.uniform([-0.2, -0.2, 0.1], [0.2, 0.2, 0.3])
        self.count = 0
        return self._observed(), {}

    def step(self, action):
        self.data.mocap_pos[0] += STEP * np.clip(action, -1, 1)
        self.count += 1
        observed = self._observed()
        reached = bool(np.linalg.norm(observed[:3] - observed[3:]) < 0.02)
        return observed, float(reached), False, self.count >= self.limit, {"is_success": reached}

    def _observed(self):
        mujoco.mj_forward(self.model, self.data)
        return self.data.mocap_pos.ravel().copy()
