"""The client that waits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import TracebackType
from typing import Any, Self

import httpx

from stereomend.client import job_messages, messages
from stereomend.client.jobs import Job
from stereomend.client.links import Link
from stereomend.client.messages import Connection, File, Inputs
from stereomend.client.patience import RESTART_S, Patience
from stereomend.disparity import RefinementResult


class Client:
    """Asks a server at `base_url`; a context manager, since it keeps connections open.

    Args:
        base_url: such as `http://127.0.0.1:8000`.
        api_key: needed where the server has keys.
        timeout: seconds to wait for one answer.
    """

    def __init__(self, base_url: str, api_key: str | None = None, timeout: float = 330.0) -> None:
        self._link = Link(Connection(base_url, api_key, timeout))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close all connections."""
        self._link.close()

    def refine(
        self,
        left: File,
        right: File,
        disparity: File | None = None,
        *,
        mask: File | None = None,
        **params: object,
    ) -> RefinementResult:
        """Refine a disparity map and wait for the result.

        Args:
            left: uint8 or uint16, (H, W) or (H, W, 3) RGB, rectified; or a file in a format that is read.
            right: as `left`.
            disparity: (H, W) px, of the left image; not finite or <= 0 is unknown. None: matched by SGBM.
            mask: bool or integers, (H, W); 0 is not part of the scene. None: all is.
            **params: `preset`, `stages`, `initial`, `focal_px`, `ldr={...}`, `gdr={...}` and the others of
                `presets()`; those that are None count as not given.

        Returns:
            The maps, each (H, W); `timings` in ms with the keys of `Server-Timing`.

        Raises:
            InputError: the server refuses the input; the subclass says why.
            AccessDenied: the API key is missing or wrong.
            Unavailable: the server cannot do it now, after `ATTEMPTS` attempts where a repetition is safe.
        """
        messages.check_whole(params)
        return messages.read_result(self._refine(Inputs(left, right, disparity, mask, params)))

    def refine_bytes(  # noqa: PLR0913 - the arguments of `refine`, and in which form to answer
        self,
        left: File,
        right: File,
        disparity: File | None = None,
        params: Mapping[str, object] | None = None,
        accept: str = messages.ZIP,
        *,
        mask: File | None = None,
    ) -> tuple[bytes, Mapping[str, str]]:
        """Refine, and give the answer's body and headers as they came, in the media type `accept`.

        Other arguments and errors as `refine`.
        """
        response = self._refine(Inputs(left, right, disparity, mask, params or {}), accept)
        return response.content, response.headers

    def submit(
        self,
        left: File,
        right: File,
        disparity: File | None = None,
        *,
        mask: File | None = None,
        idempotency_key: str | None = None,
        **params: object,
    ) -> Job:
        """Let a disparity map be refined later; when this returns, the server will not lose it.

        Args:
            left, right, disparity, mask: as of `refine`.
            idempotency_key: what is submitted again with the same key is the same job. None: a new one.
            **params: as of `refine`, and `priority` (larger ones run first), `deadline_s` (to begin within)
                and `keep_inputs`.

        Raises:
            InputError, AccessDenied, Unavailable: as `refine`.
            IdempotencyMismatch: the key was used with other files or parameters.
        """
        messages.check_whole(params)
        inputs = Inputs(left, right, disparity, mask, params)
        # Safe to repeat, as it has a key.
        response = self._link.ask(job_messages.submission(inputs, idempotency_key), Patience(RESTART_S))
        return Job(self._link, job_messages.status_of(response))

    def job(self, job_id: str) -> Job:
        """The job of this id, submitted by whomever with the same key (raises JobNotFound)."""
        response = self._link.ask(job_messages.look(job_id), Patience(RESTART_S))
        return Job(self._link, job_messages.status_of(response))

    def jobs(self, state: str | None = None) -> Iterator[Job]:
        """All jobs of this key, or those in one state, the newest first."""
        cursor = None
        while True:
            response = self._link.ask(job_messages.page(state, cursor), Patience(RESTART_S))
            found, cursor = job_messages.read_page(response)
            yield from (Job(self._link, status) for status in found)
            if cursor is None:
                return

    def presets(self) -> dict[str, Any]:
        """The presets, `{default, presets: {name: {description, params}}, schema}`; raises as `refine`."""
        return messages.read_document(self._link.ask(messages.document(messages.PRESETS)))

    def health(self) -> dict[str, Any]:
        """Whether the server answers (raises NotReady if it cannot be reached)."""
        return messages.read_document(self._link.ask(messages.document(messages.ALIVE)))

    def ready(self) -> dict[str, Any]:
        """Which backend computes on the server, and why (raises NotReady while no worker is up)."""
        return messages.read_document(self._link.ask(messages.document(messages.READY)))

    def _refine(self, inputs: Inputs, accept: str = messages.ZIP) -> httpx.Response:
        # To repeat it is safe, since it leaves nothing behind.
        return self._link.ask(messages.refinement(inputs, accept), Patience())
