"""What the runner does when workers are lost or fail, with machines that do as they are told."""

import json
import os

import pytest

from experiments.config.suite import Suite
from experiments.execution.pending import begin, newest_folder, place, target_of
from experiments.execution.progress import Lines, status
from experiments.execution.runner import Runner
from experiments.running.results_folder import DONE, LOG


class Told:
    """Machines whose workers end at once, each run's with the codes it was told."""

    def __init__(self, *codes):
        self.codes = codes
        self.started = []
        self.over = []

    def start(self, pending):
        for each in pending:
            code = self.codes[self.started.count(each)]
            self.started.append(each)
            folder = begin(each)
            (folder / LOG).write_text(f"motions 40/90\nworker {self.started.count(each)}\n")
            if code == 0:
                (folder / DONE).write_text("{}")
                place(folder)
            self.over.append((each, code))

    def ended(self, seconds):
        over, self.over = self.over, []
        return over

    def close(self):
        pass


@pytest.fixture
def make(suite_data, tmp_path):
    """Makes one run, or those of another suite, with machines."""
    alone = {"worlds": 1, "agents": [{"name": "random"}]}

    def make(machines, changes=alone, **options):
        suite = Suite.model_validate(suite_data | changes)
        return Runner(suite, tmp_path / "out", machines, Lines(), **options).run("run")

    return make


@pytest.mark.parametrize("losses", [0, 1, 2])
def test_a_run_whose_worker_was_lost_is_made_again(make, losses, capsys):
    machines = Told(*[-9] * losses, 0)
    assert make(machines, retries=2) == []
    assert len(machines.started) == losses + 1
    assert capsys.readouterr().out.count("its worker was lost (exit code -9); made again") == losses


def test_a_run_that_is_lost_too_often_has_failed(make, tmp_path):
    machines = Told(-9, -9, -9, 0)
    assert len(make(machines, retries=2)) == 1
    (folder,) = (tmp_path / "out" / "runs").iterdir()
    failure = json.loads((folder / "FAILED.json").read_text())
    assert failure["exit_code"] == -9
    assert failure["log_tail"] == ["motions 40/90", "worker 3", "its worker was lost 3 times"]
    assert status(tmp_path / "out").failed


def test_a_run_that_failed_is_not_made_again(make, tmp_path):
    machines = Told(3, 0)
    (failed,) = make(machines, retries=2)
    assert len(machines.started) == 1
    assert json.loads((tmp_path / "out/runs" / failed / "FAILED.json").read_text())["exit_code"] == 3
    assert make(Told(0)) == []  # but at the next start


def test_a_run_that_was_made_but_is_not_seen_here_names_the_cause(make, monkeypatch, capsys):
    monkeypatch.setattr("experiments.execution.runner.SEEN_WITHIN", 0.0)
    monkeypatch.setattr("tests.experiments.execution.test_retries.place", lambda folder: None)
    with pytest.raises(ValueError, match="all machines share"):
        make(Told(0))


def test_an_interrupted_run_shows_and_is_cleared_by_the_next_runner(make, tmp_path):
    class Interrupted(Told):
        def ended(self, seconds):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make(Interrupted(-2))
    found = status(tmp_path / "out")
    assert list(found.runs["state"]) == ["interrupted"]
    assert list(found.runs["detail"]) == ["after 40 of 90 motions; begins anew"]
    assert make(Told(0)) == []
    assert os.listdir(tmp_path / "out/runs") == list(found.runs["run"])


def test_a_run_that_is_being_made_shows_wherever_it_is_made(make, tmp_path):
    class Looked(Told):
        def start(self, pending):
            self.pending = list(pending)
            self.found = [status(tmp_path / "out")]
            begin(self.pending[0])
            self.found.append(status(tmp_path / "out"))

        def ended(self, seconds):
            super().start(self.pending)
            return super().ended(seconds)

    machines = Looked(0)
    assert make(machines) == []
    assert [list(found.runs["state"]) for found in machines.found] == [["waiting"], ["running"]]
    assert all("a runner is at work" in found.counts for found in machines.found)
    assert list(status(tmp_path / "out").runs["state"]) == ["done"]


def test_the_second_of_two_workers_is_thrown_away(make, tmp_path):
    class Twice(Told):
        def start(self, pending):
            (run,) = pending
            twin = begin(run)
            super().start(pending)
            self.first = (target_of(run) / LOG).read_text()
            (twin / LOG).write_text("motions 90/90\n")
            (twin / DONE).write_text("{}")
            place(twin)
            assert newest_folder(run) is None

    machines = Twice(0)
    assert make(machines) == []
    (folder,) = (tmp_path / "out" / "runs").iterdir()
    assert (folder / LOG).read_text() == machines.first


def test_the_longest_runs_are_begun_first(make, capsys):
    agents = ["random", {"name": "unified_servo", "motions": 9_000}, {"name": "paper_servo", "motions": 400}]
    machines = Told(0)
    assert make(machines, {"worlds": 2, "agents": agents}, at_once=2) == []
    assert [each.name.split("-")[1] for each in machines.started[:2]] == ["unified_servo"] * 2
    assert machines.started[-1].name.split("-")[1] == "random"
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("6 runs, 0 of them finished already; about ")
    assert said[-1] == "6 of 6"
