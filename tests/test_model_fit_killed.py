"""Runs that are killed, workers that die, and other machines: the same files in the end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from site_samples import GUIDS, design, site
from test_model_fit import HERE, contents

from linear_ik.errors import LinearIkError, OutputError
from linear_ik.model_fit import ModelFitOptions, fit_model
from linear_ik.model_fit.folder import RunFolder
from linear_ik.model_fit.pool import DIED, InProcess, Processes, one_thread_each
from linear_ik.model_fit.tasks import Task
from linear_ik.settings import FitSettings
from linear_ik.site.obstacles import Mesh

TESTS = Path(__file__).parent
RUN = """
import sys
sys.path.insert(0, {tests!r})
from site_samples import design
from linear_ik.quick_open3d import defer_plots
defer_plots()
from linear_ik.model_fit import ModelFitOptions, fit_model
if __name__ == "__main__":
    fit_model(design(), [{scan!r}], {folder!r}, options=ModelFitOptions(workers={workers}))
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return site(tmp_path_factory.mktemp("site"), points=600)


@pytest.fixture(scope="module")
def undisturbed(built, tmp_path_factory):
    folder = tmp_path_factory.mktemp("asbuilt")
    fit_model(built.design, [built.scan], folder, options=ModelFitOptions(**HERE))
    return contents(folder)


def started(script: Path, built, folder: Path, workers: int) -> subprocess.Popen:
    script.write_text(RUN.format(tests=str(TESTS), scan=str(built.scan), folder=str(folder), workers=workers))
    return subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def finished_elements(folder: Path) -> int:
    return len([p for p in (folder / "elements").glob("*.json") if not p.name.startswith(".")])


def test_killed_three_times_it_ends_with_the_same_files(built, undisturbed, tmp_path):
    folder = tmp_path / "asbuilt"
    for kill_at in (1, 3, 4):
        run = started(tmp_path / "run.py", built, folder, workers=0)
        deadline = time.monotonic() + 60
        while finished_elements(folder) < kill_at and time.monotonic() < deadline and run.poll() is None:
            time.sleep(0.005)
        os.kill(run.pid, signal.SIGKILL)
        run.wait()
        assert finished_elements(folder) >= kill_at
        assert not (folder / "run.json").exists()
    fit_model(built.design, [built.scan], folder, options=ModelFitOptions(**HERE))
    assert contents(folder) == undisturbed


def test_two_runs_in_one_folder_keep_out_of_each_others_way(built, tmp_path):
    folder = RunFolder(tmp_path / "asbuilt", [])
    folder.make()
    with pytest.raises(OutputError, match="another run is at work in it"):
        fit_model(built.design, [built.scan], tmp_path / "asbuilt", options=ModelFitOptions(**HERE))
    folder.release()
    RunFolder(tmp_path / "asbuilt", []).make()


def children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def is_worker(pid: int) -> bool:
    return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for child processes in Linux's /proc")
def test_a_worker_that_is_killed_and_a_parent_that_is(built, undisturbed, tmp_path):
    folder = tmp_path / "asbuilt"
    run = started(tmp_path / "run.py", built, folder, workers=1)
    deadline = time.monotonic() + 60
    worker = None
    while worker is None and time.monotonic() < deadline:
        worker = next((pid for pid in children(run.pid) if is_worker(pid)), None)
        time.sleep(0.01)
    os.kill(worker, signal.SIGKILL)
    while finished_elements(folder) < 1 and time.monotonic() < deadline and run.poll() is None:
        time.sleep(0.01)
    assert run.poll() is None
    second = next(pid for pid in children(run.pid) if is_worker(pid))
    assert second != worker
    os.kill(run.pid, signal.SIGKILL)
    run.wait()
    # A worker does not outlive its parent.
    while Path(f"/proc/{second}").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not Path(f"/proc/{second}").exists()
    fit_model(built.design, [built.scan], folder, options=ModelFitOptions(**HERE))
    assert contents(folder) == undisturbed


class Bomb:
    """Kills the process that unpickles it; once only, when it has a file to remember that by."""

    def __init__(self, note: str = "") -> None:
        self.note = note

    def __reduce__(self):
        return _explode, (self.note,)


def _explode(note: str):
    if not note or not Path(note).exists():
        if note:
            Path(note).write_text("once")
        os.kill(os.getpid(), signal.SIGKILL)
    return None


def task(guid: str, station_index=None) -> Task:
    element = next(m.element for m in design().members if m.guid == guid)
    no_mesh = Mesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
    return Task(guid, element, np.empty((0, 3)), None, station_index, FitSettings(), no_mesh, 0.2)


def test_a_task_that_kills_its_worker_twice_has_failed_and_no_other(tmp_path):
    tasks = [task(GUIDS[0]), task(GUIDS[1], Bomb()), task(GUIDS[2]), task(GUIDS[3], Bomb(str(tmp_path / "note")))]
    pool = Processes(2)
    try:
        outcomes = {outcome.guid: outcome for outcome in pool.run(tasks)}
    finally:
        pool.close()
    assert {guid for guid, outcome in outcomes.items() if outcome.failure} == {GUIDS[1]}
    assert outcomes[GUIDS[1]].failure == DIED
    assert [outcomes[g].result.status for g in (GUIDS[0], GUIDS[2], GUIDS[3])] == ["not_scanned"] * 3


def test_a_script_without_a_main_guard_is_told_so(built, tmp_path):
    script = tmp_path / "run.py"
    text = RUN.format(tests=str(TESTS), scan=str(built.scan), folder=str(tmp_path / "out"), workers=1)
    script.write_text(text.replace('if __name__ == "__main__":', "if True:"))
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert (
        'PoolError: workers: no process of them stays alive (a script needs `if __name__ == "__main__":`' in done.stderr
    )


def test_ctrl_c_while_a_worker_is_started_is_for_this_process_alone():
    # A shell that runs the tests in the background has it ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    child = "import os, signal; os.kill(os.getpid(), signal.SIGINT); print(os.environ['OMP_NUM_THREADS'])"
    threads = os.environ.get("OMP_NUM_THREADS")
    try:
        with pytest.raises(KeyboardInterrupt), one_thread_each():
            os.kill(os.getpid(), signal.SIGINT)
            done = subprocess.run([sys.executable, "-c", child], capture_output=True, text=True)
        assert (done.returncode, done.stdout, done.stderr) == (0, "1\n", "")
    finally:
        signal.signal(signal.SIGINT, before)
    assert os.environ.get("OMP_NUM_THREADS") == threads


def test_this_process_does_tasks_too():
    bad = replace(task(GUIDS[0]), points=np.zeros((3, 2)))
    good = task(GUIDS[1])
    outcomes = list(InProcess().run([bad, good]))
    assert outcomes[0].failure and outcomes[0].result is None
    assert outcomes[1].result.status == "not_scanned"


@pytest.fixture
def cluster(tmp_path):
    """A Dask scheduler and two workers, each a process of its own: its address, and they."""
    pytest.importorskip("distributed")
    file = tmp_path / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": tmp_path}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard", "--port", "0"]
    scheduler = subprocess.Popen([*dask, "--host", "127.0.0.1", "--scheduler-file", str(file)], **quiet)
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-dashboard", "--no-nanny"]
    workers = []
    try:
        deadline = time.monotonic() + 60
        while not file.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        workers = [subprocess.Popen([*worker, "--scheduler-file", str(file)], **quiet) for _ in range(2)]
        yield json.loads(file.read_text())["address"], workers
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


def test_a_cluster_that_loses_a_worker_gives_the_same_files(built, undisturbed, tmp_path, cluster):
    address, workers = cluster
    folder = tmp_path / "asbuilt"

    def on_progress(stage, done, total, seconds):
        if stage == "fitting" and done == 1:
            workers[0].kill()

    fit_model(built.design, [built.scan], folder, None, ModelFitOptions(scheduler=address), on_progress)
    assert workers[0].wait() < 0
    assert contents(folder) == {**undisturbed, "run.json": contents(folder)["run.json"]}


def test_a_cluster_without_workers_is_not_waited_for_for_ever(built, tmp_path, cluster, monkeypatch):
    address, workers = cluster
    monkeypatch.setattr("linear_ik.model_fit.cluster.LOOK_S", 0.1)
    monkeypatch.setattr("linear_ik.model_fit.cluster.FETCH_S", 0.5)
    monkeypatch.setattr("linear_ik.model_fit.cluster.PATIENCE_S", 1.0)
    said = set()

    def on_progress(stage, done, total, seconds):
        said.add(stage)
        if stage == "fitting" and done == 1:
            time.sleep(2)  # results that are done and not fetched die with them
            for worker in workers:
                worker.kill()

    with pytest.raises(LinearIkError, match=r"scheduler: .* no workers for \d+ s \(run again: what is fini"):
        fit_model(built.design, [built.scan], tmp_path, None, ModelFitOptions(scheduler=address), on_progress)
    assert f"waiting for workers: {address} has none" in said
    assert finished_elements(tmp_path) >= 1


def test_a_scheduler_that_is_not_there(built, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("linear_ik.model_fit.cluster.CONNECT_S", 0.5)
    with pytest.raises(LinearIkError, match="scheduler: tcp://127.0.0.1:9: "):
        options = ModelFitOptions(scheduler="tcp://127.0.0.1:9")
        fit_model(built.design, [built.scan], tmp_path / "out", options=options)
    assert not (tmp_path / "out").exists()
