"""The client that waits."""

from __future__ import annotations

import time
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

import httpx

from stereomend.client import messages
from stereomend.client.messages import Connection, File, Inputs
from stereomend.client.patience import Patience
from stereomend.disparity import RefinementResult
from stereomend.errors import Unavailable


class Client:
    """Asks a server at `base_url`; a context manager, since it keeps connections open.

    Args:
        base_url: such as `http://127.0.0.1:8000`.
        api_key: needed where the server has keys.
        timeout: seconds to wait for one answer.
    """

    def __init__(self, base_url: str, api_key: str | None = None, timeout: float = 330.0) -> None:
        self._http = httpx.Client(**Connection(base_url, api_key, timeout).options())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close all connections."""
        self._http.close()

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
        return messages.read_result(self._refine(Inputs(left, right, disparity, mask, params), messages.ZIP))

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

    def presets(self) -> dict[str, Any]:
        """The presets, `{default, presets: {name: {description, params}}, schema}`; raises as `refine`."""
        return messages.read_document(self._send(messages.document(messages.PRESETS)))

    def health(self) -> dict[str, Any]:
        """Whether the server answers (raises NotReady if it cannot be reached)."""
        return messages.read_document(self._send(messages.document(messages.ALIVE)))

    def ready(self) -> dict[str, Any]:
        """Which backend computes on the server, and why (raises NotReady while no worker is up)."""
        return messages.read_document(self._send(messages.document(messages.READY)))

    def _refine(self, inputs: Inputs, accept: str) -> httpx.Response:
        request, patience = messages.refinement(inputs, accept), Patience()
        while True:
            try:
                return self._send(request)
            except Unavailable as error:
                pause = patience.pause_after(error)
            time.sleep(pause)

    def _send(self, request: dict[str, Any]) -> httpx.Response:
        with messages.reaching(self._http.base_url):
            response = self._http.request(**request)
        return messages.accepted(response)
