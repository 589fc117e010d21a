"""Timing: jobs in processes of their own, in rounds that alternate, and their memory above the bare imports.

On a busy machine a time says little and a ratio of two times taken one after the other
says more: every round runs each job once, and ratios are taken within a round.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

Result = TypeVar("Result")

PEAK, NOW = "VmHWM:", "VmRSS:"
# Pools of BLAS threads on cores that others use too spin against each other, to the loss of whoever has them.
ONE_BLAS_THREAD = {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "VECLIB_MAXIMUM_THREADS": "1"}


# Memory -----------------------------------------------------------------------------------


def peak_bytes() -> int:
    """Return the most memory this process has held at once (resident set)."""
    return _status(PEAK) or _rusage_peak()


def resident_bytes() -> int:
    """Return the memory this process holds now; where the system does not say, its peak."""
    return _status(NOW) or _rusage_peak()


def reset_peak() -> None:
    """Forget the peak so far, where the system can (Linux); elsewhere it stays."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        pass


def _status(key: str) -> int:
    # ru_maxrss will not do on Linux: a child inherits its parent's.
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith(key)), 0)


def _rusage_peak() -> int:
    import resource

    # Kilobytes, but bytes on macOS.
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


# Time -------------------------------------------------------------------------------------


def repeated(
    call: Callable[[], Result], budget_s: float = 1.0, least: int = 1, most: int = 7
) -> tuple[Result, list[float]]:
    """Return the last result of a call and the wall times of all.

    Args:
        call: what is timed.
        budget_s: start no further call once so much time has passed.
        least: calls, whatever they take.
        most: calls.
    """
    times: list[float] = []
    while len(times) < least or (len(times) < most and sum(times) < budget_s):
        started = time.perf_counter()
        result = call()
        times.append(time.perf_counter() - started)
    return result, times


def alternating(calls: dict[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """Return wall times [rounds] of each call, taken in turns and each round from another start."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for i in range(rounds):
        for name in rotated(list(calls), i):
            started = time.perf_counter()
            calls[name]()
            times[name].append(time.perf_counter() - started)
    return times


def rotated(names: list[str], by: int) -> list[str]:
    """Return the names beginning with another one each time."""
    k = by % len(names) if names else 0
    return names[k:] + names[:k]


def ratio(times: Sequence[float], to: Sequence[float]) -> float:
    """Return the median of the ratios of times taken in the same rounds."""
    return statistics.median(a / b for a, b in zip(times, to, strict=True))


# Processes --------------------------------------------------------------------------------


class JobError(Exception):
    """A job that ended without an answer; the text is one line saying why."""


def run_job(module: str, job: dict[str, Any], timeout_s: float) -> dict[str, Any]:
    """Run ``python -m module`` on a job, in a process of its own, and return what it answers.

    The process reads the job from a JSON file and writes its answer to another (`serve`):
    what libraries print cannot get in the way. BLAS gets one thread, other pools theirs.

    Raises:
        JobError: it failed, crashed or took too long.
    """
    with tempfile.TemporaryDirectory(prefix="linear_ik_bench_") as folder:
        asked, answered, said = (Path(folder) / name for name in ("job.json", "answer.json", "said"))
        asked.write_text(json.dumps(job))
        command = [sys.executable, "-m", module, str(asked), str(answered)]
        with said.open("w") as file:
            try:
                done = subprocess.run(
                    command,
                    stdout=file,
                    stderr=subprocess.STDOUT,
                    stdin=subprocess.DEVNULL,
                    env=os.environ | ONE_BLAS_THREAD,
                    timeout=timeout_s,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                raise JobError(f"no answer within {timeout_s:g} s") from None
        if not answered.exists():
            lines = [line.strip() for line in said.read_text(errors="replace").splitlines() if line.strip()]
            raise JobError(f"exit code {done.returncode}: {lines[-1][:200] if lines else 'no word'}")
        answer: dict[str, Any] = json.loads(answered.read_text())
        if "failed" in answer:
            raise JobError(answer["failed"])
        return answer


def serve(work: Callable[[dict[str, Any]], dict[str, Any]]) -> int:
    """Do the job that `run_job` asks for: the other end, in the process of its own."""
    job = json.loads(Path(sys.argv[1]).read_text())
    try:
        answer = work(job)
    except MemoryError:
        answer = {"failed": "out of memory"}
    except Exception as error:
        import traceback

        traceback.print_exc()
        answer = {"failed": f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"[:200]}
    Path(sys.argv[2]).write_text(json.dumps(answer))
    return 0


def load() -> dict[str, Any]:
    """Return how busy the machine is, for the record."""
    loads = os.getloadavg() if hasattr(os, "getloadavg") else (float("nan"),) * 3
    return {"cores": os.cpu_count(), "load_average_1_min": loads[0], "threads": os.environ.get("OMP_NUM_THREADS")}


def say(text: str) -> None:
    """Report progress on stderr."""
    print(text, file=sys.stderr, flush=True)
