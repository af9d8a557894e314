"""The one picture, of lives that nobody lived."""

from dataclasses import replace
from itertools import combinations

import matplotlib.pyplot as plt
import numpy as np
import pytest

from experiments.reporting.figures import colour, in_words, spread
from experiments.reporting.held_out import held_out
from experiments.reporting.learning_picture import learning_picture
from tests.experiments.reporting.made_up import CAP, finished_suite, results

# Motions of a life; motions per reach at first, right after the knock and in the end; and by how many motions
# half of the way is learned.
LIVES = {
    "oracle": (2_000, 1, 1, 1, 1),
    "paper_servo": (2_000, 10, 10, 10, 1),
    "grid_table": (2_000, 10, 9.5, 4, 700),
    "memory": (2_000, 6.7, 3, 1, 30),
    "cooperstock_milios": (2_000, 60, 11, 1.1, 40),
    "self_supervised": (2_000, 60, 3.6, 1, 50),
    "ppo": (300_032, 60, 45, 1.9, 12_000),
    "sac": (16_000, 60, 50, 1.6, 3_500),
    "random": (2_000, 58, 58, 58, 1),
}


def lives(worlds, knock=True, agents=tuple(LIVES)):
    """A suite in which the left camera is turned at half of each life, or is not."""
    aim = {"at": {"motion": 1_000}, "do": {"type": "camera_aim", "camera": "left", "degrees": 20}}
    env = {"id": "CalFree/ReachDense-v0", "world": "wild", "dynamics": "kinematic", "max_episode_steps": CAP}
    aimed = {"name": "aimed", "env": env, "motions": 2_000, "perturbations": [aim] if knock else []}
    suite = {"name": "lives", "question": "Who learns?", "worlds": worlds, "scenarios": [aimed]}
    suite |= {"evaluation": {"every": 10, "trials": 2}, "agents": list(agents)}
    rows = [row for agent in agents for world in range(worlds) for row in life(agent, world, knock)]
    names = "agent world lifetime_motions motions_since_perturbation motions success"
    return finished_suite(suite, results(names, rows))


def checkpoints(length):
    """0, 1, then four a decade, and the end."""
    found = np.unique(np.round(10 ** np.arange(0, np.log10(length), 0.25)).astype(int))
    return [0, *found.tolist(), length]


def life(agent, world, knock):
    length, first, after, last, by = LIVES[agent]
    wide = 1 + 0.15 * np.sin(world + 1) * (first != last)

    def reach(start, motions):
        return float(np.clip(last + (start * wide - last) * 2 ** (-motions / by), 1, CAP))

    end = length // 2 if knock else length
    rows = [(agent, world, at, None, reach(first, at)) for at in checkpoints(end)]
    if knock:
        rows += [(agent, world, end + at, at, reach(after, at)) for at in checkpoints(length - end)]
    return [(*row, row[-1] < CAP) for row in rows]


@pytest.fixture(scope="module")
def four():
    return lives(4)


def drawn(finished):
    (scenario,) = finished.suite.scenarios
    figure = learning_picture(finished, held_out(finished, scenario))
    plt.close(figure)
    return figure


def curve_of(axes, agent):
    """The median world's line: the widest one of the agent's colour that is no label's."""
    of_agent = [line for line in axes.lines if line.get_color() == colour(agent, agent)]
    return max(of_agent, key=lambda line: (line.get_transform() == axes.transData, line.get_linewidth()))


@pytest.fixture(scope="module")
def picture(four):
    return drawn(four)


def test_each_stretch_of_a_life_has_its_panel_and_its_clock(picture):
    left, right = picture.axes
    assert (left.get_title("left"), right.get_title("left")) == (
        "from the beginning",
        "left camera turned by\N{NO-BREAK SPACE}20°",
    )
    for axes in (left, right):
        for agent in ("memory", "ppo"):
            at = [max(each, 1) for each in checkpoints(LIVES[agent][0] // 2)]
            assert list(curve_of(axes, agent).get_xdata()) == at, agent
        assert axes.get_xlim()[1] > LIVES["ppo"][0] / 2


def test_the_line_is_the_median_world(four, picture):
    rows = four.results[(four.results["agent"] == "sac") & four.results["motions_since_perturbation"].isna()]
    reach = rows["motions"].where(rows["rendezvous"], CAP).groupby([rows["lifetime_motions"], rows["world"]])
    expected = reach.mean().unstack().median(axis=1)
    np.testing.assert_allclose(curve_of(picture.axes[0], "sac").get_ydata(), expected)


def test_every_agent_is_named_where_its_line_ends_and_no_name_covers_another(picture):
    texts = {text.get_text(): text for text in picture.axes[-1].texts}
    for agent in LIVES:
        (mine,) = [text for words, text in texts.items() if words.startswith(in_words(agent, agent))]
        assert mine.get_color() == colour(agent, agent)
    boxes = [text.get_window_extent() for text in texts.values()]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    width, height = picture.get_size_inches() * picture.dpi
    assert all(box.x1 <= width and box.y0 >= 0 and box.y1 <= height for box in boxes)


def test_who_is_still_improving_is_said(picture):
    improving = {
        text.get_text().partition(",")[0] for text in picture.axes[-1].texts if "still" in text.get_text()
    }
    assert in_words("sac", "sac") in improving  # 1 of 2.3 half-lives
    assert not improving & {in_words(each, each) for each in ("memory", "paper_servo", "self_supervised")}


def test_a_run_that_failed_counts_as_the_cap(four):
    lost = four.results[(four.results["agent"] != "memory") | (four.results["world"] == 0)]
    figure = drawn(replace(four, results=lost))
    assert set(curve_of(figure.axes[0], "memory").get_ydata()) == {CAP}
    assert drawn(replace(four, results=four.results[four.results["agent"] != "ppo"])).axes


def test_without_a_knock_there_is_one_panel():
    figure = drawn(lives(20, knock=False, agents=("memory", "sac")))
    (axes,) = figure.axes
    assert axes.get_title("left") == ""
    bands = [each for each in axes.collections if len(each.get_paths())]
    assert len(bands) == 2
    assert "10th to 90th percentile" in figure.get_supxlabel()


def test_what_lives_begin_with_has_no_panel():
    whole = lives(4, agents=("memory",))
    (aimed,), rows = whole.suite.scenarios, whole.results
    noise = {"at": {"trial": 0}, "do": {"type": "point_noise", "px": 1}}
    noisy = aimed.model_copy(update={"perturbations": (noise, *aimed.perturbations)})
    since = rows["motions_since_perturbation"].fillna(rows["lifetime_motions"])
    rows, suite = rows.assign(motions_since_perturbation=since), whole.suite
    figure = drawn(replace(whole, results=rows, suite=suite.model_copy(update={"scenarios": (noisy,)})))
    assert [axes.get_title("left")[:11] for axes in figure.axes] == ["from the be", "left camera"]


def test_labels_stand_where_they_are_wanted_or_beside_each_other():
    heights = np.full(4, 0.1)
    np.testing.assert_allclose(spread(np.array([0.5, 0.1, 0.9, 0.3]), heights), [0.5, 0.1, 0.9, 0.3])
    crowded = spread(np.array([0.5, 0.52, 0.9, 0.5]), heights)
    np.testing.assert_allclose(sorted(crowded)[:3], [0.405, 0.505, 0.605], atol=0.003)
    assert crowded[2] == pytest.approx(0.9)
    top = spread(np.ones(4), heights)
    assert np.all(np.diff(np.sort(top)) >= 0.0999)
    assert top.max() <= 1.0
