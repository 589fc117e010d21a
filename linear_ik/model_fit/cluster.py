"""Cluster: tasks done by the workers of a Dask scheduler, on other machines if need be.

Nothing is shared but the network: a task carries its points, and its outcome the result.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator
from typing import Any

from linear_ik.errors import LinearIkError
from linear_ik.model_fit.tasks import Outcome, Task, run_task

CONNECT_S = 20.0
TASKS_A_THREAD = 2  # so that a worker never waits for the next


class ClusterError(LinearIkError):
    """A scheduler that cannot be used."""


class Cluster:
    """The workers of a Dask scheduler do the tasks."""

    def __init__(self, address: str) -> None:
        """Connect.

        Args:
            address: of the scheduler, such as tcp://host:8786.

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
        self._address = address

    def run(self, tasks: Iterable[Task]) -> Iterator[Outcome]:
        """Yield the outcome of every task, in the order they end.

        Raises:
            ClusterError: the scheduler is gone; what it had finished was yielded.
        """
        waiting = iter(tasks)
        running: dict[Any, str] = {}
        ended = self._distributed.as_completed(loop=self._client.loop)
        while True:
            room = TASKS_A_THREAD * max(1, sum(self._client.nthreads().values())) - len(running)
            for _ in range(max(0, room)):
                task = next(waiting, None)
                if task is None:
                    break
                future = self._client.submit(run_task, task, pure=False)
                running[future] = task.guid
                ended.add(future)
            if not running:
                return
            future = next(ended)
            guid = running.pop(future)
            yield self._outcome(future, guid)

    def close(self) -> None:
        """Disconnect; the scheduler forgets what was asked of it."""
        self._client.close()

    def _outcome(self, future: Any, guid: str) -> Outcome:
        try:
            outcome: Outcome = future.result()
        except self._distributed.KilledWorker:
            return Outcome(guid, failure="every worker that tried it died (out of memory?)")
        except Exception as error:
            if future.status in ("cancelled", "lost"):
                raise ClusterError(
                    "scheduler", f"{self._address}: the connection is lost", "run again: what is finished is kept"
                ) from error
            return Outcome(guid, failure=f"{type(error).__name__}: {error}")
        finally:
            future.release()
        return outcome
