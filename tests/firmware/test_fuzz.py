"""The machine in C under noise: no crash, no undefined behaviour, no flipped frame that is taken for a message."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from math import sqrt
from pathlib import Path

import pytest
from random_arms import MIXED

from codegen.firmware.source_tree import machine_files
from codegen.render import arm_files, controller_files
from codegen.toolchain import build
from symbolic.effects import LIBRARY
from symbolic.model import derive

Run = Callable[..., dict[str, int]]
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
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


def compiled(sources: Path, output: str, *flags: str) -> Run:
    """The harness as an executable; a call gives the figures that it prints."""
    units = units_with(sources, "fuzz.c")
    command = [*build.compiler(), "-std=c99", "-ffp-contract=off", *flags, *units, "-o", output, "-lm"]
    made = subprocess.run(command, cwd=sources, capture_output=True, text=True, check=False)
    if made.returncode and "san" in made.stderr and "-fsanitize" in " ".join(flags):
        pytest.skip("this compiler has no sanitizers")
    assert made.returncode == 0, made.stderr[:3000]

    def run(job: str, count: int = 0, seed: int = 1) -> dict[str, int]:
        environment = os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}
        done = subprocess.run(
            [f"./{output}", job, str(count), str(seed)],
            cwd=sources, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr[:3000]
        return {name: int(value, 0) for name, value in (word.split("=") for word in done.stdout.split())}

    return run


@pytest.fixture(scope="module")
def fast(sources: Path) -> Run:
    return compiled(sources, "fast", "-O2")


@pytest.fixture(scope="module")
def sanitized(sources: Path) -> Run:
    return compiled(sources, "sanitized", "-O1", "-g", *SANITIZERS)


def test_a_million_random_and_mutated_frames(fast: Run) -> None:
    """In every state."""
    found = fast("frames", 1_000_000)
    assert found["bad"] > 300_000
    assert found["states"] == 0b1111


def test_noise_under_the_sanitizers(sanitized: Run) -> None:
    assert sanitized("frames", 1_000_000, seed=2)["bad"] > 300_000
    assert sanitized("flips", 20_000, seed=3)["singles_taken"] == 0


def test_regular_runs_under_the_sanitizers(sanitized: Run) -> None:
    """Through all states, by way of many reasons."""
    found = sanitized("script", seed=4)
    assert found["ran"] > 1000
    assert found["reasons"].bit_count() >= 8


def test_no_flipped_frame_is_taken(fast: Run) -> None:
    """Every single bit of every type of message, with three payloads; ten million pairs of bits."""
    found = fast("flips", 10_000_000)
    print(
        f"\nflipped frames taken for messages: {found['singles_taken']} of {found['singles']} with one bit, "
        f"{found['pairs_taken']} of {found['pairs']} with two"
    )
    assert found["singles_taken"] == 0
    assert found["pairs_taken"] == 0


def test_random_frames_are_taken_as_rarely_as_the_checksum_is_long(fast: Run) -> None:
    """A whole checksum fits by chance once in 2^32; half of one, once in 2^16, often enough to be counted."""
    found = fast("chance", 2_000_000)
    expected, half = found["random"] / 2**32, found["random"] / 2**16
    print(
        f"\nrandom frames taken: {found['taken']} of {found['random']}, {expected:.2g} expected; "
        f"with half of the checksum right: {found['sixteen']}, {half:.1f} expected"
    )
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
    command = [*build.compiler(), "-std=c99", "-ffp-contract=off", "-O1", "-g", "-DPLAIN", *SANITIZERS, *units]
    made = subprocess.run([*command, "-o", "plain", "-lm"], cwd=sources, capture_output=True, text=True, check=False)
    if made.returncode and "san" in made.stderr:
        pytest.skip("this compiler has no sanitizers")
    assert made.returncode == 0, made.stderr[:3000]
    files = map(str, unpacked(sources / "kept"))
    environment = os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}
    done = subprocess.run(
        ["./plain", str(runs), "1", *files],
        cwd=sources, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr[:3000]
    return {name: int(value, 0) for name, value in (word.split("=") for word in done.stdout.split())}


def test_the_corpus(sources: Path) -> None:
    """It goes through every state."""
    found = played(sources, 500)
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
    flags = ("-std=c99", "-ffp-contract=off", "-O1", "-g", "-fsanitize=fuzzer,address,undefined", SANITIZERS[1])
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
    assert done.returncode == 0, done.stderr[-3000:]
    print("\n" + done.stderr.strip().splitlines()[-1])
