"""Calls in other processes: what becomes of them when one dies, is interrupted or cannot be reached."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import as_completed
from multiprocessing.connection import wait

import pytest

from ocptip.basics.errors import InputError
from ocptip.numerics.workers import WorkerDiedError, worker_pool
from tests.motion import calls


def test_a_dead_worker_is_replaced_and_its_call_run_again(tmp_path):
    """Three die once, one twice; nobody else notices."""
    deaths = [0, 1, 0, 2, 1, 0, 1]
    with worker_pool(None, 2, len(deaths)) as pool:
        futures = {pool.submit(calls.dies, n, f"{tmp_path}", k): k for k, n in enumerate(deaths)}
        found = {futures[future]: future.exception() or future.result() for future in as_completed(futures)}
        assert isinstance(found.pop(3), WorkerDiedError)
        assert found == {k: k for k in range(7) if k != 3}
        assert len(pool.processes) <= 2


@pytest.mark.slow
def test_a_worker_killed_from_outside_while_it_works_and_one_that_rests():
    with worker_pool(None, 1, 2) as pool:
        future = pool.submit(calls.slow, 7)
        while not pool.processes:
            time.sleep(0.01)
        os.kill(pool.processes[0].pid, signal.SIGKILL)
        assert future.result() == 7
        (resting,) = [process for process in pool.processes if process.is_alive()]
        os.kill(resting.pid, signal.SIGKILL)
        resting.join(10)
        assert pool.submit(calls.slow, 8).result() == 8


def test_errors_are_those_of_the_call():
    with worker_pool(None, 1, 2) as pool:
        with pytest.raises(ValueError, match="no such thing"):
            pool.submit(calls.refuses, "no such thing").result()
        assert pool.submit(calls.slow, 1).result() == 1


def test_workers_have_one_thread_and_the_environment_is_left_alone(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    with worker_pool(None, 1, 1) as pool:
        assert pool.submit(calls.threads).result() == "1"
        assert os.environ["OMP_NUM_THREADS"] == "7"


def test_workers_end_with_an_interrupt():
    workers = []

    def interrupted():
        with worker_pool(None, 1, 2) as pool:
            pool.submit(calls.slow, 0).result()
            pool.submit(time.sleep, 60)
            pool.submit(time.sleep, 60)
            workers.extend(pool.processes)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    (worker,) = workers
    assert wait([worker.sentinel], 10)  # (the pool's own thread reaps it: `is_alive` may come in between)


@pytest.mark.slow
def test_no_cluster_there():
    pytest.importorskip("distributed")
    with (
        pytest.raises(InputError, match=r"--scheduler tcp://127\.0\.0\.1:1: no scheduler"),
        worker_pool(None, None, 1, scheduler="tcp://127.0.0.1:1"),
    ):
        pass


@pytest.mark.slow
def test_prepared_processes_have_the_modules():
    code = (
        "from ocptip.numerics.fork_server import prepare_workers\n"
        "print('numpy' in __import__('sys').modules)\n"
        "prepare_workers(['colorsys', 'no_such_module'])\n"
        "from ocptip.numerics.workers import worker_pool\n"
        "with worker_pool(None, 2, 2) as pool:\n"
        "    has = pool.submit(eval, \"'colorsys' in __import__('sys').modules\").result()\n"
        "    threads = pool.submit(eval, \"__import__('os').environ['OMP_NUM_THREADS']\").result()\n"
        "print(has, threads)\n"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    prepared = f"{sys.platform.startswith('linux')}"
    assert said.stdout.split() == ["False", prepared, "1"], said.stderr
    assert said.stderr == ""
