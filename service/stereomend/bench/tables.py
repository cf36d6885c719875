"""The report as tables for a terminal of 100 columns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from stereomend.bench.cases import WxH
from stereomend.bench.ceilings import Ceiling
from stereomend.bench.clock import Spread
from stereomend.bench.http import HttpTimes, Percentiles
from stereomend.bench.machine import machine_lines
from stereomend.bench.run import PAPER_MS, PAPER_SIZE, Report
from stereomend.bench.stages import StageTimes
from stereomend.bench.sweeps import FEW, MANY, OPERATIONS, PLANE_BYTES, SweepTimes

_PARTS = {
    "queue": "waiting for a worker",
    "decode": "what is waited for of three PNG files",
    "prepare": "the pair at working size",
    "initial": "matching, where nothing was uploaded",
    "finish": "input size, provenance, quality",
    "encode": "what is waited for of the 16-bit PNG",
    "inside": "of total: pipes",
    "outside": "of total: client, HTTP, reading the upload",
}


def lines_of(report: Report) -> Iterator[str]:
    """All tables, line by line."""
    yield from _head(report)
    yield from _ceilings(report.ceilings)
    yield from _stages(report.stages)
    yield from _paper(report.stages)
    yield from _sweeps(report.sweeps)
    for http in report.http:
        yield from _http(http)


def _head(report: Report) -> Iterator[str]:
    yield from machine_lines(report.machine)
    yield f"load {report.load_before} before, {report.load_after} after; {report.plan.repeats} rounds"
    if report.load_before > 0.5:
        yield "Other programs ran: the least times say more than the medians."


def _ceilings(ceilings: Iterable[Ceiling]) -> Iterator[str]:
    yield from _title("What the machine can do")
    yield f"{'threads':>8s}{'memory triad':>20s}{'multiply-add':>20s}{'per thread':>20s}"
    for one in ceilings:
        each = one.multiply_add_gflop_s / one.threads
        yield (
            f"{one.threads:8d}{one.triad_gb_s:15.1f} GB/s{one.multiply_add_gflop_s:12.1f} GFlop/s"
            f"{each:12.1f} GFlop/s"
        )


def _stages(stages: Iterable[StageTimes]) -> Iterator[str]:
    yield from _title(
        "LDR and GDR at working size: median (least .. most) ms, ns per pixel, speed-up by threads"
    )
    yield (
        f"{'worked at':11s}{'preset':10s}{'backend':10s}{'thr':>3s}"
        f"{'LDR ms':>12s}{'ns/px':>13s}{'x':>6s}{'GDR ms':>12s}{'ns/px':>14s}{'x':>6s}"
    )
    for one in stages:
        yield (
            f"{_by(one.worked):11s}{one.preset:10s}{one.backend:10s}{one.threads:3d}"
            f"{_spread(one.ldr_ms, 20)}{one.ldr_ns_per_pixel:5.0f}{or_dash(one.ldr_speedup, '6.2f')}"
            f"{_spread(one.gdr_ms, 22)}{one.gdr_ns_per_pixel:6.0f}{or_dash(one.gdr_speedup, '6.2f')}"
        )


def _paper(stages: Sequence[StageTimes]) -> Iterator[str]:
    same = [one for one in stages if one.worked == PAPER_SIZE and one.preset == "paper"]
    figures = ", ".join(f"{ms:.0f} ms {what}" for what, ms in PAPER_MS.items())
    yield f"The paper at {_by(PAPER_SIZE)}, on other machines: {figures}"
    for one in same:
        yield (
            f"  {one.backend}, {one.threads} thread(s) here: LDR {one.ldr_ms.median:.1f} ms, "
            f"GDR {one.gdr_ms.median:.1f} ms"
        )


def _sweeps(sweeps: Iterable[SweepTimes]) -> Iterator[str]:
    yield from _title(f"The finest level: solves of one warp with {FEW} and {MANY} iterations")
    yield (
        f"{'worked at':11s}{'backend':10s}{'thr':>3s}{'iteration':>13s}{'x':>6s}{'GFlop/s':>9s}"
        f"{'of mul-add':>12s}{'GB/s':>8s}{'of triad':>10s}{'before':>10s}{'ns/px':>8s}"
    )
    for one in sweeps:
        yield (
            f"{_by(one.worked):11s}{one.backend:10s}{one.threads:3d}{or_dash(one.iteration_ms, '10.3f')} ms"
            f"{or_dash(one.speedup, '6.2f')}{or_dash(one.gflop_s, '9.1f')}"
            f"{or_dash(one.of_multiply_add, '12.0%')}{or_dash(one.gb_s, '8.1f')}"
            f"{or_dash(one.of_triad, '10.0%')}{or_dash(one.before_ms, '7.2f')} ms"
            f"{or_dash(one.before_ns_per_pixel, '8.1f')}"
        )
    yield f"{OPERATIONS} operations and {PLANE_BYTES} bytes per pixel and iteration; over 100 % of the triad:"
    yield "the planes stayed in the caches. before: warp, descriptors, linearisation, set-up."


def _http(http: HttpTimes) -> Iterator[str]:
    yield from _title(
        f"Over HTTP: {_by(http.input)} PNG files, preset {http.preset}, {http.requests} requests"
    )
    yield f"{'':22s}{'p50':>9s}{'p90':>9s}"
    yield _row("the client waits", http.client, f"{http.sent_bytes} bytes out, {http.received_bytes} back")
    yield _row("LDR + GDR", http.stages, "of the same requests")
    yield _row("besides", http.besides, "request by request")
    for name, text in _PARTS.items():
        yield _row(f"  {name}", http.parts[name], text)


def _row(name: str, times: Percentiles, text: str) -> str:
    return f"{name:22s}{times.p50:9.2f}{times.p90:9.2f} ms  {text}"


def _title(text: str) -> Iterator[str]:
    yield ""
    yield text


def _by(size: WxH) -> str:
    return f"{size[0]}x{size[1]}"


def _spread(times: Spread, width: int) -> str:
    return f"{_short(times.median)} ({_short(times.min)} .. {_short(times.max)})".rjust(width)


def _short(ms: float) -> str:
    return f"{ms:.0f}" if ms >= 100 else f"{ms:.1f}"


def or_dash(value: float | None, form: str) -> str:
    """A number in a form such as "9.2f", or a dash as wide where there is none."""
    return f"{value:{form}}" if value is not None else "-".rjust(int(form.partition(".")[0]))
