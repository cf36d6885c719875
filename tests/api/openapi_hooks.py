"""What Schemathesis sends: mostly sound images of one size, damaged files, and bytes of no format.

It loads this module itself, in a process of its own.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import schemathesis
from hypothesis import strategies as st
from trials.mutations import make_mutant
from trials.originals import FORMATS, HEIGHT, WIDTH, originals


def files(size: tuple[int, int] | None = None) -> list[bytes]:
    """Sound files; with a size (height, width) only images of it."""
    found = [(format, original) for format in FORMATS for original in originals(format)]
    return [
        original.data
        for format, original in found
        if size is None or (format.part == "image" and original.shape == size)
    ]


def damaged(place: int, number: int) -> bytes:
    """A mutant of the format at this place."""
    return make_mutant(FORMATS[place], number, 3).data


def flat_map() -> bytes:
    """A disparity map that fits the images of one size: without one, matching must find something."""
    file = io.BytesIO()
    np.save(file, np.full((HEIGHT, WIDTH), 2.5, np.float32))
    return file.getvalue()


fitting = st.sampled_from(files((HEIGHT, WIDTH)))
broken = st.builds(damaged, st.integers(0, len(FORMATS) - 1), st.integers(0, 999))
mixed = st.one_of(fitting, fitting, fitting, st.sampled_from(files()), broken, st.binary(max_size=200))
schemathesis.openapi.format("binary", mixed)


@schemathesis.hook
def map_body(context: Any, body: Any) -> Any:
    """Leave unknown parts out of some forms, of others all but three: few would be accepted as they are."""
    left = body.get("left") if isinstance(body, dict) else None
    if not hasattr(left, "data"):  # where their strings keep bytes
        return body
    if len(left.data) % 3 == 0:
        return body
    wanted = (
        ("left", "right", "disparity", "mask", "params") if len(left.data) % 3 == 1 else ("left", "right")
    )
    kept = {name: value for name, value in body.items() if name in wanted}
    return kept if len(wanted) > 2 else kept | {"disparity": type(left)(flat_map())}
