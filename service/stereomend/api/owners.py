"""Whose request it is, as the gate says."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request

from stereomend.jobs.keys import ADMIN

# Not async, these would be handed to a thread.


async def _owner(request: Request) -> str:
    owner: str = request.state.owner
    return owner


async def _viewer(request: Request) -> str | None:
    return None if ADMIN in request.state.scopes else await _owner(request)


Owner = Annotated[str, Depends(_owner)]
"""The id of the key; `local` where there are none."""
Viewer = Annotated[str | None, Depends(_viewer)]
"""Whose jobs are seen; None: everybody's."""
