"""Requests that Schemathesis makes of the live OpenAPI document: no 500, no answer it does not tell of."""

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from stereomend.api.server import server_process
from stereomend.settings import load_settings

HERE, BENCHMARKS = Path(__file__).parent, Path(__file__).parents[2] / "benchmarks"
KEY = "key-of-the-trial"
EXAMPLES = 100
# Bytes are a valid file to the document, not to the server; a bad parameter may be sent as `?=true`: as none.
LEFT_OUT = "positive_data_acceptance,negative_data_rejection"


@pytest.fixture
def asked(tmp_path):
    settings = load_settings(port=0, max_pixels=100_000, api_keys=KEY, data_dir=tmp_path / "data")
    with server_process(settings) as server:
        yield ask(server.url, tmp_path / "events.ndjson")


def ask(url, events):
    """Let Schemathesis run to its end; returns what it said, its exit code, and the statuses it got."""
    program = Path(sys.executable).with_name("schemathesis")
    options = [
        "--seed",
        "1",
        "--generation-database",
        "none",
        "--no-shrink",
        "--continue-on-failure",
        "--no-color",
    ]
    options += ["--max-examples", str(EXAMPLES), "--exclude-checks", LEFT_OUT]
    options += ["-H", f"Authorization: Bearer {KEY}", "--report", "ndjson", "--report-ndjson-path", events]
    paths = {
        "SCHEMATHESIS_HOOKS": "openapi_hooks",
        "PYTHONPATH": os.pathsep.join(map(str, (HERE, BENCHMARKS))),
    }
    command = [program, "run", f"{url}/openapi.json", *options]
    environment = os.environ | paths
    done = subprocess.run(
        command, env=environment, cwd=events.parent, capture_output=True, text=True, check=False
    )
    return done.stdout + done.stderr, done.returncode, statuses_in(events)


def statuses_in(events):
    counted = Counter()
    for line in events.read_text().splitlines():
        scenario = json.loads(line).get("ScenarioFinished", {}).get("recorder", {})
        for interaction in scenario.get("interactions", {}).values():
            if interaction["response"]:
                counted[scenario["label"], interaction["response"]["status_code"]] += 1
    return counted


def test_every_answer_is_one_that_the_document_tells_of(asked):
    said, exit_code, statuses = asked
    assert exit_code == 0, said
    # The requests are worth something: some are refused for their files, their form or the key, some refined.
    assert {200, 401, 415, 422} <= {status for what, status in statuses if what == "POST /v1/refine"}
    assert sum(statuses.values()) > EXAMPLES
