"""What a process keeps of the memory that it frees, as the system sees it."""

import subprocess
import sys

PIECES = """
import re
from pathlib import Path
from stereomend.jobs.memory import give_back_freed_memory, keep_freed_memory

def resident_mb():
    return int(re.search(r"VmRSS:\\s*(\\d+)", Path("/proc/self/status").read_text())[1]) / 1024

keep_freed_memory()
before = resident_mb()
pieces = [bytes([1]) * (1 << 20) for _ in range(64)]
del pieces[::2]
kept = resident_mb() - before
give_back_freed_memory()
print(kept, resident_mb() - before)
"""


def test_what_is_kept_between_pieces_in_use_is_given_back_when_asked_for():
    done = subprocess.run([sys.executable, "-c", PIECES], capture_output=True, text=True, check=True)
    kept, left = map(float, done.stdout.split())
    assert kept > 60
    assert left < 40
