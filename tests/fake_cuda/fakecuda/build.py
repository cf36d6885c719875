"""Compiles the fake driver and the kernels of the tests, each once per state of their sources.

`python tests/fake_cuda/fakecuda/build.py` prints the folder to put on LD_LIBRARY_PATH.
"""

import hashlib
import os
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parents[1]
CACHE = HERE.parents[1] / "build" / "fake_cuda"

# No contraction: a fused multiply-add happens where the PTX says so, nowhere else.
FLAGS = ["-std=c++20", "-O3", "-march=native", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"]
FLAGS += ["-fwrapv", "-fPIC", "-fvisibility=hidden", "-Wall", "-Wextra"]
ROUNDS = {"real_careful.cpp", "conversion.cpp"}  # they change the rounding mode


def driver_folder() -> Path:
    """The folder that holds `libcuda.so.1`, compiled if need be."""
    sources = sorted((HERE / "driver").glob("*.cpp"))
    headers = sorted((HERE / "driver").glob("*.hpp"))
    folder = CACHE / f"driver-{digest([*sources, *headers], ' '.join(FLAGS) + processor())}"
    library = folder / "libcuda.so.1"
    if not library.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            objects = list(pool.map(lambda source: compile_object(source, folder), sources))
        fresh = folder / f"libcuda.{os.getpid()}"
        soname = "-Wl,-soname,libcuda.so.1"
        subprocess.run(["g++", "-shared", soname, *map(str, objects), "-o", str(fresh)], check=True)
        fresh.rename(library)
        for part in objects:
            part.unlink()
    return folder


def compile_object(source: Path, folder: Path) -> Path:
    """The object file of one source."""
    output = folder / f"{source.stem}.{os.getpid()}.o"
    rounding = ["-frounding-math"] if source.name in ROUNDS else []
    subprocess.run(["g++", *FLAGS, *rounding, "-c", str(source), "-o", str(output)], check=True)
    return output


def ptx_of(source: Path, *options: str, arch: str = "sm_80") -> Path:
    """PTX of a `.cu` file, made by nvcc."""
    beside = sorted([*source.parent.glob("*.cu*"), *source.parent.glob("*.h*")])
    folder = CACHE / f"ptx-{digest(beside, ' '.join([arch, *options]))}"
    ptx = folder / f"{source.stem}.ptx"
    if not ptx.exists():
        folder.mkdir(parents=True, exist_ok=True)
        fresh = folder / f"{source.stem}.{os.getpid()}"
        command = ["nvcc", "--ptx", f"-arch={arch}", *options, "-o", str(fresh), str(source)]
        subprocess.run(command, check=True)
        fresh.rename(ptx)
    return ptx


def digest(files: list[Path], more: str) -> str:
    """A name for the contents of files."""
    total = hashlib.sha256(more.encode())
    for file in files:
        total.update(file.name.encode() + file.read_bytes())
    return total.hexdigest()[:16]


def processor() -> str:
    """What -march=native depends on."""
    flags = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("flags")]
    return flags[0] if flags else ""


def missing_tools() -> str | None:
    """Why nothing can be tested here, or None."""
    for tool in ("g++", "nvcc"):
        if shutil.which(tool) is None:
            return f"{tool} is not on the PATH"
    return None


if __name__ == "__main__":
    print(driver_folder())
