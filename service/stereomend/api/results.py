"""Results as answers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from starlette.responses import Response

from stereomend.jobs.task import TIMINGS, Answer

_ZIP = "application/zip"
_LONGEST_META = 4096


def result_response(answer: Answer, headers: Mapping[str, str]) -> Response:
    """Answer with a result, its timings, and, where it does not hold them itself, what is known about it."""
    timing = ", ".join(f"{name};dur={answer.timings.get(name, 0.0):.3f}" for name in TIMINGS)
    headers = {"Server-Timing": timing, **headers}
    if answer.media_type != _ZIP:
        headers["Stereomend-Meta"] = _meta(answer.meta)
    return Response(answer.body, media_type=answer.media_type, headers=headers)


def _meta(meta: Mapping[str, Any]) -> str:
    text = json.dumps(meta, separators=(",", ":"))
    if len(text) <= _LONGEST_META:
        return text
    # Proxies limit headers, and the client knows what it asked for.
    return (
        _meta({name: value for name, value in meta.items() if name != "params"}) if "params" in meta else text
    )
