"""Mutants of sound files, each made again from a seed, a format and a number."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from trials import lies
from trials.originals import FORMATS, Format, Random, originals

_HEADER = 300
"""Half of the unguided changes fall among so many first bytes."""


class Mutant(NamedTuple):
    """A damaged file, and the height and width of the sound one."""

    data: bytes
    shape: tuple[int, int]


def make_mutant(format: Format, number: int, seed: int) -> Mutant:
    """The mutant with this number (any integer): one to three changes to one of the originals."""
    random = np.random.default_rng((seed, FORMATS.index(format), number % (1 << 32)))
    files = originals(format)
    original = files[random.integers(len(files))]
    data = original.data
    for _ in range(random.choice((1, 1, 2, 3))):
        change = _CHANGES[random.choice(len(_CHANGES), p=_WEIGHTS)]
        data = change(format, data, random)
    return Mutant(lies.seal(format.container, data) if random.random() < 0.7 else data, original.shape)


def _flip(format: Format, data: bytes, random: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(random.integers(1, 9)):
        if changed:
            changed[_place(data, random)] ^= 1 << int(random.integers(8))
    return bytes(changed)


def _cut(format: Format, data: bytes, random: Random) -> bytes:
    return data[: _place(data, random)]


def _drop(format: Format, data: bytes, random: Random) -> bytes:
    at = _place(data, random)
    return data[:at] + data[at + int(random.integers(1, 40)) :]


def _noise(format: Format, data: bytes, random: Random) -> bytes:
    at, length = _place(data, random), int(random.integers(1, 9))
    filler = bytes([int(random.choice((0, 0x7F, 0x80, 0xFF)))]) * length
    return data[:at] + (filler if random.random() < 0.5 else random.bytes(length)) + data[at + length :]


def _lie(format: Format, data: bytes, random: Random) -> bytes:
    return lies.lie(format.container, data, random)


def _repeat(format: Format, data: bytes, random: Random) -> bytes:
    return lies.repeat(format.container, data, random)


def _splice(format: Format, data: bytes, random: Random) -> bytes:
    """The beginning of one file and the end of another, often of the same format."""
    donors = originals(format if random.random() < 0.7 else FORMATS[random.integers(len(FORMATS))])
    donor = donors[random.integers(len(donors))]
    at = _place(data, random)
    return data[:at] + donor.data[at if random.random() < 0.5 else _place(donor.data, random) :]


def _inside(format: Format, data: bytes, random: Random) -> bytes:
    """What only PNG offers to change: rows below the compression, and names of chunks."""
    if format.container != "png":
        return _lie(format, data, random)
    return lies.repack(data, random) if random.random() < 0.6 else lies.rename_chunk(data, random)


def _place(data: bytes, random: Random) -> int:
    if not data:
        return 0
    near = random.random() < 0.5
    return int(random.integers(min(len(data), _HEADER) if near else len(data)))


_CHANGES: tuple[Callable[[Format, bytes, Random], bytes], ...] = (
    _flip,
    _cut,
    _drop,
    _noise,
    _lie,
    _repeat,
    _splice,
    _inside,
)
_WEIGHTS = (0.15, 0.07, 0.05, 0.08, 0.35, 0.1, 0.1, 0.1)
