"""What `benchmarks/kill.py` does, in fewer rounds: no accepted job is lost, changed or done twice."""

from collections import Counter

import pytest
from trials.filling import fill_disk, may_mount
from trials.killing import POINTS, kill_at_points, kill_at_random, plan
from trials.stopping import stop_past_lease

KILLS = 50


@pytest.fixture
def ended_well(tmp_path):
    """Check a trial: jobs were done, none has a fault; the server's log is shown otherwise."""

    def check(trial):
        log = next(tmp_path.rglob("service.log")).read_text()
        assert not trial.faults, f"{trial.faults}\n{log[-5000:]}"
        assert trial.jobs > 0
        assert sum(trial.attempts.values()) == trial.jobs
        assert 500 not in trial.answers

    return check


def test_processes_killed_at_random_moments_lose_no_job(tmp_path, ended_well):
    trial = kill_at_random(tmp_path, plan(KILLS, seed=1))
    ended_well(trial)
    assert trial.kills.total() == KILLS
    assert set(trial.kills) == {"api", "worker", "supervisor"}
    assert max(trial.attempts) > 1, "no kill met a job at work"


def test_an_api_process_that_dies_at_named_points_loses_no_job(tmp_path, ended_well):
    trial = kill_at_points(tmp_path, deaths=1, seed=1)
    ended_well(trial)
    assert trial.kills == Counter(POINTS)


def test_processes_stopped_past_their_lease_change_no_result(tmp_path, ended_well):
    trial = stop_past_lease(tmp_path, rounds=1)
    ended_well(trial)
    assert max(trial.attempts) > 1, "the stopped worker had no job"


def test_a_full_disk_loses_no_job_and_leaves_no_half_file(tmp_path, ended_well):
    if not may_mount(tmp_path):
        pytest.skip("no tmpfs can be mounted here")
    trial = fill_disk(tmp_path, seconds=5, seed=1)
    ended_well(trial)
    assert trial.answers[507] > 0, "no upload met the full disk"
