"""POST /v1/refine by a client that would rather not wait."""

import httpx
import pytest

QUICK = {"gdr": {"warps": 1, "levels": 1}}
ENDLESS = {"gdr": {"warps": 1000, "iterations": 1000, "levels": 1}, "processing_scale": 1.0}
BRIEF = ENDLESS | {"gdr": ENDLESS["gdr"] | {"warps": 12}}


@pytest.fixture
def prefer(post):
    """POST /v1/refine with `Prefer`."""

    def send(server, prefer, headers=None, **options):
        return post(server, headers={"Prefer": prefer} | (headers or {}), **options)

    return send


def stored(server, answer, finished, accept="application/x-npy"):
    job = finished(server, answer)
    assert job["state"] == "succeeded", job["error"]
    return httpx.get(server.url + job["result"]["href"], headers={"Accept": accept})


def test_what_is_done_in_time_is_the_answer(server, prefer, post):
    answer = prefer(server, "wait=60", params=QUICK)
    assert answer.status_code == 200
    assert answer.headers["Preference-Applied"] == "wait=60"
    assert answer.content == post(server, params=QUICK).content


def test_without_a_preference_none_is_applied(server, post):
    assert "Preference-Applied" not in post(server, params=QUICK).headers


def test_respond_async_is_answered_at_once(server, prefer, post, finished):
    answer = prefer(server, "respond-async", params=QUICK)
    assert answer.status_code == 202
    assert answer.headers["Preference-Applied"] == "respond-async"
    assert answer.headers["Location"] == f"/v1/jobs/{answer.json()['id']}"
    assert stored(server, answer, finished).content == post(server, params=QUICK).content


def test_what_runs_longer_than_the_client_waits_goes_on_as_a_job(server, prefer, post, finished):
    answer = prefer(server, "wait=1", params=BRIEF)
    assert answer.status_code == 202
    assert answer.headers["Preference-Applied"] == "wait=1"
    assert 1 <= answer.elapsed.total_seconds() < 10
    assert stored(server, answer, finished).content == post(server, params=BRIEF).content


def test_what_still_waits_when_the_client_leaves_goes_on_as_a_job(serving, prefer, occupy, finished):
    with serving(work_limit_s=4) as server:
        occupy(server)
        answer = prefer(server, "respond-async, wait=1", params=QUICK)
        assert answer.status_code == 202
        assert answer.headers["Preference-Applied"] == "respond-async, wait=1"
        assert stored(server, answer, finished).status_code == 200


def test_a_key_brings_the_client_back_to_its_job_and_then_to_its_result(server, prefer, finished):
    key = {"Idempotency-Key": "later-1"}
    first = prefer(server, "respond-async", headers=key, params=QUICK)
    result = stored(server, first, finished)
    again = prefer(server, "respond-async", headers=key, params=QUICK)
    assert again.status_code == 200
    assert again.content == result.content
    assert again.headers["Content-Type"] == "application/x-npy"


def test_a_key_is_not_for_another_body(server, prefer, is_problem):
    key = {"Idempotency-Key": "later-2"}
    assert prefer(server, "respond-async", headers=key, params=QUICK).status_code == 202
    other = prefer(server, "respond-async", headers=key, params=QUICK | {"preset": "paper"})
    is_problem(other, 422, "idempotency-mismatch")


def test_a_refinement_that_is_refused_is_no_job(server, prefer, is_problem):
    is_problem(prefer(server, "respond-async", accept="image/webp"), 406, "not-acceptable")
    is_problem(prefer(server, "respond-async", accept="application/ply"), 422, "invalid-parameter")
