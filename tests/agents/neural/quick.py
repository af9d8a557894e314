"""Settings with which each learner of stable-baselines3 learns a little within a second."""

from agents.neural import TUNED

_OFF_POLICY = {
    "net_arch": [16],
    "learning_starts": 20,
    "buffer_size": 500,
    "batch_size": 32,
    "train_freq": 1,
    "gradient_steps": 1,
}
_ON_POLICY = {"target_kl": None, "net_arch": [16], "rows": 1, "n_steps": 20, "batch_size": 10, "n_epochs": 2}
QUICK = {
    "sb3": _OFF_POLICY,
    **dict.fromkeys(TUNED, _OFF_POLICY),
    "sac_her": _OFF_POLICY | {"learning_starts": 70},  # a whole trial at least
    "ppo": _ON_POLICY,
    "recurrent_ppo": _ON_POLICY | {"policy_kwargs": {"lstm_hidden_size": 8}},
}
