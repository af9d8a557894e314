"""Pending runs: workers begin them, are looked at, end when they are not wanted, and are moved into place."""

import threading
import time

import pytest

from experiments.errors import ConfigError
from experiments.execution import pending as module
from experiments.execution.pending import (
    begin,
    clear,
    discard,
    is_begun,
    make,
    newest_folder,
    place,
    target_of,
    withdraw,
    write_pending,
)
from experiments.running.results_folder import DONE, LOG
from experiments.running.versions import versions
from tests.experiments.fakes import runs


@pytest.fixture
def pending(suite_data, tmp_path):
    suite_data["scenarios"][0]["motions"] = 100_000
    return write_pending(tmp_path, runs(suite_data)[0], versions())


def test_a_run_is_begun_with_its_first_worker(pending, tmp_path):
    assert not is_begun(pending)
    assert newest_folder(pending) is None
    first = begin(pending)
    assert is_begun(pending)
    assert newest_folder(pending) == first
    assert newest_folder(pending) in (first, begin(pending))
    assert not is_begun(tmp_path / "gone")
    assert newest_folder(tmp_path / "gone") is None


def test_folders_may_be_moved_into_place_while_they_are_looked_for(pending):
    over = threading.Event()

    def make_many() -> None:
        for _ in range(300):
            folder = begin(pending)
            (folder / DONE).write_text("{}")
            place(folder)
            discard(target_of(pending))
        over.set()

    thread = threading.Thread(target=make_many)
    thread.start()
    while not over.is_set():
        newest_folder(pending)
    thread.join()
    assert newest_folder(pending) is None


def test_a_machine_that_does_not_see_the_folder_says_so(tmp_path):
    with pytest.raises(ConfigError, match=r"does not see .* all machines share"):
        make(str(tmp_path / "runs/.attempts/some-run"))


def test_a_machine_with_other_versions_makes_nothing(pending, monkeypatch):
    monkeypatch.setattr(module, "versions", lambda: versions() | {"numpy": "0.9"})
    assert make(str(pending)) == 1
    said = (newest_folder(pending) / LOG).read_text()
    assert "has other versions: numpy 0.9, ordered" in said
    assert not target_of(pending).exists()


@pytest.mark.parametrize("begun", ["folder", "worker"])
@pytest.mark.parametrize("end", ["withdrawn", "cleared"])
def test_a_worker_that_is_not_wanted_any_more_ends(pending, tmp_path, monkeypatch, end, begun):
    monkeypatch.setattr(module, "_LOOK_EVERY", 0.1)
    codes = []
    thread = threading.Thread(target=lambda: codes.append(make(str(pending))))
    thread.start()
    while not ((folder := newest_folder(pending)) and (begun == "folder" or (folder / LOG).exists())):
        time.sleep(0.001)
    withdraw(pending) if end == "withdrawn" else clear(tmp_path)
    thread.join()
    assert codes[0] < 0
    assert not target_of(pending).exists()
    if end == "withdrawn":
        assert make(str(pending)) < 0
