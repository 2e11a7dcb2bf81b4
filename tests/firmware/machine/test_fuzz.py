"""The machine in C under noise: no crash, no undefined behaviour, no flipped frame that is taken for a message."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from math import sqrt
from pathlib import Path

import kept
import pytest
from random_arms import MIXED

from codegen.firmware.source_tree import machine_files
from codegen.render import arm_files, controller_files
from symbolic.effects import LIBRARY
from symbolic.model import derive
from tests.variants import slow

Run = Callable[..., dict[str, int]]
CORPUS = Path(__file__).with_name("corpus.hex")
"""A line of bytes each, in hexadecimal: they lead to all the code that was reached so far, by libFuzzer's merge
(`guided -merge=1 NEW OLD`; what a search has found is in the directory `corpus` of its test)."""
SECONDS, RUNS = 60, 30_000
"""Of the long search: with libFuzzer, and runs of the plain driver, which take about as long."""


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """C of the machine of a one-jointed arm, and the harness."""
    directory, model = tmp_path_factory.mktemp("fuzz"), derive(MIXED["r"])
    files = arm_files(model) | controller_files(model, LIBRARY) | machine_files(model, LIBRARY, {})
    for path, text in files.items():
        if path.startswith("src/") or "_f32" in path:
            (directory / Path(path).name).write_text(text)
    messages = json.loads(files["protocol.json"])["messages"]
    kinds = ", ".join(f"{{{message['number']}U, {message['size']}U}}" for message in messages)
    harness = Path(__file__).with_name("fuzz.c").read_text()
    (directory / "fuzz.c").write_text(f"#define MESSAGES {kinds}\n{harness}")
    shutil.copy(Path(__file__).with_name("fuzz_target.c"), directory)
    return directory


def units_with(sources: Path, harness: str) -> list[str]:
    """What is compiled."""
    return [path.name for path in sorted(sources.glob("*.c")) if not path.name.startswith("fuzz")] + [harness]


def harness(sources: Path, *flags: str) -> Run:
    """The harness as a program; a call gives the figures that it prints."""
    made = kept.program(sources, units_with(sources, "fuzz.c"), *flags)
    return lambda job, count=0, seed=1: kept.figures(made, job, str(count), str(seed))


@pytest.fixture(scope="module")
def fast(sources: Path) -> Run:
    return harness(sources, "-O2")


@pytest.fixture(scope="module")
def sanitized(sources: Path) -> Run:
    return harness(sources, "-O1", "-g", *kept.SANITIZERS)


@pytest.mark.parametrize("count", [200_000, slow(1_000_000)])
def test_random_and_mutated_frames(fast: Run, count: int) -> None:
    """In every state."""
    found = fast("frames", count)
    assert found["bad"] > 0.3 * count
    assert found["states"] == 0b1111


@pytest.mark.parametrize("count", [50_000, slow(1_000_000)])
def test_noise_under_the_sanitizers(sanitized: Run, count: int) -> None:
    assert sanitized("frames", count, seed=2)["bad"] > 0.3 * count
    assert sanitized("flips", count // 50, seed=3)["singles_taken"] == 0


def test_regular_runs_under_the_sanitizers(sanitized: Run) -> None:
    """Through all states, by way of many reasons."""
    found = sanitized("script", seed=4)
    assert found["ran"] > 1000
    assert found["reasons"].bit_count() >= 8


@pytest.mark.parametrize("pairs", [1_000_000, slow(10_000_000)])
def test_no_flipped_frame_is_taken(fast: Run, pairs: int) -> None:
    """Every single bit of every type of message, with three payloads; and pairs of bits."""
    found = fast("flips", pairs)
    assert found["singles_taken"] == 0
    assert found["pairs_taken"] == 0


@pytest.mark.parametrize("count", [500_000, slow(2_000_000)])
def test_random_frames_are_taken_as_rarely_as_the_checksum_is_long(fast: Run, count: int) -> None:
    """A whole checksum fits by chance once in 2^32; half of one, once in 2^16, often enough to be counted."""
    found = fast("chance", count)
    half = found["random"] / 2**16
    assert found["taken"] == 0
    assert abs(found["sixteen"] - half) < 5 * sqrt(half)


# --- bytes that say what happens, with a corpus that is kept ---


def unpacked(directory: Path) -> list[Path]:
    """The corpus, a file each."""
    directory.mkdir(exist_ok=True)
    for number, line in enumerate(CORPUS.read_text().split()):
        (directory / f"{number:04}").write_bytes(bytes.fromhex(line))
    return sorted(directory.iterdir())


def played(sources: Path, runs: int) -> dict[str, int]:
    """The corpus, then so many changed files of it, under the sanitizers, without libFuzzer."""
    units = units_with(sources, "fuzz_target.c")
    made = kept.program(sources, units, "-O1", "-g", "-DPLAIN", *kept.SANITIZERS)
    return kept.figures(made, str(runs), "1", files=unpacked(sources / "corpus"))


def test_the_corpus(sources: Path) -> None:
    """It goes through every state."""
    found = played(sources, 100)
    assert found["files"] > 50
    assert found["states"] == 0b1111


@pytest.mark.slow
def test_many_files_like_those_of_the_corpus(sources: Path) -> None:
    assert played(sources, RUNS)["states"] == 0b1111


@pytest.mark.slow
def test_a_minute_of_coverage_guided_fuzzing(sources: Path, tmp_path: Path) -> None:
    """From the corpus on; what is found is left in the test's directory."""
    clang = shutil.which("clang")
    if clang is None:
        pytest.skip("needs clang with libFuzzer (Debian: clang, libclang-rt-dev)")
    units = units_with(sources, "fuzz_target.c")
    flags = ("-std=c99", "-ffp-contract=off", "-O1", "-g", "-fsanitize=fuzzer,address,undefined", kept.SANITIZERS[1])
    made = subprocess.run(
        [clang, *flags, *units, "-o", "guided", "-lm"], cwd=sources, capture_output=True, text=True, check=False
    )
    if made.returncode and ("fuzzer" in made.stderr or "asan" in made.stderr):
        pytest.skip("this clang has no libFuzzer (Debian: libclang-rt-dev)")
    assert made.returncode == 0, made.stderr[:3000]
    own = tmp_path / "corpus"
    own.mkdir()
    unpacked(tmp_path / "kept")
    done = subprocess.run(
        [sources / "guided", f"-max_total_time={SECONDS}", "-max_len=4096", "-seed=1", own, tmp_path / "kept"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    error = max(done.stderr.find("ERROR:"), 0)
    assert done.returncode == 0, done.stderr[error : error + 3000]
    print("\n" + done.stderr.strip().splitlines()[-1])
