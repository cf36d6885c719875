"""From the installed kernel sources to PTX, by nvcc or the NVRTC wheel, kept on disk. No driver in here."""

from __future__ import annotations

import ctypes
import hashlib
import importlib.resources
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from stereomend.errors import BackendUnavailable

MAIN = "gdr.cu"
OPTIONS = ("--std=c++17",)

Version = tuple[int, int]
"""Of CUDA: major and minor."""


class Sources(NamedTuple):
    """The text of each file, by name."""

    texts: Mapping[str, str]

    @classmethod
    def installed(cls) -> Sources:
        """Those that came with the package."""
        return cls.of(importlib.resources.files("stereomend") / "kernels_src")

    @classmethod
    def of(cls, folder: Any) -> Sources:
        """Those of a folder."""
        files = (file for file in folder.iterdir() if file.name.endswith((".cu", ".cuh")))
        return cls({file.name: file.read_text() for file in sorted(files, key=lambda file: str(file.name))})

    def digest(self, *more: str) -> str:
        """A name for their contents."""
        total = hashlib.sha256("\0".join(more).encode())
        for name, text in self.texts.items():
            total.update(f"\0{name}\0{text}".encode())
        return total.hexdigest()[:16]


class Compiler(Protocol):
    """Something that makes PTX."""

    name: str
    version: Version

    def architectures(self) -> list[int]:
        """The compute capabilities it knows, times ten."""
        ...

    def compile(self, sources: Sources, architecture: int) -> bytes:
        """PTX (raises BackendUnavailable with what the compiler said)."""
        ...


class Nvcc:
    """The compiler of the CUDA toolkit."""

    name = "nvcc"

    def __init__(self, path: str) -> None:
        self._path = path
        found = re.search(r"release (\d+)\.(\d+)", _output([path, "--version"]))
        self.version = (int(found[1]), int(found[2])) if found else (0, 0)

    def architectures(self) -> list[int]:
        """See `Compiler.architectures`."""
        return [int(n) for n in re.findall(r"compute_(\d+)$", _output([self._path, "--list-gpu-arch"]), re.M)]

    def compile(self, sources: Sources, architecture: int) -> bytes:
        """See `Compiler.compile`."""
        with tempfile.TemporaryDirectory() as folder:
            for name, text in sources.texts.items():
                Path(folder, name).write_text(text)
            output = Path(folder, "out.ptx")
            command = [self._path, "--ptx", *OPTIONS, f"-arch=compute_{architecture}", "-o", str(output)]
            done = subprocess.run(
                [*command, str(Path(folder, MAIN))], capture_output=True, text=True, check=False
            )
            if done.returncode:
                raise BackendUnavailable(f"cuda: nvcc failed: {_first_error(done.stderr)}")
            return output.read_bytes()


class Nvrtc:
    """The compiler as a library; it needs no other compiler and no headers."""

    name = "NVRTC"

    def __init__(self, path: str) -> None:
        self._library = ctypes.CDLL(path)
        major, minor = ctypes.c_int(), ctypes.c_int()
        self._library.nvrtcVersion(ctypes.byref(major), ctypes.byref(minor))
        self.version = (major.value, minor.value)

    def architectures(self) -> list[int]:
        """See `Compiler.architectures`."""
        count = ctypes.c_int()
        self._library.nvrtcGetNumSupportedArchs(ctypes.byref(count))
        known = (ctypes.c_int * count.value)()
        self._library.nvrtcGetSupportedArchs(known)
        return list(known)

    def compile(self, sources: Sources, architecture: int) -> bytes:
        """See `Compiler.compile`."""
        headers = {name: text for name, text in sources.texts.items() if name != MAIN}
        program = ctypes.c_void_p()
        self._library.nvrtcCreateProgram(
            ctypes.byref(program),
            sources.texts[MAIN].encode(),
            MAIN.encode(),
            len(headers),
            _strings(headers.values()),
            _strings(headers),
        )
        try:
            options = [*OPTIONS, f"--gpu-architecture=compute_{architecture}"]
            if self._library.nvrtcCompileProgram(program, len(options), _strings(options)):
                log = self._text(program, "nvrtcGetProgramLog").decode()
                raise BackendUnavailable(f"cuda: NVRTC failed: {_first_error(log)}")
            return self._text(program, "nvrtcGetPTX")
        finally:
            self._library.nvrtcDestroyProgram(ctypes.byref(program))

    def _text(self, program: ctypes.c_void_p, what: str) -> bytes:
        size = ctypes.c_size_t()
        getattr(self._library, f"{what}Size")(program, ctypes.byref(size))
        text = ctypes.create_string_buffer(size.value)
        getattr(self._library, what)(program, text)
        return text.value


def _strings(texts: Any) -> Any:
    encoded = [text.encode() for text in texts]
    return (ctypes.c_char_p * len(encoded))(*encoded)


def _output(command: list[str]) -> str:
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout
    except OSError:
        return ""


def _first_error(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip()]
    errors = [line for line in lines if "error" in line.lower()]
    return (errors or lines or ["it said nothing"])[0]


def compilers() -> Iterator[Compiler]:
    """Those that this machine has: nvcc on the PATH or below CUDA_HOME, then NVRTC, the newest first."""
    home = os.environ.get("CUDA_HOME") or os.environ.get("CUDA_ROOT") or "/usr/local/cuda"
    nvcc = shutil.which("nvcc") or shutil.which("nvcc", path=f"{home}/bin")
    if nvcc is not None:
        yield Nvcc(nvcc)
    seen = set()
    for library in _nvrtc_libraries():
        try:
            found = Nvrtc(library)
        except OSError:
            continue
        if found.version not in seen:
            yield found
        seen.add(found.version)


def _nvrtc_libraries() -> list[str]:
    installed = (
        str(file) for place in sys.path for file in Path(place or ".").glob("nvidia/*/lib/libnvrtc.so.[0-9]*")
    )
    return [*sorted(installed, key=_suffix, reverse=True), "libnvrtc.so.13", "libnvrtc.so.12"]


def _suffix(library: str) -> int:
    return int(re.sub(r".*\.so\.(\d+).*", r"\1", library))


class Compiled(NamedTuple):
    """PTX, and what made it."""

    ptx: bytes
    by: str


def compile_kernels(sources: Sources, capability: int, driver: Version) -> Compiled:
    """PTX for a device of `capability` (times ten) whose driver speaks CUDA up to the version `driver`.

    It is kept in a cache folder; without one that can be written it is made anew each time.

    Raises:
        BackendUnavailable: no compiler is there, or none that driver and device understand.
    """
    found = list(compilers())
    fitting = [compiler for compiler in found if compiler.version <= driver]
    if not fitting:
        raise BackendUnavailable(f"cuda: {_no_compiler(found, driver)}")
    by = fitting[0]
    label = f"{by.name} {by.version[0]}.{by.version[1]}"
    name = sources.digest(label, str(capability), *OPTIONS)
    kept = cache_folder() / f"{name}.ptx"
    try:
        return Compiled(kept.read_bytes(), label)
    except OSError:
        ptx = by.compile(sources, _architecture(by, capability))
        _keep(kept, ptx)
        return Compiled(ptx, label)


def cache_folder() -> Path:
    """Where compiled kernels are kept."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "stereomend" / "kernels"


def _keep(file: Path, ptx: bytes) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        fresh = file.with_suffix(f".{os.getpid()}")
        fresh.write_bytes(ptx)
        fresh.rename(file)
    except OSError:
        pass  # a container that cannot write compiles at each start


def _architecture(compiler: Compiler, capability: int) -> int:
    # PTX for an older device runs on a newer one.
    known = [architecture for architecture in compiler.architectures() if architecture <= capability]
    if not known:
        raise BackendUnavailable(
            f"cuda: {compiler.name} {compiler.version[0]}.{compiler.version[1]} has no code for a device of "
            f"compute capability {capability // 10}.{capability % 10}; CUDA 12 may have"
        )
    return max(known)


def _no_compiler(found: list[Compiler], driver: Version) -> str:
    if not found:
        return "no compiler: neither nvcc nor the package nvidia-cuda-nvrtc (see README, GPU)"
    versions = ", ".join(f"{one.name} {one.version[0]}.{one.version[1]}" for one in found)
    return (
        f"no compiler that the driver understands: it speaks CUDA {driver[0]}.{driver[1]}, found {versions}"
    )
