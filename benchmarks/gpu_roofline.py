"""What a GPU needs at least for GDR: an estimate from counted work and published peaks, not a measurement.

The kernels run on the emulated device of `tests/fake_cuda`, which counts bytes, operations and instructions;
each kernel then takes as long as the slower of memory and instruction issue at a card's peak, and each launch
a fixed time. Caches, latency and cards that a small level does not fill are left out: real times are longer.

    .venv/bin/python benchmarks/gpu_roofline.py [--size 360x288] [--preset released paper robust]
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "fake_cuda"), str(ROOT / "tests" / "cuda")]

from device_work import globally  # noqa: E402
from fakecuda import Counters, run  # noqa: E402
from problems import problem_of  # noqa: E402

LAUNCH_US = 2.5
"""Between the starts of two kernels of a stream, about, on all three cards."""


@dataclass(frozen=True)
class Card:
    """Published: float32 lanes, boost clock [GHz], memory [GB/s]."""

    name: str
    lanes: int
    clock: float
    bandwidth: float


CARDS = [
    Card("Titan X (Pascal)", 3584, 1.531, 480),
    Card("RTX 4090", 16384, 2.52, 1008),
    Card("H100 SXM", 16896, 1.98, 3350),
]


def least_us(counters: Counters, card: Card) -> tuple[float, bool]:
    """A kernel's time at the peaks of a card, and whether memory is what limits it."""
    moved = (counters.global_read + counters.global_written) / (1e3 * card.bandwidth)
    issued = counters.instructions / (1e3 * card.lanes * card.clock)
    return max(moved, issued), moved > issued


def counted(preset: str, width: int, height: int) -> dict[str, Counters]:
    problem, params = problem_of(preset, width, height)
    kernels: dict[str, Counters] = run(globally, problem=problem, params=params)[0].kernels
    return kernels


def report(preset: str, width: int, height: int) -> None:
    kernels = counted(preset, width, height)
    launches = sum(k.launches for k in kernels.values())
    moved = sum(k.global_read + k.global_written for k in kernels.values()) / 1e6
    print(f"\n{preset} at {width} x {height}, all levels: {launches} launches, {moved:.0f} MB")
    print(f"  {'kernel':16s}{'launches':>9s}{'MB':>9s}{'Mflop':>9s}{'Minstr':>9s}")
    for name, k in sorted(kernels.items(), key=lambda item: -item[1].instructions):
        moved = (k.global_read + k.global_written) / 1e6
        print(f"  {name:16s}{k.launches:9d}{moved:9.2f}{k.flops / 1e6:9.1f}{k.instructions / 1e6:9.1f}")
    for card in CARDS:
        times = {name: least_us(k, card) for name, k in kernels.items()}
        busy = sum(time for time, _ in times.values()) / 1e3
        launching = launches * LAUNCH_US / 1e3
        share = sum(time for time, memory in times.values() if memory) / 1e3 / busy
        print(
            f"  {card.name:17s} estimate: {max(busy, launching):6.2f} ms; kernels {busy:.2f} "
            f"({share:.0%} limited by memory), launches {launching:.2f}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description="estimated, not measured, times of GDR on GPUs")
    parser.add_argument("--size", default="360x288", help="working size, WIDTHxHEIGHT")
    parser.add_argument("--preset", nargs="+", default=["released", "paper", "robust"])
    options = parser.parse_args()
    width, height = map(int, options.size.split("x"))
    print("ESTIMATES from counted work and published peaks; nothing here ran on a GPU.")
    for preset in options.preset:
        report(preset, width, height)


if __name__ == "__main__":
    main()
