"""Pool: where tasks are done; in this process, or in some of their own on this machine.

Each process is an executor of its own with one task at a time, so that when one dies it is
known which task it died of: that task gets a second process, and after that it has failed.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import Pipe, get_context, resource_tracker
from multiprocessing.connection import Connection
from types import FrameType
from typing import Protocol

from linear_ik.errors import LinearIkError
from linear_ik.model_fit.tasks import Outcome, Task, run_task
from linear_ik.quick_open3d import defer_plots

# Read by BLAS and OpenMP when they are loaded: processes that share cores must not each use all of them.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
MOST_ATTEMPTS = 2
DIED = f"its process was killed or crashed, {MOST_ATTEMPTS} times (out of memory?)"


class PoolError(LinearIkError):
    """Processes that cannot be started."""


class Pool(Protocol):
    """Somewhere tasks are done."""

    def run(self, tasks: Iterable[Task]) -> Iterator[Outcome]:
        """Yield the outcome of every task, in the order they end; tasks are taken as they are needed."""
        ...

    def close(self) -> None:
        """Let go of what is held."""
        ...


class InProcess:
    """This process does the tasks, one by one."""

    def run(self, tasks: Iterable[Task]) -> Iterator[Outcome]:
        """Yield the outcome of every task in turn."""
        yield from map(run_task, tasks)

    def close(self) -> None:
        """Nothing is held."""


class Processes:
    """Some processes of this machine do the tasks."""

    def __init__(self, workers: int) -> None:
        """Start none yet: the first tasks do."""
        self._executors: list[ProcessPoolExecutor | None] = [None] * workers
        self._lifelines: list[Connection | None] = [None] * workers
        self._starts = False

    def run(self, tasks: Iterable[Task]) -> Iterator[Outcome]:
        """Yield the outcome of every task, in the order they end."""
        waiting, again = iter(tasks), list[tuple[Task, int]]()
        running: dict[Future[Outcome], tuple[int, Task, int]] = {}
        idle = list(range(len(self._executors)))
        while True:
            while idle:
                task, attempt = again.pop() if again else (next(waiting, None), 1)
                if task is None:
                    break
                slot = idle.pop()
                running[self._submit(slot, task)] = slot, task, attempt
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                slot, task, attempt = running.pop(future)
                idle.append(slot)
                try:
                    outcome = future.result()
                except BrokenProcessPool:
                    self._drop(slot)
                    self._check_start()
                    if attempt < MOST_ATTEMPTS:
                        again.append((task, attempt + 1))
                        continue
                    outcome = Outcome(task.guid, failure=DIED)
                else:
                    self._starts = True
                yield outcome

    def close(self) -> None:
        """End the processes, whatever they are at."""
        for slot in range(len(self._executors)):
            self._drop(slot)

    def _submit(self, slot: int, task: Task) -> Future[Outcome]:
        with one_thread_each():
            try:
                return self._executor(slot).submit(run_task, task)
            except BrokenProcessPool:
                # It died while it had nothing to do.
                self._drop(slot)
                return self._executor(slot).submit(run_task, task)

    def _executor(self, slot: int) -> ProcessPoolExecutor:
        executor = self._executors[slot]
        if executor is None:
            there, self._lifelines[slot] = Pipe(duplex=False)
            executor = ProcessPoolExecutor(1, get_context("spawn"), initializer=prepare_worker, initargs=(there,))
            self._executors[slot] = executor
        return executor

    def _check_start(self) -> None:
        """Tell a task that kills its process from processes that cannot even start.

        Raises:
            PoolError: they cannot.
        """
        if self._starts:
            return
        with one_thread_each(), ProcessPoolExecutor(1, get_context("spawn")) as executor:
            try:
                executor.submit(os.getpid).result()
            except BrokenProcessPool:
                raise PoolError(
                    "workers", "no process of them stays alive", 'a script needs `if __name__ == "__main__":`, or 0'
                ) from None
        self._starts = True

    def _drop(self, slot: int) -> None:
        executor, self._executors[slot] = self._executors[slot], None
        if executor is not None:
            executor.shutdown(wait=False, cancel_futures=True)
        lifeline, self._lifelines[slot] = self._lifelines[slot], None
        if lifeline is not None:
            lifeline.close()


def make_pool(workers: int | None, scheduler: str | None, elements: int, on_wait: Callable[[str], object]) -> Pool:
    """Return where the elements are fitted.

    Args:
        workers: processes; None for one a core, 0 for this one.
        scheduler: address of a Dask scheduler, in place of ``workers``.
        elements: how many there are.
        on_wait: told, in words, while a scheduler has no workers.
    """
    if scheduler is not None:
        from linear_ik.model_fit.cluster import Cluster

        return Cluster(scheduler, on_wait)
    if workers == 0:
        return InProcess()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return Processes(max(1, min(workers or cores, elements)))


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Let processes that are started now use one thread each, and leave Ctrl-C to this one from their first moment.

    Here it waits until they are started.
    """
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    # The tracker, once it is started, lets Ctrl-C through again.
    resource_tracker.ensure_running()
    # What is blocked here is blocked there.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    # A library's thread may get it all the same: Python then calls the handler in this one.
    caught: list[tuple[int, FrameType | None]] = []
    main = threading.current_thread() is threading.main_thread()
    handler = signal.getsignal(signal.SIGINT)
    if main:
        signal.signal(signal.SIGINT, lambda *what: caught.append(what))
    try:
        yield
    finally:
        if main:
            signal.signal(signal.SIGINT, handler)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if caught and callable(handler):
            handler(*caught[0])


def prepare_worker(lifeline: Connection) -> None:
    """Start quickly, leave Ctrl-C to the parent, and end when it closes its end of the lifeline or dies itself."""
    defer_plots()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()


def _end_with(lifeline: Connection) -> None:
    try:
        lifeline.recv()
    except (EOFError, OSError):
        os._exit(1)
