"""What a person who waits is told, on stderr."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.status import Status

SPINNER_AFTER_S = 0.5
# Without a terminal a line stays for good, so only what takes really long gets one.
LINE_AFTER_S = 5.0
NEXT_LINE_AFTER_S = 2.0


class Progress:
    """Says which stage takes its time: a spinner on a terminal, else a plain line.

    rich is imported when there is something to say: a quick command never waits for it.
    """

    def __init__(self, quiet: bool = False) -> None:
        """Say nothing at all when ``quiet``."""
        self._quiet = quiet
        self._terminal = sys.stderr.isatty()
        self._lock = threading.Lock()
        self._status: Status | None = None
        self._text = ""
        self._said_s = 0.0

    def steps(self) -> Callable[[str, float], None]:
        """Return what tells of the steps of the stage that runs: called with a step, and the share of it done.

        Without a terminal a step has its line as it begins, once the last one is 2 s ago; reading has none, as
        it may end in an error.
        """
        last = ""
        self._said_s = time.monotonic()

        def tell(what: str, share: float) -> None:
            nonlocal last
            self.update(f"{what}: {100 * share:.0f} %")
            now = time.monotonic()
            fresh = what != last and not what.startswith("reading")
            if self._quiet or self._terminal or not fresh or now - self._said_s < NEXT_LINE_AFTER_S:
                return
            last, self._said_s = what, now
            print(f"{what} ...", file=sys.stderr, flush=True)

        return tell

    @contextmanager
    def stage(self, text: str, judges_input: bool = False) -> Iterator[None]:
        """Show ``text`` while the block runs, once it takes long enough.

        Args:
            text: what is being done.
            judges_input: the stage may end in an error, which has to be the only line.
        """
        if self._quiet or (judges_input and not self._terminal):
            yield
            return
        self._text = text
        over = threading.Event()
        timer = threading.Thread(target=self._show, args=(over,), daemon=True)
        timer.start()
        try:
            yield
        finally:
            over.set()
            with self._lock:
                if self._status is not None:
                    self._status.stop()
                    self._status = None

    def update(self, text: str) -> None:
        """Replace the text of the stage that runs."""
        self._text = text
        with self._lock:
            if self._status is not None:
                self._status.update(text)

    def _show(self, over: threading.Event) -> None:
        if over.wait(SPINNER_AFTER_S if self._terminal else LINE_AFTER_S):
            return
        if not self._terminal:
            print(f"{self._text} ...", file=sys.stderr, flush=True)
            return
        from rich.console import Console
        from rich.status import Status

        with self._lock:
            if not over.is_set():
                self._status = Status(self._text, console=Console(stderr=True))
                self._status.start()
