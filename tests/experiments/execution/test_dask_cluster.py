"""Runs on a Dask cluster: workers that are killed, and clusters that go away."""

import json
import random
import subprocess
import sys
import threading
import time

import pytest

from experiments.__main__ import main
from experiments.running.results_folder import LOG, TIMINGS
from experiments.running.versions import REPOSITORY


class Cluster:
    """A scheduler and its workers, each a process that can be killed."""

    def __init__(self, folder):
        file = folder / "scheduler.json"
        self.scheduler = start("scheduler", "--port", 0, "--no-dashboard", "--scheduler-file", file)
        while not file.exists() or not file.read_text():
            time.sleep(0.05)
        self.address = json.loads(file.read_text())["address"]
        self.workers = []

    def add(self, workers=1):
        for _ in range(workers):
            self.workers.append(
                start("worker", "--no-nanny", "--nthreads", 1, "--no-dashboard", self.address)
            )

    def kill_one(self, number):
        worker = self.workers.pop(number)
        worker.kill()
        worker.wait()

    def close(self):
        for process in (self.scheduler, *self.workers):
            process.kill()
            process.wait()


def start(what, *options):
    command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *map(str, options)]
    return subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@pytest.fixture
def cluster(tmp_path):
    cluster = Cluster(tmp_path)
    yield cluster
    cluster.close()


@pytest.fixture
def run(write_config, suite_data):
    """Carries out two of the four runs of `finished_once` into a folder, with options."""
    config = write_config(suite_data | {"agents": [{"name": "unified_servo"}]})
    return lambda out, *options: main(["run", str(config), "--out", str(out), *map(str, options)])


def results(out):
    """All files of the servo's runs but those that tell of time."""
    return {
        str(path.relative_to(out)): path.read_bytes()
        for path in out.glob("runs/*servo*/*")
        if path.name not in (TIMINGS, LOG) and not path.name.startswith("events.")
    }


@pytest.mark.slow
@pytest.mark.parametrize("kills", [3, 20])
def test_workers_killed_at_some_moments_change_nothing(run, finished_once, cluster, tmp_path, kills):
    """The suite is made anew until so many workers were killed, for each of which another one comes."""
    cluster.add(workers=2)
    rng, killed = random.Random(0), 0
    for number in range(10 + kills):
        out, over, count = tmp_path / str(number), threading.Event(), []

        def kill(over=over, count=count):
            while len(count) < 3 and not over.wait(rng.uniform(0.2, 2.0)):
                cluster.kill_one(rng.randrange(2))
                cluster.add()
                count.append(1)

        thread = threading.Thread(target=kill)
        thread.start()
        try:
            assert run(out, "--cluster", cluster.address) == 0
        finally:
            over.set()
            thread.join()
        assert results(out) == results(finished_once)
        assert not (out / "runs" / ".attempts").exists()
        killed += len(count)
        if killed >= kills:
            return
    pytest.fail("the suite is over before anything is killed")


@pytest.mark.slow
def test_a_cluster_that_goes_away_is_one_error_and_the_rest_is_made_here(
    run, finished_once, cluster, tmp_path, capsys
):
    cluster.add()
    out = tmp_path / "out"

    def kill_after_the_first_run():
        while not list(out.glob("runs/*/DONE.json")):
            time.sleep(0.05)
        cluster.scheduler.kill()

    thread = threading.Thread(target=kill_after_the_first_run, daemon=True)
    thread.start()
    assert run(out, "--cluster", cluster.address) == 2
    said = capsys.readouterr()
    assert f"error: the cluster at {cluster.address} is gone: its scheduler went away" in said.err
    assert "What has finished is kept" in said.err
    assert len(list(out.glob("runs/*/DONE.json"))) == 1
    assert run(out) == 0
    assert "2 runs, 1 of them finished already" in capsys.readouterr().out
    assert results(out) == results(finished_once)


def test_a_cluster_without_workers_is_given_up(run, cluster, tmp_path, capsys):
    options = ("--cluster", cluster.address, "--cluster-patience", "1")
    assert run(tmp_path / "out", *options) == 2
    assert "is gone: no worker for 1 s" in capsys.readouterr().err


@pytest.mark.parametrize("address", ["nowhere", "tcp://127.0.0.1:1", "carrier-pigeon://home:8786"])
def test_a_wrong_address_is_one_error_and_touches_nothing(run, tmp_path, capsys, monkeypatch, address):
    monkeypatch.setattr("experiments.execution.dask_cluster.CONNECT_WITHIN", 0.2)
    assert run(tmp_path / "out", "--cluster", address) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: --cluster {address}: no Dask scheduler answers")
    assert "allowed: the address that `dask scheduler` prints" in said
    assert not (tmp_path / "out").exists()


def test_a_missing_package_is_named(run, tmp_path, capsys, monkeypatch):
    monkeypatch.delitem(sys.modules, "experiments.execution.dask_cluster", raising=False)
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert run(tmp_path / "out", "--cluster", "tcp://127.0.0.1:1") == 2
    said = capsys.readouterr().err
    assert "error: --cluster needs distributed" in said
    assert "pip install '.[cluster]'" in said
