"""Jobs as they are shown, without a server."""

import asyncio
import json
from dataclasses import replace
from datetime import UTC, datetime

import httpx_sse
import pytest

from stereomend.api.events import events_of
from stereomend.api.job_documents import job_document
from stereomend.jobs.records import JobRecord, JobState, Progress

NOON = datetime(2026, 1, 2, 12, tzinfo=UTC)
ID = "0123456789abcdef" * 2

RUNNING = JobRecord(
    id=ID,
    owner="local",
    state=JobState.RUNNING,
    version=3,
    preset="paper",
    params={"preset": "paper", "focal_px": None},
    input={"width": 64, "height": 48, "sha256": "ab"},
    priority=2,
    attempt=1,
    progress=Progress("gdr", 3, 40),
    cancel_requested=False,
    keep_inputs=False,
    request_id="frame-17",
    created_at=NOON,
    started_at=NOON,
)
SUCCEEDED = replace(RUNNING, state=JobState.SUCCEEDED, version=4, finished_at=NOON, result_sha256="cd")


def shown(record):
    return json.loads(job_document(record).model_dump_json())


def test_a_running_job_shows_its_progress_and_can_be_cancelled():
    job = shown(RUNNING)
    assert job["state"] == "running"
    assert job["progress"] == {"phase": "gdr", "done": 3, "total": 40}
    assert job["created_at"] == "2026-01-02T12:00:00Z"
    assert job["result"] is job["error"] is job["finished_at"] is None
    assert job["links"] == {
        "self": f"/v1/jobs/{ID}",
        "events": f"/v1/jobs/{ID}/events",
        "cancel": f"/v1/jobs/{ID}/cancel",
    }


def test_nothing_tells_whose_it_is_or_where_it_lies():
    assert not {"owner", "result_blob", "request_id"} & shown(SUCCEEDED).keys()


def test_a_succeeded_job_shows_where_its_result_is_and_in_what_forms():
    job = shown(SUCCEEDED)
    assert job["result"]["href"] == job["links"]["result"] == f"/v1/jobs/{ID}/result"
    assert job["result"]["sha256"] == "cd"
    assert "application/zip" in job["result"]["media_types"]
    assert "cancel" not in job["links"]


def test_a_point_cloud_is_offered_where_there_is_a_calibration():
    calibrated = replace(SUCCEEDED, params={"focal_px": 500.0})
    offered = [shown(record)["result"]["media_types"] for record in (SUCCEEDED, calibrated)]
    assert set(offered[1]) - set(offered[0]) == {"application/ply"}


def test_an_expired_job_has_no_result():
    assert shown(replace(SUCCEEDED, state=JobState.EXPIRED))["result"] is None


def test_a_failed_job_shows_a_problem():
    error = {"slug": "shape-mismatch", "detail": "right is 64 x 47"}
    job = shown(replace(RUNNING, state=JobState.FAILED, error=error))
    assert job["error"] == {
        "type": "/problems/shape-mismatch",
        "title": "Shapes do not match",
        "status": 422,
        "detail": "right is 64 x 47",
        "request_id": "frame-17",
    }


def events(records, seen=None):
    """The events of a job that becomes each of these records; None: nothing happens for a while."""
    coming = iter(records[1:])

    async def changed(known, _):
        return next(coming) or known

    async def read():
        return b"".join([piece async for piece in events_of(records[0], seen, changed)])

    text = asyncio.run(read()).decode()
    decoder = httpx_sse._decoders.SSEDecoder()
    found = [decoder.decode(line) for line in text.split("\n")]
    return [event for event in found if event and event.data], text


@pytest.fixture
def course():
    """The records of a job from its start to its end."""
    queued = replace(RUNNING, state=JobState.QUEUED, version=1, progress=Progress("queue"))
    begun = replace(RUNNING, version=2, progress=Progress("decode"))
    return [queued, begun, RUNNING, SUCCEEDED]


def test_each_change_is_an_event_until_the_job_has_ended(course):
    found, _ = events([*course, None])
    assert [(event.event, event.id) for event in found] == [
        ("state", "1"),
        ("state", "2"),
        ("progress", "3"),
        ("state", "4"),
    ]
    assert [json.loads(event.data) for event in found] == [shown(record) for record in course]


def test_silence_is_broken_by_comments(course):
    found, text = events([course[0], None, None, course[3]])
    assert [event.id for event in found] == ["1", "4"]
    assert text.count("\n: ") + text.startswith(": ") == 2


def test_who_comes_again_gets_what_is_new_only(course):
    found, _ = events(course[1:], seen=2)
    assert [event.id for event in found] == ["3", "4"]
    found, _ = events(course[1:], seen=1)
    assert [event.id for event in found] == ["2", "3", "4"]


def test_clients_are_told_when_to_come_again(course):
    _, text = events(course)
    assert text.startswith("retry: 1000\n\n")
