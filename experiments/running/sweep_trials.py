"""One agent at every value of a sweep: without learning, one trial in each of the paired worlds."""

from pathlib import Path
from typing import Any

import gymnasium

import agents
from experiments.config.requirements import requirements
from experiments.evaluation import evaluate
from experiments.running.cpu_time import CpuTimes, TimedPredictor
from experiments.running.run import SweepRun
from experiments.running.trial_log import TrialLog


def run_sweep(run: SweepRun, folder: Path, times: CpuTimes) -> dict[str, Any]:
    """Makes the trials of a sweep, and logs each into `folder`.

    At every value the agent is made afresh, and learns nothing. A trial is in view where its first
    observation shows all points to both cameras, whatever the agent then does.

    Args:
        run: The sweep.
        folder: Of the run.
        times: Counts CPU seconds.

    Returns:
        What the run says about itself: the agent's privileged observations, and what it is built on.
    """
    config = run.sweep
    privileged, settings, _, known = requirements(run.agent, config.env)
    trials, of = run.work
    with TrialLog(folder) as log:
        for i, value in enumerate(config.over, start=1):
            env = config.env.make(config.perturbations(value), privileged)
            agent = agents.make(run.agent.name, env, seed=run.agent_seed, **settings)
            reached = 0
            for world, seed in enumerate(run.world_seeds):
                in_view = _in_view(env, seed)
                (record,) = evaluate(TimedPredictor(agent, times), env, trials=1, seed=seed)
                log.write("sweep", 0, 0, record, world=world, value=float(value), in_view=in_view)
                reached += record.rendezvous
            env.close()
            made = i * len(run.world_seeds)
            print(f"{of} {made}/{trials}: {reached} reached at {config.vary} {value:g}", flush=True)
    return {"privileged": list(privileged), "prior_knowledge": list(known)}


def _in_view(env: gymnasium.Env[Any, Any], seed: int) -> bool:
    env.reset(seed=seed)
    unwrapped: Any = env.unwrapped
    return bool(unwrapped.arms.delivered[1].all())
