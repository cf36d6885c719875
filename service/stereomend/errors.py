"""Everything that Stereomend raises on purpose.

StereomendError
|- InputError                what was sent cannot be used; another input would do
|  |- MalformedRequest       the request is not multipart, lacks a part or has an unknown one
|  |- UnknownFormat          a file is in no format that is read here, or holds the wrong type
|  |- DamagedFile            a file is truncated or corrupt
|  |- BodyTooLarge           the request has more bytes than the server takes
|  |- TooManyPixels          an image has more pixels than the server takes
|  |- InvalidParameter       a parameter is unknown, of the wrong type or out of range, or a mask all 0
|  |- ShapeMismatch          left, right, disparity and mask do not have the same height and width
|  |- NoValidDisparity       the disparity map has no valid pixel
|  |- DisparityOutOfRange    a result does not fit the format that was asked for
|  |- NotAcceptable          no media type in `Accept` is offered
|  |- NotFound               no such route, or not with this method
|  |  `- JobNotFound         no such job, or it belongs to another key, or its record is gone
|  |- ResultExpired          the job's result was deleted after its time
|  |- IdempotencyMismatch    the idempotency key was used with another body
|  `- Conflict               the state of things does not allow it
|     |- IdempotencyInFlight a request with the same idempotency key is still being taken in
|     |- JobFinished         a finished job cannot be cancelled
|     |- JobNotFinished      a job has no result yet
|     |- JobFailed           a job ended without a result
|     `- JobCancelled        a job was cancelled, before it had a result
|- AccessDenied              the API key is missing or wrong
|  `- Forbidden              the API key may not do this, or a web page of another origin asks
|- Unavailable               the same request may do later
|  |- QueueFull              more requests wait than the server holds
|  |  `- QuotaExceeded       more jobs of this key wait or run than it may have
|  |- DiskFull               there is no room on the disk to keep what was sent, or its result
|  |- NotReady               no worker is up, or the server cannot be reached
|  |- WorkerCrashed          the worker process died while it worked on this request
|  |  `- DeviceFault         the GPU failed; the worker ends and another takes its place
|  |- DeadlineExceeded       the work was not done by its deadline
|  |- WorkLimitExceeded      the work took longer or needed more memory than the server allows
|  `- InternalError          a fault of the server's own
`- ConfigurationError        this process cannot start as it was told to
   |- BackendUnavailable     the backend asked for does not work on this machine
   `- OutdatedLedger         the ledger has an older schema, and was only to be looked at
"""


class StereomendError(Exception):
    """The root of all errors raised here; its message says what came and what was expected."""

    slug = "error"
    title = "Error"
    status: int | None = None
    """The HTTP status, where a server answered with this error."""
    request_id: str | None = None
    """The server's name for the request, where a server answered with this error."""
    retry_after: float | None = None
    """Seconds after which the same request may do, where known."""


class InputError(StereomendError):
    """Raised when what was sent cannot be used."""

    slug = "invalid-input"
    title = "Invalid input"


class MalformedRequest(InputError):
    """Raised when a request is not multipart, lacks a part or has an unknown one."""

    slug = "malformed-request"
    title = "Malformed request"


class UnknownFormat(InputError):
    """Raised when a file is in no format that is read here, or holds the wrong type."""

    slug = "unknown-format"
    title = "Unknown format"


class DamagedFile(InputError):
    """Raised when a file is truncated or corrupt."""

    slug = "damaged-file"
    title = "Damaged file"


class BodyTooLarge(InputError):
    """Raised when a request has more bytes than the server takes."""

    slug = "body-too-large"
    title = "Body too large"


class TooManyPixels(InputError):
    """Raised when an image has more pixels than the server takes."""

    slug = "too-many-pixels"
    title = "Too many pixels"


class InvalidParameter(InputError):
    """Raised when a parameter is unknown, of the wrong type or out of range, or a mask 0 everywhere."""

    slug = "invalid-parameter"
    title = "Invalid parameter"


class ShapeMismatch(InputError):
    """Raised when left, right, disparity and mask do not have the same height and width."""

    slug = "shape-mismatch"
    title = "Shapes do not match"


class NoValidDisparity(InputError):
    """Raised when a disparity map has no finite value above zero."""

    slug = "no-valid-disparity"
    title = "No valid disparity"


class DisparityOutOfRange(InputError):
    """Raised when a result does not fit the format that was asked for."""

    slug = "disparity-out-of-range"
    title = "Disparity out of range"


class NotAcceptable(InputError):
    """Raised when no media type in `Accept` is offered."""

    slug = "not-acceptable"
    title = "Not acceptable"


class NotFound(InputError):
    """Raised when there is no such route, or not with this method."""

    slug = "not-found"
    title = "Not found"


class JobNotFound(NotFound):
    """Raised when there is no such job, it belongs to another key, or its record is gone."""

    slug = "job-not-found"
    title = "Job not found"


class ResultExpired(InputError):
    """Raised when a job's result was deleted after its time."""

    slug = "result-expired"
    title = "Result expired"


class IdempotencyMismatch(InputError):
    """Raised when an idempotency key was used with another body."""

    slug = "idempotency-mismatch"
    title = "Idempotency key used with another body"


class Conflict(InputError):
    """Raised when the state of things does not allow what was asked for."""

    slug = "conflict"
    title = "Conflict"


class IdempotencyInFlight(Conflict):
    """Raised when a request with the same idempotency key is still being taken in."""

    slug = "idempotency-in-flight"
    title = "Same idempotency key in flight"


class JobFinished(Conflict):
    """Raised when a finished job is to be cancelled."""

    slug = "job-finished"
    title = "Job is finished"


class JobNotFinished(Conflict):
    """Raised when the result of a job is asked for that has none yet."""

    slug = "job-not-finished"
    title = "Job is not finished"


class JobFailed(Conflict):
    """Raised when the result of a job is asked for that ended without one."""

    slug = "job-failed"
    title = "Job failed"


class JobCancelled(Conflict):
    """Raised when a job was cancelled before it had a result."""

    slug = "job-cancelled"
    title = "Job cancelled"


class AccessDenied(StereomendError):
    """Raised when the API key is missing or wrong."""

    slug = "unauthorized"
    title = "Unauthorized"


class Forbidden(AccessDenied):
    """Raised when a key lacks the scope, or a web page of another host or origin asks."""

    slug = "forbidden"
    title = "Forbidden"


class Unavailable(StereomendError):
    """Raised when the same request may do later."""

    slug = "unavailable"
    title = "Unavailable"


class QueueFull(Unavailable):
    """Raised when more requests wait than the server holds."""

    slug = "queue-full"
    title = "Queue full"


class QuotaExceeded(QueueFull):
    """Raised when more jobs of a key wait or run than it may have."""

    slug = "quota-exceeded"
    title = "Quota exceeded"


class DiskFull(Unavailable):
    """Raised when there is no room on the disk to keep what was sent, or its result."""

    slug = "disk-full"
    title = "Disk full"


class NotReady(Unavailable):
    """Raised when no worker is up, or the server cannot be reached."""

    slug = "not-ready"
    title = "Not ready"


class WorkerCrashed(Unavailable):
    """Raised when the worker process died while it worked on this request."""

    slug = "worker-crashed"
    title = "Worker crashed"


class DeviceFault(WorkerCrashed):
    """Raised when the GPU failed; the worker ends and another takes its place."""

    slug = "device-fault"
    title = "Device fault"


class DeadlineExceeded(Unavailable):
    """Raised when work was not done by its deadline."""

    slug = "deadline-exceeded"
    title = "Deadline exceeded"


class WorkLimitExceeded(Unavailable):
    """Raised when the work took longer or needed more memory than the server allows."""

    slug = "work-limit-exceeded"
    title = "Work limit exceeded"


class InternalError(Unavailable):
    """Raised when the server is at fault; the log has the details under the request's id."""

    slug = "internal-error"
    title = "Internal error"


class ConfigurationError(StereomendError):
    """Raised when this process cannot start as it was told to."""

    slug = "configuration-error"
    title = "Configuration error"


class BackendUnavailable(ConfigurationError):
    """Raised when the backend asked for does not work on this machine."""

    slug = "backend-unavailable"
    title = "Backend unavailable"


class OutdatedLedger(ConfigurationError):
    """Raised when a ledger has an older schema, and was only to be looked at."""

    slug = "outdated-ledger"
    title = "Outdated ledger"


def error_from_slug(slug: str, detail: str) -> StereomendError:
    """Build the error that a problem document or a worker names; an unknown slug gives the root class."""
    classes = [StereomendError]
    for known in classes:
        classes.extend(known.__subclasses__())
    return next((known for known in classes if known.slug == slug), StereomendError)(detail)
