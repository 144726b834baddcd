"""The workers of a Dask cluster behave like those of this machine."""

import os
import signal

import pytest

from ocptip.numerics.workers import WorkerDiedError, worker_pool
from tests.motion import calls

distributed = pytest.importorskip("distributed")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of the cluster that loses its workers
def test_dead_workers_of_a_cluster(tmp_path):
    here = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": ":0"}
    with (
        distributed.LocalCluster(**here) as cluster,
        worker_pool(None, None, 1, cluster.scheduler_address) as pool,
    ):
        assert pool.submit(calls.threads).result() == "1"
        lasting = [pool.submit(calls.slow, k) for k in range(6)]
        os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
        assert [future.result() for future in lasting] == list(range(6))
        with pytest.raises(ValueError, match="no such thing"):
            pool.submit(calls.refuses, "no such thing").result()
        with pytest.raises(WorkerDiedError, match="again and again"):
            pool.submit(calls.dies, 50, f"{tmp_path}", 1).result()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Dask, about its own sockets
def test_the_cluster_goes_on_without_us():
    here = {"n_workers": 1, "threads_per_worker": 2, "processes": False, "dashboard_address": ":0"}
    with distributed.LocalCluster(**here) as cluster:
        for k in range(2):
            with worker_pool(None, None, 1, cluster.scheduler_address) as pool:
                futures = [pool.submit(calls.slow, j) for j in range(3)]
                assert [future.result() for future in futures] == [0, 1, 2]
                waiting = pool.submit(calls.slow, k)
                waiting.cancel()
