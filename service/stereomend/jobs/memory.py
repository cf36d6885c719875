"""How this process treats the memory that it frees."""

from __future__ import annotations

import ctypes

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8  # of malloc.h
_KEPT_BYTES = 128 << 20
_LARGE_BYTES = 32 << 20


def keep_freed_memory() -> None:
    """Keep up to 128 MiB of freed memory, of blocks up to 32 MiB, for the next that is asked for.

    Planes and uploads of a few megabytes come and go. By default each goes back to the system when it is
    freed, and its pages are zeroed and mapped again for the next: a third of the time of small images. All
    threads share what is kept; call it before there are any.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):  # not every libc has it
        libc.mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
        libc.mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)
        libc.mallopt(_M_ARENA_MAX, 1)


def give_back_freed_memory() -> None:
    """Give what is kept to the system, some milliseconds.

    Now and then: what is kept lies in pieces between what is used, and the more pieces the more is kept.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "malloc_trim"):
        libc.malloc_trim(0)
