"""From sources to PTX: which compiler, for which device, and what is kept on disk."""

import subprocess
import sys
from pathlib import Path

import pytest
from fakecuda.arguments import check_formats, complaints, letters_of, reads_of

from stereomend.errors import BackendUnavailable
from stereomend.refinement.backends import cuda_compile
from stereomend.refinement.backends.cuda_compile import Nvcc, Nvrtc, Sources, compile_kernels
from stereomend.refinement.backends.cuda_solver import ARGUMENTS

KERNELS = Path(__file__).parents[2] / "kernels"


class Counting:
    """A compiler that only says what it was asked."""

    name = "counting"

    def __init__(self, version, known=(75, 80, 90)):
        self.version, self.known, self.asked = version, list(known), []

    def architectures(self):
        return self.known

    def compile(self, sources, architecture):
        self.asked.append(architecture)
        return f"ptx {architecture} {sources.digest()}".encode()


@pytest.fixture
def having(monkeypatch, tmp_path):
    """Only these compilers, and a cache of one's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def have(*compilers):
        monkeypatch.setattr(cuda_compile, "compilers", lambda: iter(compilers))
        return compilers[0] if compilers else None

    return have


def test_the_installed_sources_are_those_of_the_repository():
    installed = Sources.installed().texts
    assert "gdr.cu" in installed
    for name, text in installed.items():
        assert text == (KERNELS / name).read_text(), f"{name}: install again after an edit in kernels/"


def test_every_file_that_is_included_is_installed():
    texts = Sources.installed().texts
    included = {
        line.split('"')[1] for text in texts.values() for line in text.splitlines() if '#include "' in line
    }
    assert included | {"gdr.cu"} == set(texts)


def test_what_was_compiled_once_is_read_from_disk(having):
    compiler, sources = having(Counting((13, 0))), Sources({"gdr.cu": "a"})
    first = compile_kernels(sources, 80, (13, 0))
    assert compile_kernels(sources, 80, (13, 0)) == first
    assert compiler.asked == [80]


def test_other_sources_devices_and_compilers_are_compiled_anew(having):
    compiler = having(Counting((13, 0)))
    for sources, capability in (("a", 80), ("b", 80), ("b", 90)):
        compile_kernels(Sources({"gdr.cu": sources}), capability, (13, 0))
    assert compiler.asked == [80, 80, 90]
    newer = having(Counting((13, 1)))
    compile_kernels(Sources({"gdr.cu": "b"}), 90, (13, 1))
    assert newer.asked == [90]


def test_a_cache_that_cannot_be_written_only_costs_time(having, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    compiler = having(Counting((13, 0)))
    for _ in range(2):
        assert compile_kernels(Sources({"gdr.cu": "a"}), 80, (13, 0)).ptx.startswith(b"ptx 80")
    assert compiler.asked == [80, 80]


@pytest.mark.parametrize(("capability", "architecture"), [(75, 75), (86, 80), (89, 80), (120, 90)])
def test_the_newest_code_that_the_device_can_run_is_made(having, capability, architecture):
    compiler = having(Counting((13, 0)))
    compile_kernels(Sources({"gdr.cu": "a"}), capability, (13, 0))
    assert compiler.asked == [architecture]


def test_a_device_older_than_all_code_is_named(having):
    having(Counting((13, 0)))
    with pytest.raises(BackendUnavailable, match=r"counting 13\.0 has no code for .* 6\.1"):
        compile_kernels(Sources({"gdr.cu": "a"}), 61, (13, 0))


def test_a_compiler_newer_than_the_driver_is_passed_over(having):
    newer, older = Counting((13, 0)), Counting((12, 9))
    having(newer, older)
    assert compile_kernels(Sources({"gdr.cu": "a"}), 80, (12, 9)).by == "counting 12.9"
    with pytest.raises(BackendUnavailable, match=r"speaks CUDA 12\.4, found counting 13\.0, counting 12\.9"):
        compile_kernels(Sources({"gdr.cu": "a"}), 80, (12, 4))


def test_without_a_compiler_both_ways_to_one_are_named(having):
    having()
    with pytest.raises(BackendUnavailable, match=r"neither nvcc nor .*nvidia-cuda-nvrtc"):
        compile_kernels(Sources({"gdr.cu": "a"}), 80, (13, 0))


def found(kind):
    return [compiler for compiler in cuda_compile.compilers() if isinstance(compiler, kind)]


@pytest.mark.parametrize("kind", [Nvcc, Nvrtc])
def test_each_compiler_of_this_machine_makes_all_kernels(kind):
    if not found(kind):
        pytest.skip(f"{kind.name} is not on this machine")
    for compiler in found(kind):
        ptx = compiler.compile(Sources.installed(), max(compiler.architectures())).decode()
        assert all(f".entry {name}(" in ptx for name in ("linearise", "iterate", "iterate_guided", "better"))
        check_formats(ptx, ARGUMENTS)


# The kernel that has no use for its step, which is part of the struct that it shares with another.
UNREAD = {("gather", 9)}
OTHER = {"i": "f", "f": "i"}


@pytest.mark.parametrize("kind", [Nvcc, Nvrtc])
def test_an_argument_packed_as_another_type_of_its_size_is_seen(kind):
    """Of each kernel each integer as a float, each float as an integer."""
    if not found(kind):
        pytest.skip(f"{kind.name} is not on this machine")
    compiler = found(kind)[0]
    reads = reads_of(compiler.compile(Sources.installed(), max(compiler.architectures())).decode())
    for name, packed in ARGUMENTS.items():
        for number, letter in letters_of(packed).values():
            if letter in OTHER and (name, number) not in UNREAD:
                wrong = packed[:number] + OTHER[letter] + packed[number + 1 :]
                assert list(complaints(wrong, reads[name])), (name, number)


@pytest.mark.parametrize("kind", [Nvcc, Nvrtc])
def test_what_a_compiler_complains_about_is_passed_on(kind):
    if not found(kind):
        pytest.skip(f"{kind.name} is not on this machine")
    compiler = found(kind)[0]
    with pytest.raises(BackendUnavailable, match=r"(nvcc|NVRTC) failed: .*gdr\.cu\(1\): error"):
        compiler.compile(Sources({"gdr.cu": "nonsense"}), max(compiler.architectures()))


def test_looking_for_compilers_imports_no_pycuda():
    code = "import stereomend.refinement.backends.cuda, sys; sys.exit('pycuda' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
