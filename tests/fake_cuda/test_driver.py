"""The driver around the kernels: modules, faults on demand, what waits for the device and what does not."""

import numpy as np
import programs
import pytest
from fakecuda import Failed, run

HEADER = ".version 8.0\n.target sm_80\n.address_size 64\n"
ENTRY = ".visible .entry f()\n{\n.reg .b32 %r<3>;\n"


def test_an_instruction_that_is_not_known_is_named_with_its_line():
    text = HEADER + ENTRY + "frobnicate.b32 %r1, %r2;\nret;\n}\n"
    with pytest.raises(Failed, match="PTX line 7: the instruction 'frobnicate' is not known"):
        run(programs.load, ptx=text)


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("add.s32.sat.odd %r1, %r1, %r2;", "line 7: 'add' with '.sat' is not known"),
        ("add.s32 %r1, %r1;", "line 7: 'add' needs more operands"),
        ("add.s64 %r1, %r1, %r2;", "line 7: %r1 has 4 bytes, the instruction wants 8"),
        ("mov.u32 %r1, %r9;", "line 7: no register is called '%r9'"),
        ("bra nowhere;", "no label nowhere"),
        ("mov.u32 %r1, 12x;", "line 7: the number 12x is of no known form"),
        ("bar.arrive 0, 64;", "line 7: barriers that do not wait are not known"),
    ],
)
def test_what_is_wrong_with_a_line_is_said(line, complaint):
    with pytest.raises(Failed, match=complaint):
        run(programs.load, ptx=HEADER + ENTRY + line + "\nret;\n}\n")


def test_a_module_for_a_newer_device_is_refused():
    with pytest.raises(Failed, match="PTX for sm_90 on a device of sm_86"):
        run(programs.load, ptx=HEADER.replace("80", "90") + ENTRY + "ret;\n}\n")
    run(programs.load, env={"FAKE_CUDA_ARCH": "90"}, ptx=HEADER.replace("80", "90") + ENTRY + "ret;\n}\n")


def test_machine_code_is_refused():
    with pytest.raises(Failed, match="only PTX can be run here"):
        run(programs.load, ptx="\x7fELF and so on")


def test_a_machine_without_devices():
    with pytest.raises(Failed, match="no CUDA-capable device is detected"):
        run(programs.initialise, env={"FAKE_CUDA_DEVICES": "0"})
    assert run(programs.initialise) == 1


def test_what_the_device_says_of_itself():
    facts = run(programs.device_facts, env={"FAKE_CUDA_MEMORY": "100"})
    assert facts == {"capability": (8, 6), "memory": 100 << 20, "threads": 1024, "shared": 2 * 144 * 4}


def test_faults_on_demand():
    said = run(programs.planned_faults)
    assert said[0] == "MemoryError: cuMemAlloc failed: out of memory"
    assert said[1:3] == ["fine", "fine"]
    assert all("an illegal memory access" in words for words in said[3:7])
    assert said[7] == "fine"


def test_faults_from_the_environment():
    launch = {"file": "broken", "kernel": "traps", "args": [np.int32(0)]}
    with pytest.raises(Failed, match="a planned fault: kernel traps"):
        run(programs.launch, env={"FAKE_CUDA_FAIL_LAUNCH": "0"}, **launch)
    run(programs.launch, env={"FAKE_CUDA_FAIL_LAUNCH": "1"}, **launch)
    with pytest.raises(Failed, match="out of memory"):
        run(programs.memory_management, env={"FAKE_CUDA_FAIL_ALLOCATION": "2"})


def test_memory_ends():
    args = [programs.Unwritten(2 << 20)]
    with pytest.raises(Failed, match="out of memory"):
        run(programs.launch, env={"FAKE_CUDA_MEMORY": "1"}, file="broken", kernel="never_ends", args=args)


@pytest.mark.parametrize("mode", ["eager", "lazy"])
def test_pinned_copies_and_launches_wait_for_nothing(mode):
    y, host = run(programs.pipeline, env={"FAKE_CUDA_ASYNC": mode}, pinned=True, waits=True)
    np.testing.assert_array_equal(y, 2 * np.arange(256) + 1)
    assert host.synchronisations == 1
    assert (host.bytes_to_device, host.bytes_to_host) == (2048, 1024)


def test_a_pageable_copy_to_the_host_waits():
    y, host = run(programs.pipeline, env={"FAKE_CUDA_ASYNC": "lazy"}, pinned=False, waits=False)
    np.testing.assert_array_equal(y, 2 * np.arange(256) + 1)
    assert host.synchronisations == 1


def test_a_result_that_nobody_waited_for_is_not_there():
    y, host = run(programs.pipeline, env={"FAKE_CUDA_ASYNC": "lazy"}, pinned=True, waits=False)
    np.testing.assert_array_equal(y, np.ones(256))
    assert host.synchronisations == 0


def test_launches_fail_later_where_work_is_lazy():
    launch = {"file": "broken", "kernel": "traps", "args": [np.int32(4)], "env": {"FAKE_CUDA_ASYNC": "lazy"}}
    with pytest.raises(
        Failed, match=r"cuCtxSynchronize failed: unspecified launch failure \(trap: kernel traps"
    ):
        run(programs.launch, **launch)
    with pytest.raises(
        Failed, match=r"cuLaunchKernel failed: unspecified launch failure \(trap: kernel traps"
    ):
        run(programs.launch, **{**launch, "env": {}})
