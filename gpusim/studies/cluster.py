"""Workers of a Dask scheduler (``gpusim[cluster]``), which may be on other machines.

They see the study's folder under the same path; a batch and what becomes of it is all that travels.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Any

from distributed import Client

from gpusim.errors import InputError, require

_PATIENCE_S = 30
"""How long to wait for a scheduler, and for a worker of it."""


class ClusterPool:
    """The workers of the scheduler at an ``address``, tcp://host:8786, or of the file that a
    scheduler has written (``dask scheduler --scheduler-file``).

    Raises InputError if nobody answers there, or has workers.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        # a scheduler that dies, and is met again, is worth no traceback
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        self._client = self._connected()

    @property
    def size(self) -> int:
        """How many workers there are now."""
        return max(len(self._client.scheduler_info(n_workers=-1)["workers"]), 1)

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        """Call it on a worker; its name is no key, as nobody else asks for it."""
        executor = self._client.get_executor(pure=False)
        future: Future[Any] = executor.submit(function, *args)
        return future

    def renew(self, future: Future[Any]) -> None:
        """Dask starts workers anew; a scheduler that was started anew is met again here."""
        del future
        if self._client.status != "running" or not self._answers():
            self._client.close(timeout=1)
            self._client = self._connected()

    def close(self, kill: bool) -> None:
        """Leave the scheduler and its workers to others."""
        del kill
        self._client.close()

    def _answers(self) -> bool:
        try:
            self._client.sync(self._client.scheduler.identity)
        except (OSError, ValueError):
            return False
        return True

    def _connected(self) -> Client:
        name = Path(self._address)
        where = {"scheduler_file": str(name)} if name.is_file() else {"address": self._address}
        expected = "a Dask scheduler with workers: dask scheduler, then dask worker ADDRESS"
        what, is_any = f"--scheduler {self._address}", name.is_file() or ":" in self._address
        require(is_any, what, "neither an address nor a file that is there", expected)
        client = None
        try:
            client = Client(**where, timeout=_PATIENCE_S, set_as_default=False)
            client.wait_for_workers(1, timeout=_PATIENCE_S)
        except (OSError, ValueError, TimeoutError) as error:
            if client is not None:
                with suppress(OSError, ValueError):  # it waits for an answer, too
                    client.close(timeout=1)
            got = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(f"{what}: {got}; expected {expected}") from None
        return client
