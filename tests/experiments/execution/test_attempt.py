"""One attempt: what it must see, and when it ends."""

import threading
import time

import pytest

from experiments.config.suite import Suite
from experiments.errors import ConfigError
from experiments.execution import attempt as module
from experiments.execution.attempt import attempt
from experiments.execution.orders import clear, newest_attempt, target_of, withdraw, write_order
from experiments.running.plan import runs_of
from experiments.running.results_folder import LOG
from experiments.running.versions import versions


@pytest.fixture
def order(suite_data, tmp_path):
    suite_data["scenarios"][0]["motions"] = 100_000
    spec = runs_of(Suite.model_validate(suite_data))[0]
    return write_order(tmp_path, spec, versions())


def test_a_machine_that_does_not_see_the_folder_says_so(tmp_path):
    with pytest.raises(ConfigError, match=r"does not see .* all machines share"):
        attempt(str(tmp_path / "runs/.attempts/some-run"))


def test_a_machine_with_other_versions_makes_nothing(order, monkeypatch):
    monkeypatch.setattr(module, "versions", lambda: versions() | {"numpy": "0.9"})
    assert attempt(str(order)) == 1
    said = (newest_attempt(order) / LOG).read_text()
    assert "has other versions: numpy 0.9, ordered" in said
    assert not target_of(order).exists()


@pytest.mark.parametrize("begun", ["order", "body"])
@pytest.mark.parametrize("end", ["withdrawn", "cleared"])
def test_an_attempt_that_is_not_wanted_any_more_ends(order, tmp_path, monkeypatch, end, begun):
    monkeypatch.setattr(module, "_LOOK_EVERY", 0.1)
    codes = []
    thread = threading.Thread(target=lambda: codes.append(attempt(str(order))))
    thread.start()
    while not ((attempted := newest_attempt(order)) and (begun == "order" or (attempted / LOG).exists())):
        time.sleep(0.001)
    withdraw(order) if end == "withdrawn" else clear(tmp_path)
    thread.join()
    assert codes[0] < 0
    assert not target_of(order).exists()
    if end == "withdrawn":
        assert attempt(str(order)) < 0
