"""Orders are looked at while attempts at them begin, and are moved into place."""

import threading

import pytest

from experiments.config.suite import Suite
from experiments.execution.orders import (
    begin,
    discard,
    is_begun,
    newest_attempt,
    place,
    target_of,
    write_order,
)
from experiments.running.plan import runs_of
from experiments.running.results_folder import DONE


@pytest.fixture
def order(suite_data, tmp_path):
    return write_order(tmp_path, runs_of(Suite.model_validate(suite_data))[0], {"code": "abc"})


def test_an_order_is_begun_with_its_first_attempt(order, tmp_path):
    assert not is_begun(order)
    assert newest_attempt(order) is None
    first = begin(order)
    assert is_begun(order)
    assert newest_attempt(order) == first
    assert newest_attempt(order) in (first, begin(order))
    assert not is_begun(tmp_path / "gone")
    assert newest_attempt(tmp_path / "gone") is None


def test_attempts_may_be_moved_into_place_while_they_are_looked_for(order):
    over = threading.Event()

    def make() -> None:
        for _ in range(300):
            attempt = begin(order)
            (attempt / DONE).write_text("{}")
            place(attempt)
            discard(target_of(order))
        over.set()

    thread = threading.Thread(target=make)
    thread.start()
    while not over.is_set():
        newest_attempt(order)
    thread.join()
    assert newest_attempt(order) is None
