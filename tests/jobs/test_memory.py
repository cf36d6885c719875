"""What a process keeps of the memory that it frees, as the system sees it."""

import subprocess
import sys

import pytest

PIECES = """
import re, sys
from pathlib import Path
from stereomend.jobs.memory import PLANES, UPLOADS, give_back_freed_memory, keep_freed_memory

def resident_mb():
    return int(re.search(r"VmRSS:\\s*(\\d+)", Path("/proc/self/status").read_text())[1]) / 1024

keep_freed_memory({"planes": PLANES, "uploads": UPLOADS}[sys.argv[1]])
size = int(sys.argv[2])
before = resident_mb()
pieces = [bytes([1]) * size for _ in range((64 << 20) // size)]
del pieces[::2]
kept = resident_mb() - before
give_back_freed_memory()
print(kept, resident_mb() - before)
"""


def freed_half_of_64_mb(kind, size):
    """MiB that are left right after it, and once what is kept has been given back."""
    done = subprocess.run(
        [sys.executable, "-c", PIECES, kind, str(size)], capture_output=True, text=True, check=True
    )
    return map(float, done.stdout.split())


@pytest.mark.parametrize(("kind", "size"), [("planes", 1 << 20), ("uploads", 250_000)])
def test_what_is_kept_between_pieces_in_use_is_given_back_when_asked_for(kind, size):
    kept, left = freed_half_of_64_mb(kind, size)
    assert kept > 60
    assert left < 40


def test_a_server_keeps_nothing_of_whole_files():
    kept, _ = freed_half_of_64_mb("uploads", 1 << 20)
    assert kept < 40
