"""Damaged uploads of every format that is read, against the codec and against a real server.

    python benchmarks/fuzz_uploads.py                          # 10,000 of each in process, 1,000 over HTTP
    python benchmarks/fuzz_uploads.py --formats "image jpeg" --in-process 500 --over-http 0
    python benchmarks/fuzz_uploads.py --show "map tiff" 1234 > damaged.tiff

Prints what came of them and ends with 1 if one did harm: a crash, an answer other than 200, 413, 415 or 422,
or more than a second. All figures go to `benchmarks/results/fuzz_uploads.json`.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

from trials.decoding import MOST_MEMORY, MOST_PIXELS, Decoded, decode_mutants
from trials.mutations import make_mutant
from trials.originals import FORMATS, Format
from trials.posting import CONNECTIONS, Posted, post_mutants, target, warm_up
from trials.record import keep


def main() -> None:
    given = _arguments()
    formats = [format for format in FORMATS if str(format) in (given.formats or map(str, FORMATS))]
    if given.show:
        name, number = given.show
        sys.stdout.buffer.write(make_mutant(_named(name), int(number), given.seed).data)
        return
    decoded = {str(format): _decoded(format, given.in_process, given.seed) for format in formats}
    posted = _posted(formats, given.over_http, given.seed) if given.over_http else {}
    harm = sum(len(one.faults) + len(one.crashes) for one in decoded.values())
    harm += sum(len(one.faults) + one.workers_replaced for one in posted.values())
    figures = {
        "limits": {"memory_mb": MOST_MEMORY >> 20, "max_pixels": MOST_PIXELS, "connections": CONNECTIONS},
        "in_process": {name: one.as_json() for name, one in decoded.items()},
        "over_http": {name: one.as_json() for name, one in posted.items()},
    }
    print(f"{harm} did harm; {keep('fuzz_uploads', given.seed, figures)}")
    sys.exit(harm > 0)


def _arguments() -> argparse.Namespace:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--formats", nargs="+", choices=list(map(str, FORMATS)))
    options.add_argument("--in-process", type=int, default=10_000, help="mutants of each format")
    options.add_argument("--over-http", type=int, default=1_000, help="mutants of each format")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--show", nargs=2, metavar=("FORMAT", "NUMBER"), help="write this mutant and end")
    return options.parse_args()


def _named(name: str) -> Format:
    return next(format for format in FORMATS if str(format) == name)


def _decoded(format: Format, count: int, seed: int) -> Decoded:
    began = time.monotonic()
    found = decode_mutants(format, range(count), seed)
    _say(f"{format} in process", found.mutants, found.outcomes)
    _say_cost(found.longest_cpu_s, found.grown_mb, began)
    _tell_harm(found.faults | found.crashes)
    return found


def _posted(formats: Sequence[Format], count: int, seed: int) -> dict[str, Posted]:
    found = {}
    with target() as server:
        warm_up(server)
        for format in formats:
            began = time.monotonic()
            one = found[str(format)] = post_mutants(server, format, range(count), seed)
            _say(f"{format} over HTTP", one.requests, one.statuses)
            _say_cost(one.longest_s, sum(one.grown_mb.values()), began)
            _tell_harm(one.faults)
    return found


def _say(what: str, count: int, outcomes: Counter[Any]) -> None:
    shares = ", ".join(f"{name} {times}" for name, times in outcomes.most_common())
    print(f"{what:22s} {count:6d}: {shares}", end="; ")


def _say_cost(longest_s: float, grown_mb: float, began: float) -> None:
    ran = time.monotonic() - began
    print(f"longest {1e3 * longest_s:.0f} ms, memory +{grown_mb:.0f} MiB, {ran:.0f} s in all", flush=True)


def _tell_harm(harm: dict[int, str]) -> None:
    for number, what in list(harm.items())[:20]:
        print(f"    {number}: {what}", flush=True)


if __name__ == "__main__":
    main()
