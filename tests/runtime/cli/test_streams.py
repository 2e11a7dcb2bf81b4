"""Standard streams of any kind: closed, full, in ASCII alone; the exit status and one line, never a traceback."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

PROGRAM = "from runtime.cli.main import main; main()"


def tendon(arguments: str, redirections: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = f'exec "$0" -c "$1" {arguments} {redirections}'
    return subprocess.run(
        ["sh", "-c", command, sys.executable, PROGRAM],
        capture_output=True,
        text=True,
        env=os.environ | environment,
        check=False,
    )


@pytest.mark.parametrize("redirections", [">&-", ">&- 2>&-", "2>&-", "<&- >&- 2>&-"])
@pytest.mark.parametrize("arguments", ["effects", "effects --json -", "--help"])
def test_a_closed_stream_is_one_that_nobody_reads(arguments: str, redirections: str) -> None:
    done = tendon(arguments, redirections)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_closed_stream_is_no_file_that_is_written_later(tmp_path) -> None:
    done = tendon(f"effects --json {tmp_path / 'all.json'}", ">&-")
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads((tmp_path / "all.json").read_text())


def test_a_full_disk_behind_standard_output_is_named() -> None:
    done = tendon("effects", ">/dev/full")
    assert (done.returncode, done.stderr) == (2, "standard output: No space left on device\n")
    assert tendon("effects", ">/dev/full 2>&-").returncode == 2


def test_a_terminal_of_ascii_alone() -> None:
    ascii_alone = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"}
    assert tendon("effects", "", **ascii_alone).returncode == 0
    told = tendon("effects --json -", "", **ascii_alone)
    assert told.stderr == ""
    assert json.loads(told.stdout) == json.loads(tendon("effects --json -", "", PYTHONIOENCODING="utf-8").stdout)
    assert tendon("compare ümläut.toml nichts.csv", "", **ascii_alone).returncode == 2
