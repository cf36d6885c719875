"""Each fault that such kernels tend to have is caught: by the emulated device, or by a wrong map."""

from dataclasses import dataclass, field
from pathlib import Path

import device_work
import numpy as np
import pytest
from fakecuda import Failed, run
from problems import REFERENCE, case_of, solved

from stereomend.refinement.backends.cuda_solver import ARGUMENTS

pytestmark = pytest.mark.usefixtures("emulated")

SOURCES = Path(__file__).parents[2] / "kernels"
TEXTS = {file.name: file.read_text() for file in sorted([*SOURCES.glob("*.cu"), *SOURCES.glob("*.cuh")])}
WRONG_PX = 0.01  # fifty times what a warp may be off by


@dataclass
class Fault:
    """An edit of a kernel, and words of the device's complaint; none where only the map tells."""

    file: str
    before: str
    after: str
    complaint: str = ""
    iterations: int = 20
    arguments: dict[str, str] = field(default_factory=dict)


FAULTS = {
    "no barrier between load and first iteration": Fault(
        "gdr_iterate.cuh",
        "guide, shared);\n    __syncthreads();\n    for",
        "guide, shared);\n    for",
        "race within|never written",
    ),
    "no barrier between dual and primal step": Fault(
        "gdr_iterate.cuh",
        "dual_strip<Guided>(in, at, own, guide, shared);\n        __syncthreads();",
        "dual_strip<Guided>(in, at, own, guide, shared);",
        "race within|never written",
    ),
    "no barrier between iterations": Fault(
        "gdr_iterate.cuh",
        "primal_strip<Guided>(in, at, own, guide, shared);\n        __syncthreads();",
        "primal_strip<Guided>(in, at, own, guide, shared);",
        "race within|never written",
    ),
    "no barrier before the descriptors": Fault(
        "gdr_linearise.cuh",
        "greys);\n    __syncthreads();",
        "greys);",
        "race within|never written",
    ),
    "a barrier that not all threads reach": Fault(
        "gdr_iterate.cuh",
        "primal_strip<Guided>(in, at, own, guide, shared);\n        __syncthreads();",
        "primal_strip<Guided>(in, at, own, guide, shared);\n        if (at.rows > 0) __syncthreads();",
        "divergent barrier",
    ),
    "the guard of the columns off by one": Fault(
        "gdr_iterate.cuh", "at.x < in.width ?", "at.x <= in.width ?", "race between blocks"
    ),
    "the guard of the last row off by one": Fault(
        "gdr_iterate.cuh", "at.y + kStrip >= in.height", "at.y + kStrip > in.height", "never written"
    ),
    "the guard of the last column off by one": Fault(
        "gdr_iterate.cuh", "at.x + 1 >= in.width", "at.x >= in.width", "never written"
    ),
    "the guard of the rows off by one": Fault(
        "gdr_linearise.cuh", "y >= in.height) return;", "y > in.height) return;", "out of bounds"
    ),
    # What comes from ten pixels away is too faint to see; what comes from two is not.
    "the halo one short": Fault(
        "gdr_iterate.cuh", "return in.iterations;", "return in.iterations - 1;", iterations=2
    ),
    "the halo one short where tiles are written": Fault(
        "gdr_iterate.cuh",
        "const int halo = halo_of(in);",
        "const int halo = halo_of(in) - 1;",
        "race between blocks",
    ),
    "the overlap of tiles two short": Fault(
        "gdr_iterate.cuh", "kTile - 2 * halo_of(in);", "kTile - 2 * (halo_of(in) - 1);", "never written"
    ),
    "the shared array one short": Fault(
        "gdr_iterate.cuh",
        "float p_x[kTile * kTile];",
        "float p_x[kTile * kTile - 1];",
        "out of bounds: shared",
    ),
    "the shared array of the descriptors one short": Fault(
        "gdr_linearise.cuh",
        "float rest[kGreyPixels];",
        "float rest[kGreyPixels - 1];",
        "out of bounds: shared",
    ),
    "B of the wrong sign": Fault(
        "gdr_linearise.cuh", "in.step * (gr - gg * in.u[i])", "-in.step * (gr - gg * in.u[i])"
    ),
    "the divergence of the wrong sign": Fault(
        "gdr_iterate.cuh", "own.p_x[r] - left + own.p_y[r] - above", "left - own.p_x[r] + above - own.p_y[r]"
    ),
    "the derivative of the wrong sign": Fault("gdr_linearise.cuh", "g = -scale", "g = scale"),
    "an argument of the wrong size": Fault(
        "gdr.cu",
        "",
        "",
        "iterate_guided: argument 17 at byte 120 is packed as 'd' and read as f32",
        arguments={"iterate_guided": ARGUMENTS["iterate_guided"].replace("fff", "fdf")},
    ),
    # As a truth value, which it is there, any float but 0 does as well as 1: no map would tell.
    "a float for an integer": Fault(
        "gdr.cu",
        "",
        "",
        "linearise: argument 8 at byte 56 is packed as 'f' and read as u32",
        arguments={"linearise": "PPPPPPiiff"},
    ),
    "an integer for a float": Fault(
        "gdr.cu",
        "",
        "",
        "iterate_guided: argument 16 at byte 116 is packed as 'i' and read as f32",
        arguments={"iterate_guided": ARGUMENTS["iterate_guided"].replace("fff", "iff")},
    ),
    "integers for a pointer": Fault(
        "gdr.cu",
        "",
        "",
        "observed: argument 2 at byte 16 is packed as 'i' and read as u64",
        arguments={"observed": "PPiiii"},
    ),
}


def case(iterations=20):
    """Two and three tiles, the lower ones ending with a strip."""
    return case_of("all", (100, 141), warps=2, iterations=iterations)


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_caught(name):
    fault = FAULTS[name]
    texts = dict(TEXTS)
    assert texts[fault.file].count(fault.before) == 1 or not fault.before
    texts[fault.file] = texts[fault.file].replace(fault.before, fault.after)
    edited = {"case": case(fault.iterations), "texts": texts, "arguments": fault.arguments}
    if fault.complaint:
        with pytest.raises(Failed, match=fault.complaint):
            run(device_work.solve_edited, **edited)
    else:
        found = run(device_work.solve_edited, **edited)
        assert np.abs(found - solved(REFERENCE, case(fault.iterations))).max() > WRONG_PX


def test_writing_where_neighbours_still_read_is_caught():
    with pytest.raises(Failed, match="race between blocks"):
        run(device_work.solve_in_place, case=case())


def test_without_a_fault_nothing_is_caught():
    found = run(device_work.solve_edited, case=case(), texts=TEXTS, arguments={})
    assert np.abs(found - solved(REFERENCE, case())).max() <= 4e-4
