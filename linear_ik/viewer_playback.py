"""Viewer, playback: states of a fit shown at an eye's pace, while the fit runs ahead."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable

from linear_ik.result import IterationRecord


class Playback:
    """A thread that shows what it is given, one after the other, each for a while."""

    def __init__(self, show: Callable[[IterationRecord], None], pause_s: float, total_s: float) -> None:
        """Start the thread.

        Args:
            show: shows a state; called from the thread only.
            pause_s: how long each is shown at least.
            total_s: over all of them; what is left then is shown at once.
        """
        self._show, self._pause_s, self._left_s = show, pause_s, total_s
        self._stopped = threading.Event()
        self._records: queue.SimpleQueue[IterationRecord | None] = queue.SimpleQueue()
        # Who interrupts a fit does not wait for its pictures.
        self._thread = threading.Thread(target=self._run, name="linear_ik playback", daemon=True)
        self._thread.start()

    def put(self, record: IterationRecord) -> None:
        """Take a state, to be shown when those before it were."""
        self._records.put(record)

    def finish(self) -> None:
        """Return when all are shown."""
        self._records.put(None)
        self._thread.join()

    def stop(self) -> None:
        """Return as soon as the state that is shown has had its while; those after it are not shown."""
        self._stopped.set()
        self.finish()

    def _run(self) -> None:
        while (record := self._records.get()) is not None and not self._stopped.is_set():
            self._show(record)
            pause_s = min(self._pause_s, self._left_s)
            if pause_s > 0.0:
                time.sleep(pause_s)
                self._left_s -= pause_s
