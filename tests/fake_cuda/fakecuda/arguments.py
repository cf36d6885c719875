"""Do the types that a host packs arguments as match those that a kernel reads?

A driver is given bytes, so it cannot tell a float from an integer. PTX says how each is read.
"""

import re
import struct
from collections.abc import Iterator, Mapping
from typing import NamedTuple

ENTRY = re.compile(r"\.entry (\w+)\s*\((.*?)\)(.*?)^\}", re.S | re.M)
PARAM = re.compile(
    r"\.param\s+(?:\.align\s+(\d+)\s+)?\.[busf](\d+)\s+(?:\.ptr\s[^,]*?)?(\w+)(?:\[(\d+)\])?\s*(?:,|$)"
)
LOAD = re.compile(r"ld\.param(?:\.v\d)?\.([busf])(\d+)\s+(\{.*?\}|%\w+), \[(\w+)(?:\+(\d+))?\];")

FITTING = {"P": "bu", "i": "bus", "f": "bf"}
"""Kinds of loads, as PTX names them, that may read what the module `struct` packs so."""


class Read(NamedTuple):
    """One load of a parameter: b bits, u or s integer, f float; its size in bytes."""

    kind: str
    size: int


def reads_of(ptx: str) -> dict[str, dict[int, set[Read]]]:
    """How each kernel reads its arguments: by the kernel's name and the offset in bytes."""
    return {name: reads_of_kernel(head, body) for name, head, body in ENTRY.findall(ptx)}


def reads_of_kernel(head: str, body: str) -> dict[int, set[Read]]:
    """The same of one, from the list of its parameters and what follows it."""
    starts, found = places(head), {}
    for kind, bits, registers, name, offset in LOAD.findall(body):
        size = int(bits) // 8
        for k in range(registers.count("%")):
            at = starts[name] + int(offset or 0) + k * size
            found.setdefault(at, set()).add(Read(kind, size))
    return found


def places(head: str) -> dict[str, int]:
    """Where each parameter begins in what a launch hands over, in bytes."""
    starts, end = {}, 0
    for align, bits, name, count in PARAM.findall(head):
        size = int(bits) // 8
        starts[name] = -(-end // int(align or size)) * int(align or size)
        end = starts[name] + size * int(count or 1)
    return starts


def check_formats(ptx: str, formats: Mapping[str, str]) -> None:
    """Compare formats of the module `struct` with kernels (raises TypeError for the first misfit)."""
    reads = reads_of(ptx)
    for name, packed in formats.items():
        for complaint in complaints(packed, reads[name]):
            raise TypeError(f"{name}: {complaint}")


def complaints(packed: str, reads: Mapping[int, set[Read]]) -> Iterator[str]:
    """What does not fit of one kernel."""
    letters = letters_of(packed)
    for at, kinds in sorted(reads.items()):
        number, letter = letters.get(at, (None, None))
        for kind, size in sorted(kinds):
            if letter is None or size != struct.calcsize(letter) or kind not in FITTING[letter]:
                yield f"argument {number} at byte {at} is packed as {letter!r} and read as {kind}{8 * size}"


def letters_of(packed: str) -> dict[int, tuple[int, str]]:
    """The number and the letter of each argument by where it begins, as a compiler aligns it."""
    found, before = {}, ""
    for number, letter in enumerate(re.findall(r"0?[a-zA-Z]", packed)):
        before += letter
        found[struct.calcsize(before) - struct.calcsize(letter)] = (number, letter)
    return {at: (number, letter) for at, (number, letter) in found.items() if not letter.startswith("0")}
