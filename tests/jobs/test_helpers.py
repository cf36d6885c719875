"""Threads that decode and encode beside the one that works."""

import os
import threading

import pytest

from stereomend.jobs.helpers import Helpers


def test_calls_run_beside_the_caller_and_beside_each_other():
    helpers, meeting = Helpers(2), threading.Barrier(3, timeout=20)
    waiting = [helpers.start(meeting.wait) for _ in range(2)]
    meeting.wait()
    assert {future.result() for future in waiting} < {0, 1, 2}


def test_an_error_reaches_who_asks_for_the_result():
    future = Helpers(1).start(int, "x")
    with pytest.raises(ValueError, match="invalid literal"):
        future.result()


def test_once_awake_a_thread_may_use_every_core():
    helpers = Helpers(1)
    for _ in range(3):
        assert helpers.start(os.sched_getaffinity, 0).result() == os.sched_getaffinity(0)


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="there is one core")
def test_sleeping_threads_are_sent_to_other_cores_than_the_caller():
    cores, helpers, meeting = os.sched_getaffinity(0), Helpers(2), threading.Barrier(3, timeout=20)

    def meet():
        meeting.wait()
        return threading.get_native_id()

    waiting = [helpers.start(meet) for _ in range(2)]
    meeting.wait()
    threads = {future.result() for future in waiting}
    try:
        os.sched_setaffinity(0, {max(cores)})
        awake = helpers.start(threading.get_native_id).result()
        (asleep,) = threads - {awake}
        assert os.sched_getaffinity(asleep) == cores - {max(cores)}
    finally:
        os.sched_setaffinity(0, cores)
