"""/v1/jobs over real HTTP."""

import io
import json
import threading

import httpx
import httpx_sse
import numpy as np
import pytest

QUICK = {"gdr": {"warps": 1, "levels": 1}}
ENDLESS = {"gdr": {"warps": 1000, "iterations": 1000, "levels": 1}, "processing_scale": 1.0}
CALIBRATION = {"focal_px": 80.0, "baseline_mm": 4.5}
UNKNOWN = "0" * 32


def url(server, job, end=""):
    return f"{server.url}/v1/jobs/{job['id']}{end}"


def get(server, job, end="", timeout=60, **headers):
    headers = {name.replace("_", "-"): value for name, value in headers.items()}
    return httpx.get(url(server, job, end), headers=headers, timeout=timeout)


@pytest.fixture
def done(server, submit, finished):
    """A job that has succeeded."""
    return finished(server, submit(server))


@pytest.fixture
def endless(server, submit, eventually):
    """A job that runs until it is cancelled."""
    job = submit(server, params=ENDLESS).json()
    eventually(lambda: get(server, job).json()["state"] == "running")
    yield job
    httpx.delete(url(server, job))


def test_a_job_is_accepted_and_done(server, submit, finished, stages):
    answer = submit(server, params=QUICK | {"priority": 7, "preset": "paper"})
    assert answer.status_code == 202
    job = answer.json()
    assert answer.headers["Location"] == f"/v1/jobs/{job['id']}"
    assert answer.headers["ETag"] == f'"{job["version"]}"'
    assert "Idempotency-Replayed" not in answer.headers
    assert (job["state"], job["preset"], job["priority"]) == ("queued", "paper", 7)
    assert (job["input"]["width"], job["input"]["height"]) == (64, 48)
    job = finished(server, answer)
    assert job["state"] == "succeeded"
    assert job["backend"] == "reference"
    assert job["error"] is None
    assert set(job["timings_ms"]) == set(stages)
    assert sum(job["quality"][kind] for kind in ("kept", "refined", "filled", "unobserved")) == pytest.approx(
        1
    )


@pytest.mark.parametrize(
    "accept",
    [
        "image/png",
        "application/x-npy",
        "image/x-portable-floatmap",
        "image/tiff",
        "image/png; profile=preview",
    ],
)
def test_a_result_has_the_bytes_of_a_refinement_that_is_waited_for(server, post, done, accept):
    answer = get(server, done, "/result", Accept=accept)
    assert answer.status_code == 200
    assert answer.headers["Content-Type"] == accept
    assert answer.content == post(server, accept=accept, params=QUICK).content
    assert json.loads(answer.headers["Stereomend-Meta"])["quality"] == done["quality"]
    assert answer.headers["Server-Timing"].startswith("queue;dur=")


def test_a_zip_has_the_arrays_that_were_asked_for(server, submit, finished):
    job = finished(server, submit(server, params=QUICK | {"outputs": ["confidence"]}))
    with np.load(io.BytesIO(get(server, job, "/result", Accept="application/zip").content)) as archive:
        assert set(archive.files) == {"confidence", "meta"}


def test_a_point_cloud_comes_where_there_is_a_calibration(server, post, submit, finished, done, is_problem):
    job = finished(server, submit(server, params=QUICK | CALIBRATION))
    cloud = get(server, job, "/result", Accept="application/ply")
    assert cloud.content == post(server, accept="application/ply", params=QUICK | CALIBRATION).content
    assert "application/ply" not in done["result"]["media_types"]
    is_problem(get(server, done, "/result", Accept="application/ply"), 406, "not-acceptable")


def test_a_result_that_the_client_has_is_not_sent_again(server, done):
    png = get(server, done, "/result", Accept="image/png")
    assert png.headers["Vary"] == "Accept"
    again = get(server, done, "/result", Accept="image/png", If_None_Match=png.headers["ETag"])
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["ETag"] == png.headers["ETag"]
    npy = get(server, done, "/result", Accept="application/x-npy", If_None_Match=png.headers["ETag"])
    assert npy.status_code == 200
    assert npy.headers["ETag"] != png.headers["ETag"]


def test_a_job_that_the_client_has_is_not_sent_again(server, done):
    tag = get(server, done).headers["ETag"]
    assert tag == f'"{done["version"]}"'
    again = get(server, done, If_None_Match=f"W/{tag}")
    assert (again.status_code, again.content) == (304, b"")
    assert get(server, done, If_None_Match='"0"').json() == done


def test_a_long_poll_answers_when_the_job_changes(server, endless, in_background):
    known = get(server, endless).headers["ETag"]
    polled = in_background(get, server, endless, Prefer="wait=30", If_None_Match=known)
    httpx.post(url(server, endless, "/cancel"))
    assert polled().status_code == 200
    assert polled().headers["Preference-Applied"] == "wait=30"
    assert polled().json()["version"] > int(known.strip('"'))


def test_a_long_poll_ends_without_a_change(serving, submit, occupy):
    with serving(work_limit_s=6) as server:
        occupy(server)
        job = submit(server).json()
        for known, status in ({"If_None_Match": f'"{job["version"]}"'}, 304), ({}, 200):
            answer = get(server, job, Prefer="wait=1", **known)
            assert answer.status_code == status
            assert answer.elapsed.total_seconds() >= 1
            assert answer.headers["Preference-Applied"] == "wait=1"


def test_a_long_poll_of_what_the_client_does_not_know_answers_at_once(server, done, endless):
    assert get(server, endless, timeout=5, Prefer="wait=60", If_None_Match='"0"').status_code == 200
    assert get(server, done, timeout=5, Prefer="wait=60").status_code == 200
    assert get(server, done, timeout=5, Prefer="wait=60", If_None_Match="*").status_code == 304


def events(server, job, **headers):
    headers = {name.replace("_", "-"): value for name, value in headers.items()}
    with httpx.stream("GET", url(server, job, "/events"), headers=headers, timeout=60) as stream:
        assert stream.status_code == 200
        return [event for event in httpx_sse.EventSource(stream).iter_sse() if event.data]


def test_events_tell_of_a_job_from_its_start_to_its_end(server, submit):
    job = submit(server).json()
    found = events(server, job)
    states = [json.loads(event.data)["state"] for event in found if event.event == "state"]
    assert states in (["queued", "running", "succeeded"], ["running", "succeeded"], ["succeeded"])
    assert {event.event for event in found} <= {"state", "progress"}
    ids = [int(event.id) for event in found]
    assert ids == sorted(set(ids))
    assert json.loads(found[-1].data) == get(server, job).json()


def test_events_resume_after_what_was_seen_and_then_there_are_no_more(server, done):
    (last,) = events(server, done, Last_Event_ID=str(done["version"] - 1))
    assert last.id == str(done["version"])
    end = get(server, done, "/events", Last_Event_ID=last.id)
    assert (end.status_code, end.content) == (204, b"")
    for odd in ("", "-1", "x", "9" * 400):
        assert len(events(server, done, Last_Event_ID=odd)) == 1


def test_events_come_while_the_job_runs_and_end_when_it_is_deleted(server, endless):
    with httpx.stream("GET", url(server, endless, "/events"), timeout=30) as stream:
        assert stream.headers["Content-Type"].startswith("text/event-stream")
        lines = stream.iter_lines()
        assert "event: state" in (next(lines) for _ in range(9))
        httpx.delete(url(server, endless))
        for _ in lines:
            pass


def test_a_job_that_waits_is_cancelled_at_once(server, endless, submit, is_problem):
    job = submit(server).json()
    answer = httpx.post(url(server, job, "/cancel"))
    assert (answer.status_code, answer.json()["state"]) == (200, "cancelled")
    assert httpx.post(url(server, job, "/cancel")).status_code == 200
    is_problem(get(server, job, "/result"), 409, "job-cancelled")


def test_a_job_that_runs_is_cancelled_soon(server, endless, eventually):
    answer = httpx.post(url(server, endless, "/cancel"))
    assert answer.status_code == 200
    assert answer.json()["cancel_requested"] or answer.json()["state"] == "cancelled"
    eventually(lambda: get(server, endless).json()["state"] == "cancelled")


def test_a_job_that_has_ended_cannot_be_cancelled(server, done, is_problem):
    is_problem(httpx.post(url(server, done, "/cancel")), 409, "job-finished")


def test_a_deleted_job_is_gone(server, done, is_problem):
    assert httpx.delete(url(server, done)).status_code == 204
    for end in ("", "/result", "/events"):
        is_problem(get(server, done, end), 404, "job-not-found")
    is_problem(httpx.delete(url(server, done)), 404, "job-not-found")
    is_problem(httpx.post(url(server, done, "/cancel")), 404, "job-not-found")


@pytest.mark.parametrize("job_id", [UNKNOWN, "0", "%00", "a" * 4000, "%ff", "0" * 31 + "G", UNKNOWN + "%0a"])
def test_an_unknown_job_is_not_found(server, is_problem, job_id):
    is_problem(httpx.get(f"{server.url}/v1/jobs/{job_id}"), 404, "job-not-found")


def test_there_is_no_result_before_the_end(server, endless, is_problem):
    is_problem(get(server, endless, "/result"), 409, "job-not-finished")


def test_a_job_that_fails_says_why(server, submit, finished, as_npy, is_problem):
    job = finished(server, submit(server, disparity=as_npy(np.full((48, 64), np.nan, np.float32))))
    assert job["state"] == "failed"
    assert job["error"]["type"] == "/problems/no-valid-disparity"
    assert "no finite value" in is_problem(get(server, job, "/result"), 409, "job-failed")["detail"]


def test_a_result_that_was_kept_long_enough_is_gone(serving, submit, finished, eventually, is_problem):
    with serving(result_ttl_s=0.5) as server:
        job = finished(server, submit(server))
        eventually(lambda: get(server, job, "/result").status_code == 410)
        is_problem(get(server, job, "/result"), 410, "result-expired")


def test_a_deadline_that_passes_while_the_job_waits_fails_it(serving, submit, occupy, finished):
    with serving(work_limit_s=8) as server:
        occupy(server)
        job = finished(server, submit(server, params=QUICK | {"deadline_s": 0.2}))
        assert job["error"]["type"] == "/problems/deadline-exceeded"


def test_jobs_are_listed_newest_first_page_by_page(serving, submit, finished):
    with serving() as server:
        sent = [finished(server, submit(server))["id"] for _ in range(5)][::-1]
        found, cursor = [], {}
        while cursor is not None:
            page = httpx.get(f"{server.url}/v1/jobs", params={"limit": 2} | cursor).json()
            found += [job["id"] for job in page["jobs"]]
            cursor = page["next_cursor"] and {"cursor": page["next_cursor"]}
        assert found == sent
        states = {
            state: len(httpx.get(f"{server.url}/v1/jobs", params={"state": state}).json()["jobs"])
            for state in ("succeeded", "queued")
        }
        assert states == {"succeeded": 5, "queued": 0}


@pytest.mark.parametrize(
    ("query", "named"),
    [
        ("limit=0", "limit"),
        ("limit=201", "limit"),
        ("limit=x", "limit"),
        ("state=done", "state"),
        ("cursor=x", "cursor"),
        ("cursor=%00", "cursor"),
    ],
)
def test_a_wrong_query_is_named(server, is_problem, query, named):
    answer = httpx.get(f"{server.url}/v1/jobs?{query}")
    assert named in is_problem(answer, 422, "invalid-parameter")["detail"]


def test_a_key_makes_of_two_requests_one_job(server, submit, finished):
    first = submit(server, key="frame-1")
    again = submit(server, key="frame-1")
    assert again.json()["id"] == first.json()["id"]
    assert again.headers["Idempotency-Replayed"] == "true"
    done = finished(server, first)
    replay = submit(server, key="frame-1")
    assert replay.status_code == 200
    assert replay.json() == done
    assert submit(server, key="frame-2").json()["id"] != done["id"]


def test_a_key_is_not_for_other_files_or_parameters(server, submit, scene, is_problem):
    submit(server, key="frame-3")
    is_problem(submit(server, key="frame-3", params=QUICK | {"preset": "paper"}), 422, "idempotency-mismatch")
    is_problem(submit(server, key="frame-3", disparity=None), 422, "idempotency-mismatch")


def test_many_requests_with_one_key_at_once_are_one_job(server, submit):
    answers = []
    threads = [
        threading.Thread(target=lambda: answers.append(submit(server, key="frame-4"))) for _ in range(6)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    accepted = [answer.json()["id"] for answer in answers if answer.is_success]
    refused = [answer for answer in answers if not answer.is_success]
    assert len(set(accepted)) == 1
    assert all(answer.json()["type"] == "/problems/idempotency-in-flight" for answer in refused)
    assert all(answer.status_code == 409 and int(answer.headers["Retry-After"]) >= 1 for answer in refused)


def test_a_key_that_is_none_is_malformed(server, submit, is_problem):
    is_problem(submit(server, key="two words"), 400, "malformed-request")


@pytest.mark.parametrize(
    ("change", "status", "slug"),
    [
        ({"left": None}, 400, "malformed-request"),
        ({"left": b"text"}, 415, "unknown-format"),
        ({"left": b""}, 422, "damaged-file"),
        ({"params": {"priority": 1000}}, 422, "invalid-parameter"),
        ({"params": {"deadline_s": -1}}, 422, "invalid-parameter"),
        ({"params": {"gdr": {"wraps": 1}}}, 422, "invalid-parameter"),
    ],
)
def test_what_can_be_refused_at_once_is(server, submit, is_problem, change, status, slug):
    is_problem(submit(server, **change), status, slug)


def test_a_full_queue_refuses_and_says_when_to_come_again(serving, submit, occupy, is_problem):
    with serving(max_queued_jobs=2, work_limit_s=8) as server:
        occupy(server)
        answers = [submit(server) for _ in range(3)]
        is_problem(answers[-1], 429, "queue-full")
        assert int(answers[-1].headers["Retry-After"]) >= 1


def test_jobs_of_one_key_are_hidden_from_others(serving, submit, finished, is_problem):
    with serving(api_keys="first, second") as server:
        first, second = ({"Authorization": f"Bearer {key}"} for key in ("first", "second"))
        job = finished(server, submit(server, headers=first), first)
        for end in ("", "/result", "/events"):
            is_problem(httpx.get(url(server, job, end), headers=second), 404, "job-not-found")
        is_problem(httpx.post(url(server, job, "/cancel"), headers=second), 404, "job-not-found")
        is_problem(httpx.delete(url(server, job), headers=second), 404, "job-not-found")
        assert httpx.get(f"{server.url}/v1/jobs", headers=second).json()["jobs"] == []
        assert len(httpx.get(f"{server.url}/v1/jobs", headers=first).json()["jobs"]) == 1


@pytest.mark.parametrize(
    ("method", "path"),
    [("PUT", "/v1/jobs"), ("PATCH", f"/v1/jobs/{UNKNOWN}"), ("GET", f"/v1/jobs/{UNKNOWN}/cancel")],
)
def test_a_wrong_method_is_a_problem_document(server, is_problem, method, path):
    answer = httpx.request(method, server.url + path)
    is_problem(answer, 405, "not-found")
    assert answer.headers["Allow"]
