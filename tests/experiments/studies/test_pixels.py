"""The benchmark of networks that see pixels: every learner learns from them, and is looked at."""

import pytest

from experiments.studies import pixels


@pytest.mark.slow
def test_every_learner_is_looked_at_as_it_learns(opengl, monkeypatch):
    monkeypatch.setitem(
        pixels.LEARNERS["SAC"].settings, "learning_starts", 8
    )  # it makes an update in this time
    (table,) = pixels.tables(share=0.001, looks=2, trials=1)
    assert table.frame["learner"].tolist() == ["PPO"] * 2 + ["SAC"] * 2
    assert (table.frame.groupby("learner")["motions"].diff().dropna() > 0).all()
    assert table.frame["motions per reach"].between(1, 60).all()
