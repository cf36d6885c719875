"""What a ledger has to do, in plain Python: the oracle of the stateful test."""

from dataclasses import dataclass

LIVE = ("queued", "running")
MOST_CRASHES, MOST_JOBS, MOST_OF_OWNER, MOST_BYTES, FREE = 3, 6, 4, 60, 100


@dataclass
class Job:
    id: str
    owner: str
    body: str
    key: str | None
    priority: int
    keep: bool
    held: int
    reserved: int
    created: float
    deadline: float | None
    state: str = "queued"
    attempt: int = 0
    crashes: int = 0
    cancel: bool = False
    lease: float = 0
    not_before: float = 0
    started: float | None = None
    finished: float | None = None
    expires: float | None = None
    result: str | None = None
    error: str | None = None
    progress: tuple = ("queue", 0, 0)

    def wait(self, not_before=0):
        self.state, self.started, self.not_before = "queued", None, not_before
        self.progress = ("queue", 0, 0)

    def end(self, state, now, error=None):
        self.state, self.finished, self.error, self.reserved = state, now, error, 0
        if not self.keep:
            self.held = 0

    def start(self, now, lease):
        self.state, self.started, self.lease = "running", now, now + lease
        self.attempt += 1
        self.progress = ("decode", 0, 0)

    def crash(self, now):
        self.crashes += 1
        if self.cancel:
            self.end("cancelled", now)
        elif self.crashes == MOST_CRASHES:
            self.end("failed", now, "poison-job")
        else:
            self.wait()

    def blobs(self):
        inputs = {f"inputs/{self.id}"} if self.state in LIVE or self.keep else set()
        coming = {f"results/{self.id}.{self.attempt}"} if self.state == "running" else set()
        return inputs | coming | ({self.result} if self.result else set())


class Model:
    """All jobs, and a time in seconds."""

    def __init__(self):
        self.jobs = {}
        self.now = 0.0

    def refusal(self, new):
        """Why a job would be refused; the job of the same key; or None."""
        for job in self.jobs.values():
            if new.key is not None and (job.owner, job.key) == (new.owner, new.key):
                return job if job.body == new.body else "idempotency-mismatch"
        live = self.live()
        if sum(job.owner == new.owner for job in live) >= MOST_OF_OWNER:
            return "quota-exceeded"
        if len(live) >= MOST_JOBS or (live and sum(job.held for job in live) + new.held > MOST_BYTES):
            return "queue-full"
        return "disk-full" if sum(job.reserved for job in live) + new.reserved > FREE else None

    def live(self):
        return [job for job in self.jobs.values() if job.state in LIVE]

    def next(self):
        """The job to be claimed."""
        now = self.now
        ready = [
            job
            for job in self.jobs.values()
            if job.state == "queued"
            and job.not_before <= now
            and (job.deadline is None or now < job.deadline)
        ]
        return min(ready, key=lambda job: (-job.priority, job.created, job.id), default=None)

    def holder(self, claim):
        """The job of a claim that is not lost."""
        job = self.jobs.get(claim.id)
        return job if job and job.state == "running" and job.attempt == claim.attempt else None

    def reap(self):
        queued, ended = set(), set()
        for job in self.jobs.values():
            if job.state == "running" and job.lease < self.now:
                job.crash(self.now)
                (queued if job.state == "queued" else ended).add(job.id)
        for job in self.jobs.values():
            if job.state == "queued" and job.deadline is not None and job.deadline <= self.now:
                job.end("failed", self.now, "deadline-exceeded")
                queued.discard(job.id)
                ended.add(job.id)
        return queued, ended

    def expire(self, record_ttl):
        names = set()
        for job in list(self.jobs.values()):
            if job.state == "succeeded" and job.expires <= self.now:
                names.add(job.result)
                job.state, job.result = "expired", None
            if job.finished is not None and job.finished + record_ttl <= self.now:
                names |= self.jobs.pop(job.id).blobs()
        return names
