"""`stereomend keys`, as it is typed."""

import re
import subprocess
import sys

import pytest


@pytest.fixture
def keys(tmp_path):
    """Run `stereomend keys ... --data-dir DIR`."""

    def run(*words):
        command = [sys.executable, "-m", "stereomend", "keys", *words, "--data-dir", str(tmp_path / "data")]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    return run


def test_a_key_is_printed_once_and_never_listed(keys):
    made = keys("add", "theatre 3", "--scopes", "submit, read")
    assert made.returncode == 0
    assert re.fullmatch(r"stereomend_[\w-]{43}\n", made.stdout)
    id = re.search(r"id (\w+)", made.stderr)[1]
    listed = keys("list").stdout
    assert re.search(rf"^{id} +theatre 3 +read,submit +20\d\d-", listed, re.MULTILINE)
    assert made.stdout.strip()[-43:] not in listed


def test_a_key_is_revoked_by_its_id(keys):
    id = re.search(r"id (\w+)", keys("add", "theatre 3").stderr)[1]
    assert keys("revoke", id).stdout == f"{id} (theatre 3) is revoked\n"
    assert keys("list").stdout.splitlines()[1].count("20") >= 2


@pytest.mark.parametrize(
    ("words", "named"),
    [(("revoke", "none"), "'none'"), (("add", "x", "--scopes", "write"), "'write'")],
)
def test_bad_usage_is_one_line_and_exit_code_2(keys, words, named):
    done = keys(*words)
    assert done.returncode == 2
    assert named in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_folder_that_cannot_be_made_is_named(keys, tmp_path):
    (tmp_path / "data").write_text("a file")
    done = keys("list")
    assert done.returncode == 2
    assert str(tmp_path / "data") in done.stderr
    assert done.stderr.count("\n") == 1
