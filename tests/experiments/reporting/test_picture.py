"""The picture of what a table has learned."""

import re

import gymnasium as gym
import matplotlib.image
import numpy as np
import pytest

import agents
from agents.knowledge.grid_table import GridTable
from calfree_gym import files
from experiments.__main__ import main
from experiments.reporting.picture import table_figure


@pytest.fixture
def saved(tmp_path):
    """Saves an agent that has learned a little."""

    def saved(name="grid_table", **settings):
        env = gym.make("CalFree/Reach-v0", dynamics="kinematic", world="nominal")
        agent, path = agents.make(name, env, **settings), tmp_path / f"{name}.npz"
        agent.learn(40)
        agent.save(path)
        return path

    return saved


def test_a_picture_is_drawn_of_a_saved_table(tmp_path, saved, capsys):
    source = saved(cells=5, kalman=True)
    assert main(["picture", str(source), "--out", str(tmp_path / "table.png")]) == 0
    assert str(tmp_path / "table.png") in capsys.readouterr().out
    assert matplotlib.image.imread(tmp_path / "table.png").std() > 0.05


def test_cells_stand_where_they_are_seen():
    table = GridTable(3)
    for _ in range(GridTable.TRUSTED):
        table.learn(np.array([-0.9, 0.1, 0.9, -0.6]), np.zeros(3))
    table.learn(np.array([-0.9, 0.1, 0.9, 0.6]), np.zeros(3))
    figure = table_figure(table)
    assert "2 of 4,096 cells are filled, 1 are trusted" in figure.get_suptitle()
    left, right = figure.axes[:2]
    drawn = [{(t.get_position(), t.get_text()) for t in panel.texts} for panel in (left, right)]
    assert drawn == [{((-0.875, 0.125), "2")}, {((0.875, -0.625), "1"), ((0.875, 0.625), "1")}]
    assert left.images[0].get_array().data[4, 0] == 0.5
    assert right.images[0].get_array().compressed().tolist() == [1.0, 0.0]


def test_what_is_too_large_is_not_unpacked(tmp_path, saved, monkeypatch):
    table = saved()
    monkeypatch.setattr(files, "MOST_BYTES", 1000)
    assert main(["picture", str(table), "--out", str(tmp_path / "x.png")]) == 2


def test_other_and_damaged_files_are_named(tmp_path, saved, capsys):
    servo, table = saved("unified_servo"), saved()
    damaged = tmp_path / "damaged.npz"
    damaged.write_bytes(table.read_bytes()[:-60])
    with np.load(table) as file:
        arrays = dict(file)
    np.savez(tmp_path / "lacking.npz", **{k: v for k, v in arrays.items() if k != "variances"})
    for source, said in (
        (servo, r"holds UnifiedServo\(.*only a saved grid_table can be drawn"),
        (damaged, "damaged or no saved agent"),
        (tmp_path / "lacking.npz", "damaged: what was saved holds no variances"),
        (tmp_path / "nowhere.npz", "there is no such file"),
    ):
        assert main(["picture", str(source), "--out", str(tmp_path / "x.png")]) == 2
        error = capsys.readouterr().err
        assert source.name in error
        assert re.search(said, error), error
        assert not (tmp_path / "x.png").exists()
    assert main(["picture", str(table), "--out", str(tmp_path / "x.nonsense")]) == 2
    assert "nonsense" in capsys.readouterr().err
