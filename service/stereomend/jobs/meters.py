"""What is counted and measured, in the server's process only: workers tell it by their answers."""

from __future__ import annotations

from dataclasses import dataclass

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

from stereomend.errors import DeviceFault, StereomendError
from stereomend.jobs.listener import Listener
from stereomend.jobs.records import JobState
from stereomend.jobs.task import TIMINGS, Answer, Task

_STAGE_BUCKETS_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60, 300)
_REQUEST_BUCKETS_S = (0.005, 0.025, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60, 300)
_FINAL = tuple(state for state in JobState if state.final)


@dataclass(frozen=True)
class Figures:
    """What is now. Kinds: `refine`, waited for in memory, and `job`, durable."""

    workers_up: int
    queued: dict[str, int]
    """Tasks that wait for a worker, by kind."""
    running: dict[str, int]
    oldest_queued_s: float
    """How long the oldest of all that wait has waited [s]; 0 where nothing waits."""
    free_disk_bytes: int
    """On the disk of the data folder."""
    blob_bytes: int
    """Of all inputs and results that are kept."""


class Meters(Listener):
    """Counters, histograms and gauges of one server, in a registry of their own."""

    def __init__(self) -> None:
        self._registry = CollectorRegistry()
        self._counted = _Counted(self._registry)
        self._gauges = _Gauges(self._registry)

    def answered(self, task: Task, outcome: Answer | StereomendError) -> None:
        """Count what a worker made of a task, and the stages that ran."""
        if isinstance(outcome, DeviceFault):
            self._counted.device_faults.inc()
        if isinstance(outcome, Answer):
            for stage in TIMINGS:
                if outcome.timings[stage] > 0:
                    self._counted.stages.labels(stage).observe(outcome.timings[stage] / 1e3)

    def worker_ended(self) -> None:
        """Count a worker that is replaced."""
        self._counted.restarts.inc()

    def job_ended(self, state: JobState) -> None:
        """Count a durable job by the state that it ended in."""
        self._counted.outcomes.labels(state).inc()

    def count_request(self, labels: tuple[str, str, int], seconds: float) -> None:
        """Count an answer by its method, route and status, each of a bounded number."""
        self._counted.requests.labels(*labels).observe(seconds)

    def count_refusal(self, slug: str) -> None:
        """Count a request that was answered with a problem document."""
        self._counted.refusals.labels(slug).inc()

    def text(self, figures: Figures) -> bytes:
        """All that was counted, and what is now, in Prometheus' text format."""
        self._gauges.set(figures)
        return generate_latest(self._registry)


class _Counted:
    def __init__(self, registry: CollectorRegistry) -> None:
        def counter(name: str, meaning: str, *labels: str) -> Counter:
            return Counter(f"stereomend_{name}", meaning, labels, registry=registry)

        self.refusals = counter("refusals", "Requests answered with a problem document", "slug")
        self.restarts = counter("worker_restarts", "Workers that ended while the server ran")
        self.device_faults = counter("device_faults", "Refinements that ended with a fault of the GPU")
        self.outcomes = counter("job_outcomes", "Durable jobs by the state that they ended in", "state")
        for state in _FINAL:
            self.outcomes.labels(state)
        self.stages = Histogram(
            "stereomend_stage_seconds",
            "Time of each stage of the refinements that were answered, stages that did not run left out",
            ["stage"],
            buckets=_STAGE_BUCKETS_S,
            registry=registry,
        )
        self.requests = Histogram(
            "stereomend_request_seconds",
            "Time from the headers of a request to the end of its answer",
            ["method", "route", "status"],
            buckets=_REQUEST_BUCKETS_S,
            registry=registry,
        )


class _Gauges:
    def __init__(self, registry: CollectorRegistry) -> None:
        def gauge(name: str, meaning: str, *labels: str) -> Gauge:
            return Gauge(f"stereomend_{name}", meaning, labels, registry=registry)

        self._workers_up = gauge("workers_up", "Workers that are ready or at work")
        self._queued = gauge("queue_depth", "Refinements that wait for a worker", "kind")
        self._running = gauge("running", "Refinements that workers compute", "kind")
        self._oldest = gauge("oldest_queued_seconds", "How long the oldest that waits has waited")
        self._blobs = gauge("blob_bytes", "Bytes of inputs and results that are kept")
        self._free = gauge("free_disk_bytes", "Free bytes on the disk of the data folder")

    def set(self, figures: Figures) -> None:
        self._workers_up.set(figures.workers_up)
        self._oldest.set(figures.oldest_queued_s)
        self._blobs.set(figures.blob_bytes)
        self._free.set(figures.free_disk_bytes)
        for gauge, values in ((self._queued, figures.queued), (self._running, figures.running)):
            for kind, value in values.items():
                gauge.labels(kind).set(value)
