"""Cluster: tasks done by the workers of a Dask scheduler, on other machines if need be.

Nothing is shared but the network: a task carries its points, and its outcome the result.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from linear_ik.errors import LinearIkError
from linear_ik.model_fit.tasks import Outcome, Task, run_task

CONNECT_S = 20.0
TASKS_A_THREAD = 2  # so that a worker never waits for the next
POLL_S, LOOK_S = 0.05, 5.0  # between looks for outcomes, and for workers
FETCH_S = 60.0  # for one result over the network, before a look whether its worker may be gone
PATIENCE_S = 300.0  # without any worker: long enough to start some again
KEPT = "run again: what is finished is kept"


class ClusterError(LinearIkError):
    """A scheduler that cannot be used."""


class Cluster:
    """The workers of a Dask scheduler do the tasks."""

    def __init__(self, address: str, on_wait: Callable[[str], object] = lambda _: None) -> None:
        """Connect.

        Args:
            address: of the scheduler, such as tcp://host:8786.
            on_wait: told now and then, in words, while all workers are gone.

        Raises:
            ClusterError: nobody answers there, no worker comes, or distributed is not installed.
        """
        try:
            distributed: Any = importlib.import_module("distributed")
        except ImportError:
            raise ClusterError("scheduler", "needs distributed", 'pip install "linear_ik[cluster]"') from None
        self._distributed = distributed
        try:
            self._client: Any = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            reason = str(error).split("\n")[0] or type(error).__name__
            raise ClusterError(
                "scheduler", f"{address}: {reason}", "a Dask scheduler, such as tcp://host:8786"
            ) from None
        try:
            self._client.wait_for_workers(1, timeout=CONNECT_S)
        except TimeoutError:
            self._client.close()
            raise ClusterError("scheduler", f"{address}: has no workers", f"dask worker {address}") from None
        self._address, self._on_wait = address, on_wait
        self._seen = time.monotonic()  # when there were workers

    def run(self, tasks: Iterable[Task]) -> Iterator[Outcome]:
        """Yield the outcome of every task, in the order they end.

        Raises:
            ClusterError: the scheduler is gone, or all workers are and none comes; what was finished was yielded.
        """
        waiting = iter(tasks)
        running: dict[Any, str] = {}
        ended = self._distributed.as_completed(loop=self._client.loop)
        while True:
            room = TASKS_A_THREAD * max(1, self._threads()) - len(running)
            for _ in range(max(0, room)):
                task = next(waiting, None)
                if task is None:
                    break
                future = self._client.submit(run_task, task, pure=False)
                running[future] = task.guid
                ended.add(future)
            if not running:
                return
            future = self._next(ended)
            guid = running.pop(future)
            yield self._outcome(future, guid)

    def close(self) -> None:
        """Disconnect; the scheduler forgets what was asked of it."""
        self._client.close()

    def _threads(self) -> int:
        try:
            threads = int(sum(self._client.nthreads().values()))
        except OSError as error:
            raise self._lost() from error
        if threads:
            self._seen = time.monotonic()
        return threads

    def _look(self) -> None:
        """Look for workers: without any the scheduler would have us wait for ever."""
        if self._threads():
            return
        alone_s = time.monotonic() - self._seen
        if alone_s > PATIENCE_S:
            raise ClusterError("scheduler", f"{self._address}: has had no workers for {alone_s:.0f} s", KEPT)
        self._on_wait(f"waiting for workers: {self._address} has none")

    def _next(self, ended: Any) -> Any:
        """Return the next future that ends."""
        looked = time.monotonic()
        while not ended.has_ready():
            time.sleep(POLL_S)
            if time.monotonic() - looked > LOOK_S:
                self._look()
                looked = time.monotonic()
        return next(ended)

    def _fetched(self, future: Any) -> Outcome:
        """Return the result of a future that has ended; where its worker is gone another one makes it again."""
        while True:
            try:
                outcome: Outcome = future.result(timeout=FETCH_S)
                return outcome
            except self._distributed.TimeoutError:
                self._look()

    def _lost(self) -> ClusterError:
        return ClusterError("scheduler", f"{self._address}: the connection is lost", KEPT)

    def _outcome(self, future: Any, guid: str) -> Outcome:
        try:
            return self._fetched(future)
        except ClusterError:
            raise
        except self._distributed.KilledWorker:
            return Outcome(guid, failure="every worker that tried it died (out of memory?)")
        except Exception as error:
            if future.status in ("cancelled", "lost"):
                raise self._lost() from error
            return Outcome(guid, failure=f"{type(error).__name__}: {error}")
        finally:
            future.release()
