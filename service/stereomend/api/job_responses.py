"""Jobs as answers."""

from __future__ import annotations

from collections.abc import Mapping

from starlette.responses import Response

from stereomend.api.job_documents import job_document, job_path
from stereomend.jobs.ledger import Accepted
from stereomend.jobs.records import JobRecord


def etag_of_job(record: JobRecord) -> str:
    """The entity tag of a job: its version."""
    return f'"{record.version}"'


def job_response(record: JobRecord, status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    """Answer with a job."""
    headers = {"ETag": etag_of_job(record), **(headers or {})}
    return Response(job_document(record).model_dump_json(), status, headers, "application/json")


def accepted_response(accepted: Accepted, headers: Mapping[str, str] | None = None) -> Response:
    """Answer that a job is accepted: 202, or 200 where it was before and has ended."""
    record = accepted.record
    headers = {"Location": job_path(record.id), **(headers or {})}
    if accepted.replayed:
        headers["Idempotency-Replayed"] = "true"
    return job_response(record, 200 if record.state.final else 202, headers)
