"""Recordings as people have them, each odd in its own way: what `inspect` says to type, as it stands, cures it."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from runtime.arrays import Array
from runtime.cli import main, output
from runtime.recordings.columns import RecordedArm
from runtime.recordings.recording import read
from runtime.workspace.names import column_mapping
from tests.runtime.recordings.formats import write_sqlite

DEGREES, RPM, NS = 180 / np.pi, 30 / np.pi, 1e9
MOST_ROUNDS = 3
"""How often a user types what was said until nothing is left to say."""
_CURE = re.compile(r'--(?:map|columns) (?:\S+="[^"]*"|\S+)')


def motion(seed: int = 4) -> dict[str, Array]:
    """t (N,), q, qd, tau (2, N) of two drives, 8 s at 500 Hz, that come back to where they began."""
    rng = np.random.default_rng(seed)
    t = np.arange(4000) / 500
    q, qd, qdd = np.zeros((3, 2, len(t)))
    for f in (0.125, 0.375, 0.875, 2.0):
        a, w, phase = 0.7 / (1 + f) ** 1.5, 2 * np.pi * f, rng.uniform(0, 6, (2, 1))
        q += a * np.sin(w * t + phase)
        qd += a * w * np.cos(w * t + phase)
        qdd -= a * w**2 * np.sin(w * t + phase)
    tau = 0.4 * qdd + 1.5 * np.sign(qd) + qd
    return {"t": t, "q": q, "qd": qd, "tau": tau}


def lines(columns: Iterable[Array], delimiter: str = ",") -> str:
    return "\n".join(delimiter.join(f"{x:.17g}" for x in row) for row in np.column_stack(list(columns)))


def decimal_commas(path: Path, m: Mapping[str, Array]) -> None:
    body = lines([m["t"], *(m["q"] * DEGREES), *m["tau"]], ";").replace(".", ",")
    path.write_text(f"Zeit [s];Winkel1 [Grad];Winkel2 [Grad];Moment1 [Nm];Moment2 [Nm]\n{body}\n")


def dates(path: Path, m: Mapping[str, Array]) -> None:
    began = datetime(2024, 5, 5, 12, tzinfo=UTC)
    rows = lines([*m["q"], *m["tau"]]).split("\n")
    stamps = [(began + timedelta(seconds=float(t))).replace(tzinfo=None).isoformat(" ") for t in m["t"]]
    path.write_text("t,q1,q2,tau1,tau2\n" + "\n".join(f"{s},{row}" for s, row in zip(stamps, rows, strict=True)))


def named(header: str, *columns: str, encoding: str = "utf-8", delimiter: str = ",") -> Callable[..., None]:
    """A writer of these signals under that header; a signal may be times a factor: "q*57.3"."""

    def write(path: Path, m: Mapping[str, Array]) -> None:
        found: list[Array] = []
        for column in columns:
            signal, _, factor = column.partition("*")
            found += list(np.atleast_2d(m[signal] * float(factor or 1)))
        path.write_bytes((header + "\n" * bool(header) + lines(found, delimiter) + "\n").encode(encoding))

    return write


ODD: Mapping[str, Callable[[Path, Mapping[str, Array]], object]] = {
    "decimal commas, in German": decimal_commas,
    "no header, ms": named("", "t*1000", "q", "qd", "tau", delimiter=" "),
    "units below the header": named("# rig 7\nt,q1,q2,tau1,tau2\ns,deg,deg,Nm,Nm", "t", f"q*{DEGREES}", "tau"),
    "UTF-16, tabulators": named("t\tq1\tq2\ttau1\ttau2", "t", "q", "tau", encoding="utf-16", delimiter="\t"),
    "ns since 1970": named("timestamp,position_0,position_1,effort_0,effort_1", f"t*{NS}", "q", "tau"),
    "dates": dates,
    "turns and rpm": named("t,q1,q2,qd1,qd2,tau1,tau2", "t", f"q*{1 / (2 * np.pi)}", f"qd*{RPM}", "tau"),
    "numbers within the names": named(
        "Timestamp (ms);Joint 1 Position (deg);Joint 2 Position (deg);Joint 1 Torque (Nm);Joint 2 Torque (Nm)",
        "t*1000",
        f"q*{DEGREES}",
        "tau",
        delimiter=";",
    ),
    "units in the names": named("time_ms,pos_deg_1,pos_deg_2,tau1,tau2", "t*1000", f"q*{DEGREES}", "tau"),
    "a sign": named("t,q1,q2,tau1,tau2", "t", "q", "tau*-1"),
    "a delimiter behind the names": named("t,q1,q2,tau1,tau2,", "t", "q", "tau"),
    "a bag": lambda path, m: write_sqlite(path, "/joint_states", ("a", "b"), m),
}


def inspected(capsys, *arguments: str | Path) -> tuple[int, list[str]]:
    status = output.run(main.app, ["inspect", *map(str, arguments)])
    captured = capsys.readouterr()
    return status, (captured.out + captured.err).splitlines()


@pytest.mark.parametrize("name", ODD)
def test_what_is_said_cures(tmp_path, capsys, name):
    """Every option that is said is typed behind those that were; then the recording is what was measured."""
    m, path, typed = motion(), tmp_path / "odd", []
    ODD[name](path, m)
    for _ in range(MOST_ROUNDS + 1):
        status, said = inspected(capsys, path, *typed)
        text = next((s for s in said if s.startswith(("All at once", "Perhaps"))), said[-1])
        # Where two numbers of joints are said, or a sign and an order of torques, a user knows which is right.
        cure = [option for option in _CURE.findall(text.partition("; if torques stand")[0]) if "q3" not in option]
        if not cure:
            break
        typed += [word for option in cure for word in shlex.split(option)]
    assert (status, said[-1]) == (0, "Nothing looks wrong; with MODEL more can be checked.")
    cells = [cell for option, cell in zip(typed[::2], typed[1::2], strict=True) if option in ("--map", "--columns")]
    r = read(path, RecordedArm.without_model(2), column_mapping(cells))
    np.testing.assert_allclose(np.diff(r.t), np.diff(m["t"]), atol=1e-6)
    np.testing.assert_allclose(r.q, m["q"], rtol=1e-9)
    np.testing.assert_allclose(r.tau, m["tau"], rtol=1e-9)
    if r.qd is not None:
        np.testing.assert_allclose(r.qd, m["qd"], rtol=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_exchanged_torques_without_a_model(tmp_path, capsys, seed):
    """They may look like a wrong sign, and are then said beside it; what is said of them, typed, cures them."""
    m, path = motion(seed), tmp_path / "a.csv"
    named("t,q1,q2,tau1,tau2", "t", "q", "tau")(path, {**m, "tau": m["tau"][::-1]})
    said = inspected(capsys, path)[1][-1]
    if said == "Nothing looks wrong; with MODEL more can be checked.":
        return
    assert "if its sign is wrong, pass " in said
    typed = _CURE.findall(said.partition("; if torques are exchanged, ")[2])
    r = read(
        path,
        RecordedArm.without_model(2),
        column_mapping([cell for option in typed for cell in shlex.split(option)[1::2]]),
    )
    np.testing.assert_allclose(r.tau, m["tau"], rtol=1e-9)


def test_stamps_that_are_rounded_too_coarsely(tmp_path, capsys):
    """No option helps, and none is said."""
    m = motion()
    named("t,q1,q2,tau1,tau2", "t", "q", "tau")(tmp_path / "a.csv", {**m, "t": np.floor(m["t"] * 250) / 250})
    status, said = inspected(capsys, tmp_path / "a.csv")
    assert status == 1
    assert "t does not increase in 2000 of 3999 steps; expected seconds that increase with each sample" in said[-1]
    assert "--" not in said[-1]


def test_a_folder_is_refused_for_what_it_is(tmp_path, capsys):
    """Its name stands once."""
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text('{"features": {}}')
    status, said = inspected(capsys, tmp_path)
    assert status == 2
    assert said[-1].startswith(f"{tmp_path}: is a LeRobot data set without Parquet files")


def test_another_field_is_no_correction(capsys):
    """A later sign or unit of a field counts; two fields for one signal are a mistake."""
    assert column_mapping(["t=stamp", "q1=a", "t=stamp [ns]", "q1=-a"]) == {"t": "stamp [ns]", "q1": "-a"}
    status = output.run(main.app, ["inspect", "run.csv", "--map", "q1=a", "--map", "q1=b"])
    assert (status, capsys.readouterr().err.strip()) == (2, "--map q1: given twice")
