"""The command line: exit statuses, JSON alone, one line for every mistake, and nothing written then."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from codegen import disk
from runtime import files
from runtime.cli import generate, output
from runtime.cli.main import app
from runtime.cli.verbs import GROUPS, VERBS, command
from runtime.version import VERSION
from runtime.workspace.generated import render_all
from runtime.workspace.names import UsageError
from runtime.workspace.source import CompiledArm, Source
from tests import one_joint
from tests.runtime.conftest import Run

DRIVE = one_joint.model_text(
    "[joint.effects.coulomb_asymmetric]   # not known yet\n[joint.effects.viscous]\n",
)


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder to work in, with the drive's model in it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drive.toml").write_text(DRIVE)
    return tmp_path


@pytest.fixture
def run(here, tendon: Run) -> Run:  # noqa: ARG001
    return tendon


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """A short recording of the drive with Stribeck friction hidden in it."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "drive.toml").write_text(DRIVE)
    path = folder / "run.csv.gz"
    hide = "stribeck@1:torque=0.6,speed=0.15"
    arguments = ["simulate", str(folder / "drive.toml"), "--out", str(path), "--hide", hide, "--seconds", "20"]
    assert output.run(app, [*arguments, "--json", str(folder / "truth.json")]) == 0
    return path


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below, with its bytes."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def refused(run: Run, here: Path, *arguments: object) -> str:
    """The one line of a call that must fail with status 2 and write nothing."""
    before = tree(here)
    status, out, err = run(*arguments)
    assert (status, out) == (2, "")
    assert err.endswith("\n")
    assert err.count("\n") == 1
    assert err.strip().isprintable()
    assert tree(here) == before
    return err.strip()


# --- help and usage ---


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help_with_an_example(run, verb):
    status, out, err = run(verb, "--help")
    assert (status, err) == (0, "")
    assert VERBS[verb].summary in " ".join(out.split())
    assert f"Example: tendon {verb}" in out
    assert ("--json" in out) == (verb != "studio")


def test_the_version(run):
    assert run("--version")[:2] == (0, f"tendon {VERSION}\n")


@pytest.mark.parametrize(
    ("typed", "proposed"),
    [
        ("dia", ["diagnose"]),
        ("compare v", ["vishard4"]),
        ("compare dr", ["drive", "drive.toml"]),
        ("compare nowhere/x", []),
        ("init --like pa", ["panda"]),
        ("optimize scen", ["scenario1", "scenario2"]),
        ("effects visc", ["viscous", "viscous_asymmetric", "viscous_cubic", "viscous_power"]),
        ("add drive.toml stri", ["stribeck"]),
        ("simulate vishard4 --hide stri", [f"stribeck@{k}" for k in (1, 2, 3, 4)]),
        ("experiment drive.toml --between payl", ["payload"]),
        ("simulate bad.toml --hide stri", ["stribeck"]),
    ],
)
def test_completion_of_the_shell(here, typed, proposed):
    (here / "bad.toml").write_text("mass = ")
    words = {"COMP_WORDS": f"tendon {typed}", "COMP_CWORD": str(len(typed.split()))}
    code = "from runtime.cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"_TENDON_COMPLETE": "complete_bash"} | words,
        capture_output=True,
        text=True,
        check=False,
    )
    assert sorted(done.stdout.split()) == proposed


@pytest.mark.parametrize("verb", VERBS)
def test_the_usage_says_what_may_be_left_out(run, verb):
    arguments = [p for p in command(verb).params if p.param_type_name == "argument"]
    assert all((p.metavar[0] == "[") != p.required for p in arguments)
    usage = " ".join([f"Usage: tendon {verb} [OPTIONS]", *(p.metavar for p in arguments)])
    assert run(verb, "--help")[1].splitlines()[0] == usage


def test_help_lists_the_verbs_by_group_and_cuts_no_sentence(run):
    status, out, err = run()
    assert (status, err) == (0, "")
    assert re.findall(r"^(\S.*):$", out, re.MULTILINE)[1:] == list(GROUPS)
    listed = dict(re.findall(r"^  ([a-z]+) +([A-Z].*\.)$", out, re.MULTILINE))
    assert listed == {name: verb.summary for name, verb in VERBS.items()}


def test_a_package_that_is_not_installed_is_named(here):
    """As in an installation without all that the wheel requires."""
    code = (
        "import sys; sys.modules['casadi'] = sys.modules['elftools'] = sys.modules['matplotlib'] = None\n"
        "from runtime.cli import main, output\nsys.exit(output.run(main.app, sys.argv[1:]))"
    )

    def without(*arguments):
        return subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False)

    done = without("simulate", "drive.toml", "--out", "run.csv")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("this needs casadi, which is not installed; run: ")
    assert done.stderr.splitlines()[-1].endswith("-m pip install casadi")
    assert sorted(path.name for path in here.iterdir()) == ["drive.toml"]
    assert without("init", "--like", "emps", "--out", "emps.toml").returncode == 0


def test_help_imports_no_verb_and_nothing_heavy():
    code = (
        "import sys; from runtime.cli import main, output; output.run(main.app, ['--help'])\n"
        "print(*(m for m in sys.modules if m in ('sympy', 'scipy', 'casadi', 'numpy', 'matplotlib', 'rich.console')"
        " or m.startswith(('runtime.', 'symbolic', 'codegen'))))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    imported = set(done.stdout.splitlines()[-1].split())
    assert imported <= {
        *(
            "runtime.version",
            "runtime.cli",
            "runtime.cli.main",
            "runtime.cli.output",
            "runtime.cli.places",
            "runtime.cli.verbs",
        ),
        *("runtime.documents", "runtime.documents.parts", "runtime.interruption", "runtime.plain_json"),
        *("runtime.workspace", "runtime.workspace.names", "runtime.workspace.writing", "symbolic"),
        *("symbolic.model_file", "symbolic.model_file.checks"),
    }


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["nonsense"], "No such command 'nonsense'. (see tendon --help)"),
        (["compar"], "there is no verb 'compar'; did you mean compare? (see tendon --help)"),
        (["generate"], "tendon generate: Missing argument 'MODEL'"),
        (["generate", "drive.toml", "--nonsense"], "No such option"),
        (["compare", "drive.toml"], "Missing argument 'RECORDING"),
        (["add", "drive.toml", "stribeck", "--joint", "x"], "drive.toml: there is no joint x; expected 1 to 1"),
        (["verify", "drive.toml", "--samples", "0"], "Invalid value for '--samples'"),
        (["simulate", "drive.toml"], "Missing option '--out'"),
        (
            ["compare", "drive.toml", "run.csv", "--map", "q1"],
            "--map q1: expected NAME=COLUMN, for example --map q1",
        ),
        (["compare", "drive.toml", "run.csv", "--map", "q1=a", "--map", "q1=b"], "--map q1: given twice"),
        (["improve", "drive.toml", "run.csv", "--write", "--out", "x.toml"], "--write and --out exclude each other"),
        (["improve", "drive.toml", "a.csv", "--held-out", "./a.csv"], "a.csv: is fitted and held out; give it once"),
    ],
)
def test_usage(run, here, arguments, expected):
    assert expected in refused(run, here, *arguments)


# --- bad input ---


@pytest.mark.parametrize(
    "verb", ["generate", "verify", "add", "identify", "compare", "diagnose", "improve", "simulate"]
)
@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("effects.viscous", "effects.viscos", 'drive.toml: joint 1: unknown effect "viscos"; did you mean "viscous"?'),
        ("mass = 2.0", "mass = -2.0", "drive.toml: joint 1: link: mass is -2; expected a number in kg >= 0"),
        ('"drive1"', '"x; system(\\"rm\\")"', 'drive.toml: name "x; system(\\"rm\\")" is no C identifier'),
        ("mass = 2.0", "mass = ", "drive.toml line 10: not valid TOML at column"),
    ],
)
def test_bad_models(run, here, verb, old, new, expected):
    (here / "drive.toml").write_text(DRIVE.replace(old, new))
    rest = {"add": ["stribeck", "--joint", "1"], "simulate": ["--out", "x.csv"], "generate": [], "verify": []}
    line = refused(run, here, verb, "drive.toml", *rest.get(verb, ["absent.csv"]))
    assert expected in line


@pytest.mark.parametrize("verb", ["identify", "compare", "diagnose", "improve"])
def test_bad_recordings(run, here, verb):
    assert refused(run, here, verb, "drive.toml", "absent.csv").startswith("absent.csv: no such file")
    good = [f"{k / 1000},{k % 7},{k % 5}" for k in range(900)]
    good[810] = "0.810,nan,1"
    (here / "run3.csv").write_text("\n".join(["t,q1,tau1", *good]))
    expected = "run3.csv line 812: q1 is NaN; drop the row or pass --allow-gaps"
    assert refused(run, here, verb, "drive.toml", "run3.csv") == expected
    assert "unknown unit" in refused(run, here, verb, "drive.toml", "run3.csv", "--map", "q1=q1 [parsec]")


@pytest.mark.parametrize("verb", ["identify", "compare", "diagnose", "improve"])
def test_targets_are_checked_before_the_work(run, here, recorded, verb):
    assert "there is no directory absent" in refused(run, here, verb, "drive.toml", recorded, "--json", "absent/x.json")
    assert "is a directory; expected a file" in refused(run, here, verb, "drive.toml", recorded, "--json", ".")
    if verb != "identify":
        line = refused(run, here, verb, "drive.toml", recorded, "--report", "drive.toml")
        assert line == "drive.toml: is a file; expected a directory to write into"


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("import nonsense_that_is_not_there", "the file of effects failed: ModuleNotFoundError"),
        ("EFFECTS = 3", "EFFECTS is a int; make it a tuple"),
        ("x = (", "the file of effects failed: SyntaxError"),
        ("raise SystemExit('bye')", "the file of effects failed: SystemExit: bye"),
    ],
)
def test_bad_files_of_effects(run, here, content, expected):
    (here / "mine.py").write_text(content)
    assert expected in refused(run, here, "effects", "--effects", "mine.py")
    assert "cannot read the file of effects" in refused(run, here, "effects", "--effects", "absent.py")


WORDS = st.sampled_from(
    [
        *sorted(VERBS.keys() - {"demo", "paper", "studio"}),
        "--json",
        "-",
        "--map",
        "--effects",
        "--joint",
        "1",
        "drive.toml",
        "--check",
    ]
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(WORDS | st.text(max_size=6), min_size=1, max_size=4))
def test_any_arguments_end_with_a_status(run, arguments):
    status, _, err = run(*arguments)
    assert status in (0, 1, 2)
    assert err.count("\n") == (1 if status == 2 else 0)


# --- generate, add, effects, verify ---


def test_verify_says_first_whether_all_is_equal(run):
    status, out, _ = run("verify", "drive.toml", "--samples", "1")
    assert status == 0
    assert re.match(r"Equal: \d+ comparisons at 1 point each; \d+ test vectors with --json\.\n", out)


def test_compare_says_in_which_unit(run, recorded):
    out = run("compare", "drive.toml", recorded)[1]
    assert re.search(r"residual rms \[N m\] +of the torque +noise floor \[N m\]", out)


def test_generate_and_check(run, here):
    status, out, _ = run("generate", "drive.toml", "--check")
    assert status == 1
    assert "generated/drive1/drive1_f32.c: missing" in out
    assert not (here / "generated").exists()
    status, out, _ = run("generate", "drive.toml", "--json", "-")
    document = json.loads(out)
    assert status == 0
    assert {"drive1_f32.c", "drive1_f64.h", "drive1_casadi.py", "metadata.json"} <= set(document["files"])
    assert all((here / "generated" / "drive1" / name).is_file() for name in document["files"])
    assert (here / "generated" / "effects" / "effects_f32.c").is_file()
    assert run("generate", "drive.toml", "--check")[0] == 0
    first = tree(here)
    run("generate", "drive.toml")
    assert tree(here) == first
    (here / "drive.toml").write_text(DRIVE.replace("0.30", "0.31").replace('"drive1"  ', '"drive1"'))
    status, out, _ = run("generate", "drive.toml", "--check", "--json", "-")
    assert status == 1
    assert json.loads(out)["stale"]


OWN_EFFECT = """
from tendon.effects import Effect, Parameter, SIGNAL, parameter, units
EFFECTS = [Effect(name="mine", scope="joint", family="friction", summary="Of my own.", equation="tau = c qd",
    torque=parameter("coefficient") * SIGNAL["qd"].symbol, source="me", trace="a trace", experiment="any",
    parameters=(Parameter("coefficient", units.VISCOUS, "torque per rate"),))]
"""


def test_arms_with_other_libraries_stay_up_to_date_beside_each_other(run, here):
    """Those in space have gravity with three axes, and one has an effect of the user's own."""
    (here / "own.py").write_text(OWN_EFFECT)
    arms = (["drive.toml"], ["vishard4"], ["ur10"], ["emps", "--effects", "own.py"])
    for arm in arms:
        assert run("generate", *arm)[0] == 0
    assert [run("generate", *arm, "--check")[0] for arm in arms] == [0, 0, 0, 0]
    (here / "generated" / "effects" / "effects_f32.c").unlink()
    assert [run("generate", *arm, "--check")[0] for arm in arms] == [1, 1, 0, 0]


def test_generate_says_how_other_programs_use_it(run, here):
    out = run("generate", "drive.toml", "--rust", "--out", "code")[1].splitlines()[-1]
    header, package, folder, module = re.fullmatch(
        r"C\+\+: (\S+), by CMake find_package\((\w+)\); Python: pip install (\S+); Rust: (\S+)", out
    ).groups()
    assert (here / "code" / header).is_file()
    assert f"project({package} " in (here / "code" / "CMakeLists.txt").read_text()
    assert (here / folder / "pyproject.toml").is_file()
    assert folder.startswith("./")  # else pip looks for it in an index
    assert (here / "code" / module).is_file()


def test_two_models_of_one_name_do_not_share_a_folder(run, here):
    assert run("generate", "drive.toml")[0] == 0
    assert run("generate", f"../{here.name}/drive.toml")[0] == 0
    (here / "other.toml").write_text(DRIVE.replace("0.30", "0.31"))
    line = refused(run, here, "generate", "other.toml")
    assert line.startswith("generated/drive1: holds what was generated from drive.toml, which has the same name")
    assert "same name" in refused(run, here, "add", "other.toml", "stribeck", "--joint", "1")
    assert run("generate", "other.toml", "--out", "generated/drive1")[0] == 0  # it is asked for
    assert "from other.toml" in refused(run, here, "generate", "drive.toml")
    (here / "other.toml").unlink()
    assert run("generate", "drive.toml")[0] == 0


def test_generate_elsewhere(run, here):
    assert run("generate", "drive.toml", "--out", "firmware/model")[0] == 0
    assert (here / "firmware" / "model" / "drive1_f64.c").is_file()
    assert (here / "firmware" / "effects" / "effects_f64.c").is_file()
    assert "choose another --out" in refused(run, here, "generate", "drive.toml", "--out", "firmware/effects")
    assert "is a file" in refused(run, here, "generate", "drive.toml", "--out", "drive.toml")


def test_add_keeps_the_layout_and_regenerates(run, here):
    os.chmod(here / "drive.toml", 0o640)
    status, out, err = run("add", "drive.toml", "stribeck", "--joint", "1")
    # On a slow machine deriving takes long enough to be said.
    assert (status, set(err.splitlines()) - {"deriving drive1 …"}) == (0, set())
    assert "stribeck@1" in out
    assert (here / "drive.toml").read_text() == DRIVE + "[joint.effects.stribeck]\n"
    assert (here / "drive.toml").stat().st_mode & 0o777 == 0o640
    assert run("generate", "drive.toml", "--check")[0] == 0
    assert "already there" in refused(run, here, "add", "drive.toml", "stribeck", "--joint", "1")


def test_generate_does_not_undo_an_add(run, here, monkeypatch):
    """It has derived what the file said before."""

    def meanwhile(*given):
        found = render_all(*given)
        monkeypatch.setattr(generate, "render_all", render_all)
        assert run("add", "drive.toml", "stribeck", "--joint", "1")[0] == 0
        return found

    monkeypatch.setattr(generate, "render_all", meanwhile)
    status, _, err = run("generate", "drive.toml")
    assert status == 2
    assert err.splitlines()[-1] == "drive.toml: was changed by someone else meanwhile; nothing was written, try again"
    monkeypatch.setattr(generate, "render_all", render_all)
    assert run("generate", "drive.toml", "--check")[0] == 0
    assert list((here / "generated").glob(".*")) == []


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("first", [True, False], ids=["first", "later"])
def test_an_add_waits_for_a_generate_that_writes(run, monkeypatch, lock_refused, first):
    """And its files are there in the end, whether there was a folder before or not."""
    if not first:
        assert run("generate", "drive.toml")[0] == 0
    source = Source.read(Path("drive.toml"), None)
    rendered, write, writes = render_all(source, None, None), disk.write, threading.Event()

    def slow(written, directory):
        if written is rendered.files:
            writes.set()
            lock_refused.wait(files.LONGEST_WAIT)
        write(written, directory)

    monkeypatch.setattr(disk, "write", slow)
    generating = threading.Thread(target=rendered.write)
    generating.start()
    writes.wait()
    assert run("add", "drive.toml", "stribeck", "--joint", "1")[0] == 0
    generating.join()
    assert run("generate", "drive.toml", "--check")[0] == 0


def test_add_says_the_name_of_another_ripple(run, here):
    for name in ("torque_ripple", "torque_ripple_2"):
        _, out, _ = run("add", "drive.toml", "torque_ripple", "--joint", "1")
        assert f"{name}@1 added" in out
        assert f"[joint.effects.{name}]" in (here / "drive.toml").read_text()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["stribek", "--joint", "1"], 'unknown effect "stribek"; did you mean "stribeck"?'),
        (["stribeck"], "say which with --joint 1"),
        (["stribeck", "--joint", "2"], "there is no joint 2"),
        (["gravity", "--joint", "1"], "acts on the whole arm; drop --joint"),
        (["plate"], "add [contact] with x first"),
        (["stribeck", "--joint", "1", "--out", "drive.toml"], "is a file; expected a directory"),
    ],
)
def test_add_refuses(run, here, arguments, expected):
    assert expected in refused(run, here, "add", "drive.toml", *arguments)


def test_effects(run, here):
    status, out, _ = run("effects")
    assert status == 0
    assert "stribeck" in out
    names = [e["name"] for e in json.loads(run("effects", "--json", "-")[1])["effects"]]
    assert {"coulomb", "stribeck", "lugre", "plate"} <= set(names)
    assert json.loads(run("effects", "lugre", "--json", "-")[1])["name"] == "lugre"
    expected = 'unknown effect "stribek"; did you mean "stribeck"? (tendon effects lists them all)'
    assert refused(run, here, "effects", "stribek") == expected


# --- recordings ---


def test_simulate_tells_what_it_hid(recorded):
    truth = json.loads((recorded.parent / "truth.json").read_text())
    assert [(e["effect"], e["joint"]) for e in truth["effects"] if e["hidden"]] == [("stribeck", 1)]


@pytest.mark.parametrize("hide", ["stribek@1", "stribeck@2", "stribeck", "stribeck@1:torque", "stribeck@1:torque=x"])
def test_simulate_refuses(run, here, hide):
    assert hide.partition(":")[0] in refused(run, here, "simulate", "drive.toml", "--out", "x.csv", "--hide", hide)


def test_a_mistyped_effect_is_told_before_the_model_is_built(run, here, monkeypatch):
    monkeypatch.setattr(CompiledArm, "model", lambda *_: pytest.fail("built"))
    Path("x.json").write_text("{}")
    simulated = ("execute", "drive.toml", "x.json", "--on", "simulation")
    for call in (("simulate", "drive.toml", "--out", "x.csv"), simulated):
        line = refused(run, here, *call, "--hide", "stribek@1")
        assert 'there is no effect "stribek"; did you mean "stribeck"?' in line
        line = refused(run, here, *call, "--hide", "stribeck@1:torqe=1")
        assert '"stribeck" has no parameter "torqe"; did you mean "torque"?' in line


def test_identify_says_what_was_assumed_stated_and_written(run, here, recorded):
    (here / "drive.toml").write_text(DRIVE + "coefficient = 1.5\n")
    status, out, _ = run("identify", "drive.toml", recorded, "--write")
    assert status == 0
    assert "Skew between torque and motion: " in out
    assert " samples (given)" not in out
    assert re.search(r"viscous: coefficient +1\.5 \(contradicts\) +[\d.]+", out)
    assert re.search(r"coulomb_asymmetric: positive +– +[\d.]+", out)
    assert out.splitlines()[-1] == "Written to drive.toml: J1, coulomb_asymmetric@1, viscous@1."
    _, out, _ = run("identify", "drive.toml", recorded, "--skew", "0.5")
    assert "0.5 samples (given)" in out
    assert "Written" not in out
    for beyond in ("nan", "1e300", "-4"):
        status, out, err = run("identify", "drive.toml", recorded, "--skew", beyond)
        assert (status, out) == (2, "")
        assert "Invalid value for '--skew'" in err


def test_identify_writes_values_where_they_belong(run, here, recorded):
    status, out, _ = run("identify", "drive.toml", recorded, "--json", "-")
    assert status == 0
    document = json.loads(out)
    assert document["inertial"][0]["name"] == "J1"
    assert (here / "drive.toml").read_text() == DRIVE
    status, out, _ = run("identify", "drive.toml", recorded, "--write")
    assert status == 0
    assert "J1" in out
    text = (here / "drive.toml").read_text()
    assert all(comment in text for comment in ("# the bench", "# not known yet"))
    source = Source.read(Path("drive.toml"), None)
    assert source.arm().inertial["J1"] == pytest.approx(document["inertial"][0]["fit"], rel=1e-6)  # 7 digits
    assert set(source.arm().joints[0].effects["coulomb_asymmetric"]) == {"positive", "negative"}
    assert Source.read(Path("drive.toml"), None).compiled.model().lump_values[0] == pytest.approx(
        document["inertial"][0]["fit"], rel=1e-6
    )


def test_diagnose_names_the_effect_and_commands_that_add_it(run, here, recorded):
    """To a copy of an arm of Tendon; nothing is written."""
    status, out, _ = run("diagnose", "drive", recorded, "--json", "-")
    document = json.loads(out)
    assert (status, document["verdict"]) == (0, "effect")
    assert [(f["effect"], f["joint"]) for f in document["findings"]] == [("stribeck", 1)]
    lines = [c["command"] for c in document["commands"]]
    assert lines[:2] == ["tendon init --like drive --out drive.toml", "tendon add drive.toml stribeck --joint 1"]
    assert tree(here) == {"drive.toml": DRIVE.encode()}


def test_improve_works_on_a_copy_unless_told(run, here, recorded):
    status, out, _ = run("improve", "drive.toml", recorded, "--out", "better.toml", "--json", "result.json")
    assert status == 0
    assert "+ stribeck@1" in out
    assert (here / "drive.toml").read_text() == DRIVE
    history = json.loads((here / "result.json").read_text())["history"]
    assert [step["added"] for step in history] == [None, "stribeck@1"]
    assert history[1]["rms"][0] < history[0]["rms"][0]
    better = Source.read(Path("better.toml"), None).arm()
    assert better.joints[0].effects["stribeck"]["torque"] == pytest.approx(0.6, rel=0.1)  # noise of 3 % over 20 s
    assert "# the bench" in (here / "better.toml").read_text()


# --- files ---


def test_a_model_that_changed_meanwhile_is_not_overwritten(here):
    source = Source.read(Path("drive.toml"), None)
    (here / "drive.toml").write_text(DRIVE + "# edited\n")
    with pytest.raises(UsageError, match="was changed by someone else meanwhile"):
        source.edits.write()
    assert (here / "drive.toml").read_text() == DRIVE + "# edited\n"


def test_replacing_keeps_permissions_and_links(tmp_path):
    target, link = tmp_path / "real.toml", tmp_path / "link.toml"
    target.write_bytes(b"old")
    os.chmod(target, 0o600)
    link.symlink_to(target)
    files.replace(link, b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"
    assert target.stat().st_mode & 0o777 == 0o600
    files.replace("/dev/null", b"gone")
    assert Path("/dev/null").is_char_device()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link.toml", "real.toml"]


def test_a_failed_replacement_leaves_nothing(tmp_path):
    with pytest.raises(OSError, match="absent"):
        files.replace(tmp_path / "absent" / "x", b"data")
    (tmp_path / "d").mkdir()
    with pytest.raises(OSError, match="directory"):
        files.replace(tmp_path / "d", b"data")
    assert [p.name for p in tmp_path.iterdir()] == ["d"]


def test_json_knows_no_nan(capsys):
    import numpy as np

    output.emit("-", {"a": np.float64("nan"), "b": np.array([1.0, np.inf]), "c": (np.int64(1), None)}, print)
    assert json.loads(capsys.readouterr().out) == {"a": None, "b": [1.0, None], "c": [1, None]}


def test_as_a_program(here):
    tendon = [sys.executable, "-c", "from runtime.cli.main import main; main()"]
    done = subprocess.run([*tendon, "generate", "absent.toml"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "absent.toml: no such file; expected a model file in TOML\n"
    assert sorted(p.name for p in here.iterdir()) == ["drive.toml"]


def test_a_reader_that_goes_away_is_no_error(here):  # noqa: ARG001
    command = f"{sys.executable} -c 'from runtime.cli.main import main; main()' effects --json - | head -c 10"
    done = subprocess.run(["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


# --- arms and scenarios by name ---


def test_an_arm_of_tendon_is_known_by_its_name(run, here):
    assert run("identify", "drives", "absent.csv")[2] == (
        '"drives" is no model file here and no arm of Tendon; expected a file, or one of '
        "drive, emps, panda, ur10, vishard4\n"
    )
    (here / "drive").mkdir()  # a folder is no model file
    assert run("simulate", "drive", "--out", "run.csv", "--seconds", "2")[0] == 0
    (here / "vishard4").write_text(DRIVE)  # a file here comes first
    assert json.loads(run("simulate", "vishard4", "--out", "run.csv", "--seconds", "2", "--json", "-")[1])
    assert (here / "run.csv").read_text().startswith("t [s],q1 [rad],tau1 [N m]")


@pytest.mark.parametrize(
    "arguments", [("add", "stribeck", "--joint", "1"), ("identify", "run.csv", "--write"), ("improve", "r", "--write")]
)
def test_an_arm_of_tendon_is_not_written_to(run, here, arguments):
    verb, *rest = arguments
    line = refused(run, here, verb, "drive", *rest)
    assert line.startswith("drive: comes with Tendon and is not changed")
    assert "tendon init --like drive --out drive.toml" in line


def test_init_makes_a_copy_to_edit(run, here):
    shipped = Source.shipped("drive")
    status, out, _ = run("init", "--like", "drive", "--out", "mine.toml")
    assert (status, (here / "mine.toml").read_text()) == (0, shipped.text)
    assert out.startswith("mine.toml: drive, 1 joint, as in drive")
    assert run("init", "--like", "mine.toml", "--out", "second.toml", "--json", "-")[0] == 0
    assert "already exists" in refused(run, here, "init", "--like", "vishard4", "--out", "mine.toml")
    assert '"drone" is no model file' in refused(run, here, "init", "--like", "drone", "--out", "x.toml")


def test_scenarios_are_known_by_name(run, here):
    expected = '"scenario3" is no scenario file here and no scenario of Tendon; expected a file, or one of scenario1'
    assert expected in refused(run, here, "optimize", "scenario3")
    assert expected in refused(run, here, "sweep", "scenario3", "--over", "seed=0:1", "--table", "t.csv")
    (here / "scenario1").write_text("name = 1")
    assert "scenario1: " in refused(run, here, "optimize", "scenario1")
