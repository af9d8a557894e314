"""One agent at every value of a sweep: untaught, one trial in each of the paired worlds."""

from pathlib import Path
from typing import Any

import agents
from agents.base.observation import Observation
from experiments.config.requirements import asked
from experiments.evaluation import evaluate
from experiments.running.plan import SweepRun
from experiments.running.trial_log import TrialLog


def sweep(run: SweepRun, folder: Path) -> dict[str, Any]:
    """Makes the trials of a sweep, and logs each into `folder`.

    At every value the agent is made afresh, and learns nothing. A trial is in view where its first look shows
    gripper and object to both cameras, whatever the agent then does.

    Returns:
        What the run says about itself: what the agent was told.
    """
    config = run.sweep
    tell, settings = asked(run.agent, config.env)
    trials, of = run.work
    with TrialLog(folder) as log:
        for i, value in enumerate(config.over, start=1):
            env = config.env.make(config.perturbations(value), tell)
            agent = agents.make(run.agent.name, env, seed=run.agent_seed, **settings)
            reached = 0
            for world, seed in enumerate(run.world_seeds):
                in_view = bool(Observation.of(env.reset(seed=seed)[0]).visible.all())
                (record,) = evaluate(agent, env, trials=1, seed=seed)
                log.write("sweep", 0, 0, record, world=world, value=float(value), in_view=in_view)
                reached += record.success
            env.close()
            made = i * len(run.world_seeds)
            print(f"{of} {made}/{trials}: {reached} reached at {config.vary} {value:g}", flush=True)
    return {"told": list(tell)}
