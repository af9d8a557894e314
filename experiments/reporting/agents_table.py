"""The table of all agents in docs/agents.md: what each does, and what it must know."""

from functools import cache

import pandas as pd

import agents
from experiments.config.environment import EnvironmentConfig
from experiments.config.requirements import requirements
from experiments.config.suite import AgentConfig
from experiments.reporting.tables import Table, must_know

IDEAS = {
    "random": "Moves at random: the floor of every comparison.",
    "oracle": "Is told where to go: the ceiling.",
    "paper_servo": "The paper's servo: tests each motor, solves for the step, executes it, and forgets.",
    "jacobian_servo": "Tests each motor once, then corrects its Jacobian by every motion.",
    "unified_servo": "Makes no test motions: learns a smooth model of the images as it goes.",
    "work_plane_servo": "The paper's first servo: turns the waist, then moves in the work plane.",
    "learning_servo": "Any knowledge base over any servo (`knowledge=`, `servo=`).",
    "safe_start": "[Begins with tiny motions](safe-reach.md), then lets a servo go on.",
    "grid_table": "The paper's table: words that succeeded, interpolated over image points.",
    "factored_table": "The paper's first alternative: several small tables, added up.",
    "support_points": "The paper's second alternative: points stored where they are needed.",
    "memory": "[Remembers looks of all trials](experience.md), and notices when the world changes.",
    "body_schema": "[Learns the arm as a chain of joints](experience.md#body_schema), and what has changed.",
    "joint_space_servo": "A servo that sees the joint angles (Conkie, Chongstitvatana 1990).",
    "affine_stereo": "Calibrates itself at four known positions (Hollinghurst, Cipolla 1994).",
    "model_based": "The calibrated robot that the paper argues against: triangulates, solves, moves.",
    "self_calibrating": "A calibrated robot that identifies its own model as it moves.",
    "recurrent_servo": "A recurrent network, trained in thousands of other worlds; learns nothing here.",
    "sb3": "Any algorithm of stable-baselines3 or sb3_contrib (`algorithm=`).",
    "sac": "Soft actor-critic.",
    "sac_her": "Soft actor-critic with hindsight; cameras on the stand only.",
    "td3": "Twin-delayed deep deterministic policy gradient.",
    "tqc": "Truncated quantile critics.",
    "crossq": "CrossQ.",
    "ppo": "Proximal policy optimisation, from 64 arms in one world.",
    "recurrent_ppo": "The same with a long short-term memory.",
    "self_supervised": "A small network that learns from its own motions alone, without a reward.",
    "cooperstock_milios": "Its plain form: one network, no reaction to changes (Cooperstock, Milios 1993).",
}
"""What each agent does, in one line of a page of docs/."""


@cache
def agents_table() -> Table:
    """One row an agent, from the code alone."""
    nominal = {"id": "CalFree/Reach-v0", "world": "nominal", "camera_mount": "stand"}
    env = EnvironmentConfig.model_validate(nominal)
    rows = []
    for name in agents.names():
        required = requirements(AgentConfig(name=name, label=name), env)
        known = must_know(required.privileged, required.prior_knowledge)
        rows.append((f"[`{name}`](agent-settings.md#{name})", IDEAS[name], known))
    columns = ["agent", "what it does", "what it must know"]
    return Table("agents", "Agents", pd.DataFrame(rows, columns=columns))
