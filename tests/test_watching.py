"""Refinements on a server as somebody at a terminal sees them: real processes on a real pseudo-terminal."""

import os
import pty
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import httpx
import numpy as np
import pytest

from stereomend import Client, refine
from stereomend.client import JobStatus
from stereomend.errors import ShapeMismatch
from stereomend.watching import progress_line, refine_watched

QUICK = {"gdr": {"warps": 1, "levels": 1}}


class Terminal:
    """A command whose stderr is a terminal, and what it has shown there."""

    def __init__(self, folder, *arguments):
        self.shown, master, slave = "", *pty.openpty()
        command = [sys.executable, "-m", "stereomend", *map(str, arguments)]
        self.process = subprocess.Popen(
            command,
            stderr=slave,
            stdout=subprocess.PIPE,
            cwd=folder,
            text=True,
            preexec_fn=hear_interrupts,  # noqa: PLW1509
        )
        os.close(slave)
        self.reading = threading.Thread(target=self.read, args=(master,))
        self.reading.start()

    def read(self, master):
        with os.fdopen(master, "rb", buffering=0) as terminal:
            try:
                while text := terminal.read(4096):
                    self.shown += text.decode()
            except OSError:
                pass  # so Linux tells that nobody has the other end any more

    def end(self):
        self.stdout, _ = self.process.communicate(timeout=60)
        self.reading.join(60)
        return self.process.returncode


def hear_interrupts():
    """As in a terminal's foreground: a shell has what runs in the background ignore them."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.fixture
def folder(tmp_path, scene):
    for name, content in scene.files.items():
        (tmp_path / f"{name}.npy").write_bytes(content)
    return tmp_path


@pytest.fixture
def watch(folder):
    """Run `stereomend refine --url` at a terminal."""

    def start(url, *options):
        files = ("left.npy", "right.npy", "disparity.npy")
        return Terminal(folder, "refine", *files, "-o", "out.npy", "--url", url, *options)

    return start


def jobs(server):
    return httpx.get(f"{server.url}/v1/jobs").json()["jobs"]


SLOW = ("--scale", "1", "--set", "gdr.levels=1", "--set", "gdr.iterations=1000", "--set", "gdr.warps=18")


def test_a_terminal_shows_how_far_the_server_is_and_nothing_is_left_there(serving, watch, folder, scene):
    with serving() as server:
        terminal = watch(server.url, *SLOW)
        assert terminal.end() == 0, terminal.shown
        assert "gdr     [" in terminal.shown
        assert "/18" in terminal.shown
        assert terminal.shown.endswith("\r\x1b[K")
        assert terminal.stdout.startswith("out.npy: 64 x 48 px, robust on reference")
        assert jobs(server) == []
    gdr = {"levels": 1, "iterations": 1000, "warps": 18}
    local = refine(
        scene.left, scene.right, scene.disparity, backend="reference", processing_scale=1.0, gdr=gdr
    )
    assert (np.load(folder / "out.npy") == local.disparity).all()


def test_who_gives_up_leaves_no_work_behind(serving, watch, folder, eventually):
    with serving() as server:
        terminal = watch(server.url, *SLOW[:-1], "gdr.warps=1000")
        eventually(lambda: "gdr     [" in terminal.shown)
        terminal.process.send_signal(signal.SIGINT)
        assert terminal.end() == 130
        assert jobs(server) == []
    assert not (folder / "out.npy").exists()


def test_a_refusal_at_a_terminal_is_that_of_a_refinement_that_is_waited_for(server, watch, folder, scene):
    np.save(folder / "right.npy", scene.right[1:])
    terminal = watch(server.url)
    assert terminal.end() == 2
    assert "stereomend: right is 64 x 47" in terminal.shown.split("\r\x1b[K")[-1]


def test_a_failed_job_raises_what_a_refinement_that_is_waited_for_raises(server, scene):
    with Client(server.url) as client, pytest.raises(ShapeMismatch, match="64 x 47"):
        refine_watched(client, (scene.left, scene.right[1:], scene.disparity), None, QUICK)


@contextmanager
def older(server):
    """A server from before there were jobs, in front of one of today."""

    class Older(BaseHTTPRequestHandler):
        def do_GET(self):
            self.forward(
                404, {"Content-Type": "application/problem+json"}, b'{"type": "/problems/not-found"}'
            )

        def do_POST(self):
            body = self.rfile.read(int(self.headers["Content-Length"]))
            asked = {name: self.headers[name] for name in ("Content-Type", "Accept")}
            answer = httpx.post(server.url + self.path, content=body, headers=asked)
            told = {name: answer.headers[name] for name in ("Content-Type", "Server-Timing")}
            self.forward(answer.status_code, told, answer.content)

        def forward(self, status, headers, body):
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Older) as gateway:
        thread = threading.Thread(target=gateway.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{gateway.server_port}"
        gateway.shutdown()
        thread.join()


def test_a_server_without_jobs_refines_all_the_same(server, watch, folder, scene):
    with older(server) as url:
        terminal = watch(url, "--stages", "ldr")
        assert terminal.end() == 0, terminal.shown
    local = refine(scene.left, scene.right, scene.disparity, backend="reference", stages=["ldr"])
    assert (np.load(folder / "out.npy") == local.disparity).all()


@pytest.mark.parametrize(
    ("state", "progress", "line"),
    [
        ("queued", ("queue", 0, 0), "queued"),
        ("running", ("decode", 0, 0), "decode"),
        ("running", ("gdr", 0, 40), "gdr     [........................] 0/40"),
        ("running", ("gdr", 20, 40), "gdr     [############............] 20/40"),
        ("running", ("gdr", 40, 40), "gdr     [########################] 40/40"),
        ("succeeded", ("encode", 0, 0), "succeeded"),
    ],
)
def test_the_line_shows_the_share_that_is_done(state, progress, line):
    phase, done, total = progress
    document = {"state": state, "progress": {"phase": phase, "done": done, "total": total}}
    assert progress_line(JobStatus(document)) == line
