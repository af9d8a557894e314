"""`python -m experiments tune`, with real agents in real processes."""

import json
import os
import random
import signal
import subprocess
import sys
import threading
import time

import pytest

from experiments.__main__ import main
from experiments.running.run import runs_of
from experiments.running.versions import REPOSITORY
from experiments.tuning.config import TuningConfig
from experiments.tuning.tuner import Lifetimes, Lived, LostError


def command(config, out):
    values = ("tries=2", "scenarios.0.worlds=1", "scenarios.0.check_worlds=2")
    smaller = [word for value in values for word in ("--set", value)]
    return [sys.executable, "-m", "experiments", "tune", str(config), "--out", str(out), *smaller]


def start(config, out):
    return subprocess.Popen(
        command(config, out), cwd=REPOSITORY, stdout=subprocess.PIPE, text=True, start_new_session=True
    )


def without_times(path):
    """What is published, without CPU times."""
    found = json.loads(path.read_text())
    for each in found["tries"]:
        del each["cpu_seconds"]
    for each in (found, found["check"] or found):
        each.pop("cpu_minutes", None)
    del found["tables"]
    return found


@pytest.mark.slow
def test_killed_at_any_moment_it_ends_with_the_same(tuning_data, write_config, tmp_path):
    config, undisturbed = write_config(tuning_data), tmp_path / "undisturbed"
    begun = time.monotonic()
    subprocess.run(command(config, undisturbed), cwd=REPOSITORY, check=True, capture_output=True)
    whole = time.monotonic() - begun
    rng = random.Random(0)
    for k in range(8):
        out = tmp_path / f"out{k}"
        process = start(config, out)
        try:
            process.wait(rng.uniform(0.1, whole))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        subprocess.run(command(config, out), cwd=REPOSITORY, check=True, capture_output=True)
        assert without_times(out / "jacobian_servo.json") == without_times(
            undisturbed / "jacobian_servo.json"
        )


@pytest.fixture
def endless(tuning_data):
    """A lifetime of minutes."""
    tuning_data["scenarios"][0]["motions"] = 1_000_000
    config = TuningConfig.model_validate(tuning_data)
    return runs_of(config.suite(config.agents[0], {}))[0]


def test_a_lifetime_ends_when_its_cpu_time_does(endless, tmp_path):
    assert Lifetimes({}).make(endless, 0.5, tmp_path / "log.txt") == Lived(None, None, 0.5)


def test_a_lifetime_that_is_stopped_says_nothing_about_its_settings(endless, tmp_path):
    lifetimes, log = Lifetimes({}), tmp_path / "log.txt"

    def stop_once_it_has_begun():
        while not (log.exists() and log.read_text()):
            time.sleep(0.01)
        lifetimes.stop()

    thread = threading.Thread(target=stop_once_it_has_begun)
    thread.start()
    with pytest.raises(LostError, match="exit code -9"):
        lifetimes.make(endless, 1_000, log)
    thread.join()


def test_a_lifetime_that_fails_says_with_what(tuning_data, tmp_path):
    config = TuningConfig.model_validate(tuning_data)
    run = runs_of(config.suite(config.agents[0], {"damping": -1.0}))[0]
    lived = Lifetimes({}).make(run, 60, tmp_path / "log.txt")
    assert lived.value is None
    assert lived.error.startswith("ValueError: agent 'jacobian_servo': damping is -1.0;")
    assert 0 < lived.cpu_seconds < 60


def test_user_errors_are_one_message(tuning_data, write_config, tmp_path, capsys):
    config = write_config(tuning_data)
    words = ["tune", str(config), "--out", str(tmp_path / "out")]
    assert main([*words, "--agent", "jacobian_serwo"]) == 2
    assert (
        "--agent: found 'jacobian_serwo': unknown (did you mean jacobian_servo?); allowed: jacobian_servo"
        in capsys.readouterr().err
    )
    assert main([*words, "--set", "tires=3"]) == 2
    assert "tires: unknown key (did you mean tries?)" in capsys.readouterr().err
    (tmp_path / "out").write_text("a file")
    assert main(words) == 2
    assert capsys.readouterr().err.startswith("error: ")
