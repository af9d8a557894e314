"""Workers: copies as good as fresh processes, and what ends when."""

import os
import signal
import threading
import time
from pathlib import Path

import pytest

from experiments.running.process import end_idle_workers, lent_worker
from experiments.running.results_folder import DONE, RUN, TRIALS, write_whole
from tests.experiments.fakes import runs

MADE_OF = {"code": "this"}


@pytest.fixture(autouse=True)
def _none_left():
    end_idle_workers()
    yield
    end_idle_workers()


@pytest.fixture
def folders(suite_data, tmp_path):
    """Of four runs: two agents in two worlds."""
    made = []
    for run in runs(suite_data):
        made.append(tmp_path / run.id)
        made[-1].mkdir()
        write_whole(made[-1] / RUN, run.model_dump_json())
    return made


def make(folder, versions=MADE_OF):
    with lent_worker(versions) as lent, (folder / "log.txt").open("w") as log:
        return lent, lent.make(folder, log)


def results(folder):
    return {name: (folder / name).read_bytes() for name in (TRIALS, DONE)}


@pytest.mark.slow
def test_a_copy_makes_what_a_fresh_process_makes_whatever_was_made_before(folders):
    first = folders[-1]
    fresh, code = make(first)
    assert code == 0
    expected = results(first)
    for folder in (*folders[:-1], first):
        assert make(folder) == (fresh, 0)
    assert results(first) == expected
    assert "90/90" in (first / "log.txt").read_text()


def test_a_run_that_fails_says_why_and_the_next_one_is_made(folders):
    (folders[0] / RUN).write_text("{}")
    lent, code = make(folders[0])
    assert code == 1
    assert "ValidationError" in (folders[0] / "log.txt").read_text()
    assert make(folders[1]) == (lent, 0)


def test_a_worker_of_other_versions_is_ended(folders):
    old, _ = make(folders[0])
    new, code = make(folders[1], {"code": "that"})
    assert code == 0
    assert new is not old
    assert not old.is_alive


def children(pid):
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def wait_for(pid):
    """Waits until a process is over, whether or not its parent has asked how it ended."""
    while (status := Path(f"/proc/{pid}/status")).exists() and "State:\tZ" not in status.read_text():
        time.sleep(0.01)


@pytest.mark.parametrize("killed", ["copy", "worker"])
def test_what_is_killed_is_lost_and_leaves_nothing_behind(folders, suite_data, killed):
    suite_data["scenarios"][0]["motions"] = 1_000_000
    (folders[0] / RUN).write_text(runs(suite_data)[0].model_dump_json())
    found = []

    def kill():
        while not (folders[0] / TRIALS).exists():
            time.sleep(0.01)
        found.extend(children(lent._process.pid))
        if killed == "copy":
            os.kill(found[0], signal.SIGKILL)
        else:
            lent.kill()

    with lent_worker(MADE_OF) as lent, (folders[0] / "log.txt").open("w") as log:
        thread = threading.Thread(target=kill)
        thread.start()
        code = lent.make(folders[0], log)
        thread.join()
    assert code == -signal.SIGKILL
    if killed == "worker":
        assert not lent.is_alive
    wait_for(found[0])
    next_one, code = make(folders[1])
    assert code == 0
    assert (next_one is lent) == (killed == "copy")
