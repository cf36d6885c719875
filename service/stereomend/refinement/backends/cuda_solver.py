"""GDR on a device: all levels between one upload and one download, all enqueued before anything waits.

The same steps as `coarse_to_fine`. `Device` is what it asks of CUDA.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from contextlib import AbstractContextManager
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from stereomend.refinement.backends import cuda_plan as plan
from stereomend.refinement.backends.coarse_to_fine import level_sizes, schedule
from stereomend.refinement.backends.data import COPIES, Plane, ReuseRule, Size
from stereomend.refinement.stage_params import GdrParams

Address = int
"""Of device memory; 0 stands for a plane that is not there."""

ARGUMENTS = {
    "linearise": "PPPPPPiiif",
    "gather": "PPPPPPiiif",
    "average": "PPPPPiiif" + "f" * (plan.MOST_RADIUS + 1) + "0P",
    "observed": "PPPii",
    "shown": "PPii",
    "iterate": "PPPPPPPPPPPPPiiifff",
    "iterate_guided": "PPPPPPPPPPPPPiiifff",
    "halve": "PPiii",
    "halve_weighed": "PPPPii",
    "enlarge": "PPiiii",
    "edges": "PPiiifff",
    "similarity": "PPPPPii",
    "better": "PPPPiifff0P",
}
"""Types of each kernel's arguments in order, as the module `struct` names them; 0P fills a struct's end."""

KEPT_SIZES = 2
"""Buffers of so many sizes stay on the device."""


class Device(Protocol):
    """One device, its kernels and its only stream."""

    def allocate(self, floats: int) -> Any:
        """Device memory, freed when nobody refers to it; `int()` of it is its address."""
        ...

    def pinned(self, shape: tuple[int, ...]) -> npt.NDArray[np.float32]:
        """Host memory that is copied without a detour."""
        ...

    def upload(self, to: Address, array: npt.NDArray[np.float32]) -> None:
        """Enqueue a copy from pinned memory."""
        ...

    def download(self, array: npt.NDArray[np.float32], source: Address) -> None:
        """Enqueue a copy to pinned memory."""
        ...

    def launch(self, kernel: str, shape: plan.Shape, *arguments: float) -> None:
        """Enqueue a kernel."""
        ...

    def timed(self, copy: str) -> AbstractContextManager[None]:
        """Time what is enqueued meanwhile; `copy` is one of `COPIES`."""
        ...

    def milliseconds(self, copy: str) -> float:
        """What `timed` timed last, once it is finished."""
        ...

    def finish(self) -> None:
        """Wait for all that was enqueued."""
        ...


class _Layout(NamedTuple):
    """Which parts there are: what buffers depend on besides the size."""

    channels: int
    weighed: bool
    edged: bool
    drawn: bool

    @property
    def halved(self) -> int:
        """Planes that coarser levels have the area mean of: left, right, start, and these."""
        return 3 + self.weighed + self.channels


class Inputs(NamedTuple):
    """What a solve is given, each (H, W)."""

    left: Plane
    right: Plane
    start: Plane
    """Where the coarsest level starts, px."""
    weight: Plane | None
    channels: tuple[Plane, ...]
    edge: Plane | None
    prior: Plane | None
    """What u is drawn to, px; None exactly if `trust` is."""
    trust: Plane | None

    @property
    def halved(self) -> list[Plane]:
        """What coarser levels have the area mean of; the start is the third."""
        return [self.left, self.right, self.start, *self._weights, *self.channels]

    @property
    def whole(self) -> list[Plane]:
        """All planes in the order of the upload."""
        guides = (self.edge, self.prior, self.trust)
        return self.halved + [plane for plane in guides if plane is not None]

    @property
    def layout(self) -> _Layout:
        """Which parts there are."""
        parts = (part is not None for part in (self.weight, self.edge, self.trust))
        return _Layout(len(self.channels), *parts)

    @property
    def _weights(self) -> list[Plane]:
        return [] if self.weight is None else [self.weight]


class _State(NamedTuple):
    u: Address
    u_bar: Address = 0
    """0: u itself."""
    p_x: Address = 0
    """0: zero everywhere, and p_y likewise."""
    p_y: Address = 0


class _Level:
    """The planes of one level on the device, each made when it is first asked for."""

    def __init__(self, device: Device, size: Size, layout: _Layout) -> None:
        self.size = size
        self.layout = layout
        self._device = device
        self._kept: dict[str, Any] = {}
        self.stack = self.plane("stack", layout.halved)

    @property
    def extent(self) -> tuple[int, int]:
        """Width and height, in the order of the kernels' arguments."""
        return self.size[1], self.size[0]

    @property
    def bytes(self) -> int:
        """Of a plane."""
        return 4 * self.size[0] * self.size[1]

    def plane(self, name: str, count: int = 1) -> Address:
        """The address of `count` planes in a row."""
        if name not in self._kept:
            self._kept[name] = self._device.allocate(count * self.size[0] * self.size[1])
        return int(self._kept[name])

    def state(self, side: int) -> _State:
        """One of two sets of planes: a launch reads one and writes the other."""
        return _State(*(self.plane(f"{name} {side}") for name in _State._fields))

    @property
    def left(self) -> Address:
        """Grey levels."""
        return self.stack

    @property
    def right(self) -> Address:
        """Grey levels."""
        return self.stack + self.bytes

    @property
    def start(self) -> Address:
        """The prior averaged without its trust."""
        return self.stack + 2 * self.bytes

    @property
    def weight(self) -> Address:
        """Of the data term."""
        return self.stack + 3 * self.bytes if self.layout.weighed else 0

    @property
    def channels(self) -> Address:
        """One after the other."""
        return self.stack + (self.layout.halved - self.layout.channels) * self.bytes

    def edge(self, wanted: bool) -> Address:
        """Weight of the smoothness."""
        return self.plane("edge") if wanted else 0

    @property
    def prior(self) -> Address:
        """What u is drawn to."""
        return self.plane("prior") if self.layout.drawn else 0

    @property
    def trust(self) -> Address:
        """Its weight."""
        return self.plane("trust") if self.layout.drawn else 0


class _Buffers(NamedTuple):
    levels: list[_Level]
    sent: npt.NDArray[np.float32]
    received: npt.NDArray[np.float32]


class Solver:
    """Keeps the buffers of the sizes it saw last."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._buffers: OrderedDict[tuple[Any, ...], _Buffers] = OrderedDict()

    @property
    def keeps(self) -> bool:
        """Whether buffers of earlier solves are on the device."""
        return bool(self._buffers)

    def give_back(self) -> None:
        """Free all buffers once nothing uses them."""
        self._device.finish()
        self._buffers.clear()

    def solve(self, inputs: Inputs, params: GdrParams) -> tuple[npt.NDArray[np.float32], dict[str, float]]:
        """The map (H, W) px, and the milliseconds of `COPIES`; all is enqueued, then waited for once."""
        size = (inputs.left.shape[0], inputs.left.shape[1])
        buffers = self._reserve(inputs, level_sizes(size, params))
        levels = buffers.levels
        self._upload(inputs, buffers)
        for finer, coarser in pairwise(levels):
            self._halve(finer, coarser, params)
        u = self._climb(levels, inputs, params)
        with self._device.timed("d2h"):
            self._device.download(buffers.received, u)
        self._device.finish()
        return buffers.received.copy(), {copy: self._device.milliseconds(copy) for copy in COPIES}

    def _climb(self, levels: list[_Level], inputs: Inputs, params: GdrParams) -> Address:
        run = _Run(self._device, params)
        coarsest, *finer = reversed(levels)
        u, below = coarsest.start, coarsest
        for level in (coarsest, *finer):
            finest = level is levels[0]
            if level is not coarsest:
                u = self._enlarge(u, below, level)
                if not finest and params.reuse_margin is not None:
                    run.better(level, u, ReuseRule(params.reuse_margin))
            edged = inputs.edge is not None if finest else params.edge_level is not None
            u, below = run.solve(level, u, schedule(params, finest), level.edge(edged)), level
        return u

    def _reserve(self, inputs: Inputs, sizes: Sequence[Size]) -> _Buffers:
        key = (*sizes, inputs.layout)
        if key not in self._buffers:
            while len(self._buffers) >= KEPT_SIZES:
                self._buffers.popitem(last=False)
            levels = [_Level(self._device, size, inputs.layout) for size in sizes]
            sent = self._device.pinned((len(inputs.whole), *sizes[0]))
            self._buffers[key] = _Buffers(levels, sent, self._device.pinned(sizes[0]))
        self._buffers.move_to_end(key)
        return self._buffers[key]

    def _upload(self, inputs: Inputs, buffers: _Buffers) -> None:
        finest = buffers.levels[0]
        for place, plane in zip(buffers.sent, inputs.whole, strict=True):
            np.copyto(place, plane)
        guides = [name for name in ("edge", "prior", "trust") if getattr(inputs, name) is not None]
        targets = [finest.plane(name) for name in guides]
        whole = finest.layout.halved
        with self._device.timed("h2d"):
            self._device.upload(finest.stack, buffers.sent[:whole])
            for target, plane in zip(targets, buffers.sent[whole:], strict=True):
                self._device.upload(target, plane)

    def _halve(self, finer: _Level, coarser: _Level, params: GdrParams) -> None:
        shape = plan.per_pixel(coarser.size, layers=finer.layout.halved)
        self._device.launch("halve", shape, finer.stack, coarser.stack, *finer.extent, 2)
        shape = plan.per_pixel(coarser.size)
        if finer.trust:
            guides = (finer.prior, finer.trust, coarser.prior, coarser.trust)
            self._device.launch("halve_weighed", shape, *guides, *finer.extent)
        if params.edge_level is not None:
            constants = (params.edge_level, params.edge_power, params.edge_floor)
            planes = coarser.channels, coarser.edge(True)
            counts = (coarser.layout.channels, *coarser.extent)
            self._device.launch("edges", shape, *planes, *counts, *constants)

    def _enlarge(self, u: Address, coarser: _Level, finer: _Level) -> Address:
        out = finer.plane("enlarged")
        shape = plan.per_pixel(finer.size)
        self._device.launch("enlarge", shape, u, out, *coarser.extent, *finer.extent)
        return out


class _Run:
    """The launches of a solve that depend on its parameters."""

    def __init__(self, device: Device, params: GdrParams) -> None:
        self._launch = device.launch
        self._step = 2 * params.data_weight * params.tau
        self._constants = (params.tau, params.sigma, params.sigma * params.huber_epsilon)
        self._absolute = int(params.descriptor == "absolute")
        self._observed_only = params.observed_only
        taps = plan.window(params.averaging_px) if params.averaging_px > 0 else [1.0]
        self._radius = len(taps) - 1
        self._taps = taps + [0.0] * (plan.MOST_RADIUS + 1 - len(taps))

    def solve(self, level: _Level, u: Address, params: GdrParams, edge: Address) -> Address:
        """All warps of one level from u; returns where the result is."""
        state, turn = _State(u), 0
        for _ in range(params.warps):
            self._linearise(level, state.u)
            laps = plan.laps(level.size, params.iterations)
            for left, iterations in zip(reversed(range(len(laps))), laps, strict=True):
                target = level.state(turn)
                if left == 0:
                    target = target._replace(u_bar=0)
                self._iterate(level, (state, target), iterations, edge)
                state, turn = target, 1 - turn
        return state.u

    def better(self, level: _Level, u: Address, rule: ReuseRule) -> None:
        """The prior where the pair speaks for it far more (R6), in place."""
        other = level.prior or level.start
        similar, shown = level.plane("similar", 2), level.plane("shown")
        self._launch("shown", plan.per_row(level.size), other, shown, *level.extent)
        images = (level.left, level.right, u, other)
        self._launch("similarity", plan.per_pixel(level.size, layers=2), *images, similar, *level.extent)
        self._launch("better", plan.per_pixel(level.size), similar, other, shown, u, *level.extent, *rule)

    def _linearise(self, level: _Level, u: Address) -> None:
        a, b = level.plane("a"), level.plane("b")
        share = self._share(level, u)
        shape = plan.per_pixel(level.size, columns=plan.LINEARISED)
        images = (level.left, level.right, u, share)
        if self._radius == 0:
            self._launch("linearise", shape, *images, a, b, *level.extent, self._absolute, self._step)
            return
        sums = level.plane("sum_gg"), level.plane("sum_gr")
        self._launch("gather", shape, *images, *sums, *level.extent, self._absolute, self._step)
        shape = plan.per_pixel(level.size, rows=plan.AVERAGED_ROWS)
        constants = (self._radius, self._step, *self._taps)
        self._launch("average", shape, *sums, u, a, b, *level.extent, *constants)

    def _share(self, level: _Level, u: Address) -> Address:
        if not self._observed_only:
            return level.weight
        share = level.plane("share")
        self._launch("observed", plan.per_row(level.size), u, level.weight, share, *level.extent)
        return share

    def _iterate(self, level: _Level, states: tuple[_State, _State], count: int, edge: Address) -> None:
        kernel = "iterate_guided" if edge or level.trust else "iterate"
        guide = (level.plane("a"), level.plane("b"), edge, level.prior, level.trust)
        self._launch(
            kernel,
            plan.iterating(level.size, count),
            *states[0],
            *states[1],
            *guide,
            *level.extent,
            count,
            *self._constants,
        )
