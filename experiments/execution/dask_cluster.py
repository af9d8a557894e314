"""Runs made on a Dask cluster, whose workers are started by hand, or by Slurm."""

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from distributed import Client, wait
from distributed.comm import CommClosedError, get_address_host_port
from distributed.scheduler import KilledWorker

from experiments.errors import ConfigError
from experiments.execution.pending import LOST, make

CONNECT_WITHIN = 5.0
"""Seconds in which a scheduler must answer."""


class DaskCluster:
    """See `Machines`. A worker of Dask makes as many runs at a time as it has threads.

    Dask itself hands a run whose worker was killed to another worker, three times (`allowed-failures` of the
    scheduler), before the worker counts as lost.
    """

    def __init__(self, address: str, patience: float):
        self._address = address
        self._patience = patience
        self._seen = time.monotonic()
        self._working: dict[Any, Path] = {}
        try:
            get_address_host_port(address)
            self._client = Client(address, timeout=CONNECT_WITHIN)
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"--cluster {address}: no Dask scheduler answers within {CONNECT_WITHIN:g} s ({error}); "
                "allowed: the address that `dask scheduler` prints, such as tcp://head:8786"
            ) from error

    def start(self, pending: Sequence[Path]) -> None:
        """See `Machines`."""
        with self._connected():
            self._refuse_gone()
            for each in pending:
                self._working[self._client.submit(make, str(each.resolve()), pure=False)] = each

    def ended(self, seconds: float) -> list[tuple[Path, int]]:
        """See `Machines`."""
        with self._connected():
            try:
                over = wait(list(self._working), seconds, "FIRST_COMPLETED").done
            except TimeoutError:
                over = ()
            self._refuse_gone()
            return [(self._working.pop(future), self._exit_code(future)) for future in over]

    def close(self) -> None:
        """See `Machines`."""
        self._working.clear()
        self._client.close(timeout=CONNECT_WITHIN)

    def _exit_code(self, future: Any) -> int:
        try:
            return int(future.result())
        except KilledWorker:
            return LOST
        except (CancelledError, ConfigError, OSError):
            raise
        except Exception as error:
            raise ConfigError(
                f"a worker of {self._address} cannot make runs ({error!r}); it must be started in this "
                "repository's folder, with the same packages"
            ) from error

    @contextmanager
    def _connected(self) -> Iterator[None]:
        """Raises where the scheduler goes away meanwhile."""
        try:
            yield
        except (CancelledError, CommClosedError):
            raise self._gone("its scheduler went away") from None

    def _refuse_gone(self) -> None:
        if self._client.status != "running":
            raise self._gone("its scheduler went away")
        if self._client.scheduler_info()["workers"]:
            self._seen = time.monotonic()
        elif time.monotonic() - self._seen > self._patience:
            raise self._gone(f"no worker for {self._patience:g} s")

    def _gone(self, what: str) -> ConfigError:
        return ConfigError(
            f"the cluster at {self._address} is gone: {what}. What has finished is kept; the same command "
            "makes the rest, here (without --cluster) or on another cluster"
        )
