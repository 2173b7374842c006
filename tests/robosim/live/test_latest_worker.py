"""The worker that processes only the latest request."""

import threading

from robosim.live.latest_worker import LatestWorker, close_all


def test_a_waiting_request_is_replaced_by_a_later_one():
    """Of a hundred requests during one piece of work only the last is processed."""
    begun, go_on, done = threading.Event(), threading.Event(), []

    def work(request: int) -> None:
        begun.set()
        assert go_on.wait(10)
        done.append(request)

    worker = LatestWorker("test", work, lambda error: None)
    worker.put(0)
    assert begun.wait(10)
    for request in range(1, 101):
        worker.put(request)
    assert worker.is_stale
    go_on.set()
    assert worker.settle(10)
    assert done == [0, 100]
    assert worker.n_dropped == 99
    assert not worker.is_stale
    worker.close()
    assert worker.is_stale


def test_an_error_is_reported_and_the_next_request_processed():
    failed, done = [], []

    def work(request: int) -> None:
        done.append(1 / request)

    worker = LatestWorker("test", work, failed.append)
    worker.put(0)
    assert worker.settle(10)
    worker.put(2)
    assert worker.settle(10)
    close_all([worker])
    assert [type(error) for error in failed] == [ZeroDivisionError]
    assert done == [0.5]
