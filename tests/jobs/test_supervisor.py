"""The supervisor with real processes: small programs in the place of the server."""

import os
import signal
import socket
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

SUPERVISE = Path(__file__).parent / "programs" / "supervise.py"

# Says who it is to each who connects; `{then}` is what else it does before it is ready.
SERVE = """
    import os, signal, socket, sys
    from pathlib import Path
    from stereomend.jobs.orphans import end_with
    folder = Path(sys.argv[1])
    listener, lifeline = (socket.socket(fileno=int(number)) for number in sys.argv[2:])
    end_with(lifeline)
    with (folder / "lives").open("a") as lives:
        print(os.getpid(), file=lives)
    {then}
    lifeline.send(b"R")
    while True:
        with listener.accept()[0] as client:
            client.send(str(os.getpid()).encode())
"""


def program(then=""):
    return textwrap.dedent(SERVE).format(then=then)


class Running:
    def __init__(self, folder, then):
        self.folder = folder
        self.log = (folder / "log").open("w")
        command = [sys.executable, str(SUPERVISE), sys.executable, "-c", program(then), str(folder)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=self.log, text=True)

    def port(self):
        return int(self.process.stdout.readline())

    def lives(self):
        file = self.folder / "lives"
        return [int(line) for line in file.read_text().split()] if file.exists() else []

    def end(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        self.log.close()


@pytest.fixture
def supervised(tmp_path):
    """Start a supervisor of a program: `supervised(then="signal.pause()")`."""
    started = []

    def start(then=""):
        started.append(Running(tmp_path, then))
        return started[-1]

    yield start
    for running in started:
        running.end()


def ask(port):
    with socket.create_connection(("127.0.0.1", port), 30) as connection:
        return int(connection.recv(64))


def test_a_killed_server_is_replaced_and_who_connects_meanwhile_waits(supervised, alive, eventually):
    running = supervised()
    port = running.port()
    for _ in range(3):
        first = ask(port)
        os.kill(first, signal.SIGKILL)
        eventually(lambda pid=first: not alive(pid))
        assert ask(port) != first
    assert "exit code -9" in (running.folder / "log").read_text()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_server_and_its_exit_code_is_returned(supervised, alive, number):
    running = supervised(f"signal.signal({int(number)}, lambda *_: sys.exit(7))")
    pid = ask(running.port())
    running.process.send_signal(number)
    assert running.process.wait(20) == 7
    assert not alive(pid)


def test_a_server_that_does_not_end_is_killed(supervised, alive):
    running = supervised("signal.signal(signal.SIGTERM, signal.SIG_IGN)")
    pid = ask(running.port())
    running.process.terminate()
    assert running.process.wait(20) == 128 + signal.SIGKILL
    assert not alive(pid)


def test_a_server_that_was_never_ready_is_not_started_again(supervised):
    running = supervised("sys.exit(2)")
    assert running.process.wait(20) == 2
    assert len(running.lives()) == 1


def test_a_server_that_crashes_whenever_it_starts_is_given_up(supervised):
    running = supervised("os.kill(os.getpid(), signal.SIGSEGV)")
    assert running.process.wait(60) == 128 + signal.SIGSEGV
    assert len(running.lives()) == 5


def test_a_server_that_cannot_start_again_is_tried_again(supervised, eventually):
    running = supervised("sys.exit(2) if len((folder / 'lives').read_text().split()) in (2, 3) else None")
    port = running.port()
    os.kill(ask(port), signal.SIGKILL)
    eventually(lambda: len(running.lives()) == 4)
    assert ask(port) == running.lives()[-1]


def test_no_server_outlives_a_killed_supervisor(supervised, alive, eventually):
    running = supervised()
    pid = ask(running.port())
    running.process.kill()
    eventually(lambda: not alive(pid))


def test_not_even_a_stopped_server_outlives_it(supervised, alive, eventually):
    running = supervised()
    pid = ask(running.port())
    os.kill(pid, signal.SIGSTOP)
    running.process.kill()
    eventually(lambda: not alive(pid))


def test_a_server_whose_supervisor_died_before_it_could_look_ends(tmp_path):
    ours, theirs = socket.socketpair()
    with socket.create_server(("127.0.0.1", 0)) as listener, theirs:
        ours.close()
        descriptors = (listener.fileno(), theirs.fileno())
        process = subprocess.Popen(
            [sys.executable, "-c", program("signal.pause()"), str(tmp_path), *map(str, descriptors)],
            pass_fds=descriptors,
        )
        assert process.wait(20) == 1


def test_orphans_that_become_its_children_are_reaped(supervised, eventually, children):
    # As process 1 of a container would get them.
    running = supervised("os.system('sleep 0.5 &')")
    pid = ask(running.port())
    (orphan,) = set(children(running.process.pid)) - {pid}
    eventually(lambda: orphan not in children(running.process.pid))
