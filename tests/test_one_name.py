"""The build backend puts everything into one package, which works without the names of the folders."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest
from sources import ROOT

SPEC = importlib.util.spec_from_file_location("one_name", ROOT / ".ci" / "backend" / "one_name.py")
assert SPEC is not None
assert SPEC.loader is not None
pytest.importorskip("setuptools", reason="the build backend stands on it")
one_name = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(one_name)

SCRIPT = """
import sys, tendon
run = tendon.simulate(tendon.load("drive"), "stribeck@1:torque=0.6,speed=0.15", seconds=20)
print(tendon.diagnose(tendon.load("drive"), run).findings[0].effect)
from tendon.effects import Effect
print(Effect.__module__, {m.split(".")[0] for m in sys.modules} & {"codegen", "runtime", "symbolic"})
"""


@pytest.fixture(scope="module")
def gathered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder into which a wheel of the sources was unpacked."""
    folder = tmp_path_factory.mktemp("wheel")
    with ZipFile(folder / "flat.whl", "w") as flat:
        homes = [(ROOT / name, ROOT) for name in one_name.PACKAGES] + [
            (ROOT / "runtime" / "import_name" / "tendon", ROOT / "runtime" / "import_name")
        ]
        for home, root in homes:
            for path in sorted(home.rglob("*")):
                named = path.relative_to(root)
                if path.is_file() and path.suffix != ".pyc" and named.parts[:2] != ("runtime", "import_name"):
                    flat.write(path, named.as_posix())
        flat.writestr("x.dist-info/entry_points.txt", "[console_scripts]\ntendon = runtime.cli.main:main\n")
        flat.writestr("x.dist-info/top_level.txt", "codegen\nruntime\nsymbolic\ntendon\n")
        flat.writestr("x.dist-info/RECORD", "")
    one_name.gathered(folder / "flat.whl", folder / "made.whl")
    with ZipFile(folder / "made.whl") as made:
        made.extractall(folder / "site")
        listed = [line.split(",")[0] for line in made.read("x.dist-info/RECORD").decode().splitlines()]
        assert sorted(listed) == sorted(made.namelist())
    return folder / "site"


def test_there_is_one_name(gathered: Path) -> None:
    assert sorted(path.name for path in gathered.iterdir()) == ["tendon", "x.dist-info"]
    assert (gathered / "x.dist-info" / "top_level.txt").read_text() == "tendon\n"
    assert "tendon = tendon.runtime.cli.main:main" in (gathered / "x.dist-info" / "entry_points.txt").read_text()


def test_it_works_under_that_name_alone(gathered: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(gathered)}

    def python(*arguments: str) -> str:
        run = subprocess.run(
            [sys.executable, *arguments], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert run.returncode == 0, run.stderr
        return run.stdout

    assert python("-c", SCRIPT).splitlines() == ["stribeck", "tendon.symbolic.effects.declaration set()"]
    assert python("-m", "tendon", "--version") == f"tendon {_version()}\n"
    assert python("-m", "tendon", "effects", "stribeck").startswith("stribeck: ")
    # The descriptions of the effects are found to be those of these sources: SymPy is not imported.
    script = "import sys, tendon; tendon.load('ur10').source.arm(); print('sympy' in sys.modules)"
    assert python("-c", script) == "False\n"


def _version() -> str:
    from runtime.version import VERSION

    return VERSION


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("from runtime import files\n", "from tendon.runtime import files\n"),
        ("if 1:\n    from symbolic.units import (\n        RATE,\n    )\n", None),
        ('"""\nfrom runtime to codegen\n"""\nfrom codegen.disk import x  # from codegen\n', None),
        ("from .runtime import x\nfrom runtimes import y\nfrom os import path\n", ""),
    ],
)
def test_imports_alone_are_renamed(source: str, expected: str | None) -> None:
    found = one_name.renamed(source, "x.py")
    if expected is None:
        changed = [(a, b) for a, b in zip(source.splitlines(), found.splitlines(), strict=True) if a != b]
        ((before, after),) = changed
        assert after == before.replace("from ", "from tendon.", 1)
    else:
        assert found == (expected or source)


def test_an_import_that_binds_a_package_is_refused() -> None:
    with pytest.raises(ValueError, match=r"a\.py line 2: import runtime\.model; write: from runtime\.model import"):
        one_name.renamed("import os\nimport runtime.model\n", "a.py")


def test_all_sources_can_be_renamed() -> None:
    for path in (path for name in one_name.PACKAGES for path in (ROOT / name).rglob("*.py")):
        compile(one_name.renamed(path.read_text(encoding="utf-8"), str(path)), str(path), "exec")
