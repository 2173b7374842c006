"""The worker for which only the latest request counts."""

import threading

from robosim.live.latest import Latest, close_all


def test_what_waits_is_dropped_for_what_comes_later():
    """Of a hundred requests during one piece of work only the last is worked on."""
    begun, go_on, done = threading.Event(), threading.Event(), []

    def work(request: int) -> None:
        begun.set()
        assert go_on.wait(10)
        done.append(request)

    worker = Latest("test", work, lambda error: None)
    worker.put(0)
    assert begun.wait(10)
    for request in range(1, 101):
        worker.put(request)
    assert worker.stale
    go_on.set()
    assert worker.settle(10)
    assert done == [0, 100]
    assert worker.dropped == 99
    assert not worker.stale
    worker.close()
    assert worker.stale, "nobody wants what is worked on after the end"


def test_an_error_is_told_and_the_next_request_done():
    failed, done = [], []

    def work(request: int) -> None:
        done.append(1 / request)

    worker = Latest("test", work, failed.append)
    worker.put(0)
    assert worker.settle(10)
    worker.put(2)
    assert worker.settle(10)
    close_all([worker])
    assert [type(error) for error in failed] == [ZeroDivisionError]
    assert done == [0.5]
