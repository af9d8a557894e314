"""Neural learners. All but those that teach themselves load torch, and only when they are made."""

from functools import partial

from ..base.registration import agent, tuned_settings

agent(
    "recurrent_servo",
    "A recurrent network, trained in thousands of other worlds; learns nothing here.",
    extra="agents",
    arms="any of its network's motors",
)("neural.recurrent_servo.recurrent_servo.RecurrentServo")
agent(
    "in_context",
    "The same with a memory that outlasts trials; learns without changing a weight.",
    extra="agents",
    arms="any of its network's motors",
)("neural.recurrent_servo.in_context.InContext")

TUNED = {
    "sac": "Soft actor-critic.",
    "sac_her": "Soft actor-critic with hindsight; cameras on the stand only.",
    "td3": "Twin-delayed deep deterministic policy gradient.",
    "tqc": "Truncated quantile critics.",
    "crossq": "CrossQ.",
    "ppo": "Proximal policy optimisation, from 64 arms in one world.",
    "recurrent_ppo": "The same with a long short-term memory.",
}
"""Learners of stable-baselines3 and sb3_contrib; each is its file in configs/agents."""
sb3 = partial(agent, tasks=("reach", "grasp", "dock"), extra="agents", batched=True)
sb3("sb3", "Any algorithm of stable-baselines3 or sb3_contrib (`algorithm=`).")(
    "neural.sb3.sb3_agent.Sb3Agent"
)
for name, does in TUNED.items():
    sb3(name, does, defaults=partial(tuned_settings, name))("neural.sb3.sb3_agent.Sb3Agent")
