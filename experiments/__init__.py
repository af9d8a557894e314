"""The comparison: agents side by side, under identical worlds and identical perturbations."""

from experiments.evaluation import TrialRecord, evaluate

__all__ = ["TrialRecord", "evaluate"]
