"""Whose request it is, as the gate says."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request

ADMIN = "admin"
"""The scope that sees the jobs of all keys."""
_LOCAL = "local"


async def _owner(request: Request) -> str:
    # Not async, it would be handed to a thread.
    owner: str = getattr(request.state, "owner", _LOCAL)
    return owner


async def _viewer(request: Request) -> str | None:
    return None if ADMIN in getattr(request.state, "scopes", ()) else await _owner(request)


Owner = Annotated[str, Depends(_owner)]
"""The id of the key; `local` where there are none."""
Viewer = Annotated[str | None, Depends(_viewer)]
"""Whose jobs are seen; None: everybody's."""
