"""The SDK: refinements by a server, over HTTP. `Client` waits, `AsyncClient` is awaited."""

from stereomend.client.aio import AsyncClient
from stereomend.client.job_messages import JobStatus
from stereomend.client.jobs import AsyncJob, Job
from stereomend.client.messages import File
from stereomend.client.patience import ATTEMPTS, LONGEST_WAIT_S
from stereomend.client.sync import Client

__all__ = ["ATTEMPTS", "LONGEST_WAIT_S", "AsyncClient", "AsyncJob", "Client", "File", "Job", "JobStatus"]
