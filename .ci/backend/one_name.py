"""The build backend: a wheel with one name in site-packages, `tendon`; the sources keep the names of their folders.

The sources import `runtime`, `symbolic` and `codegen`, also where they are installed for editing. Installed beside
everybody's packages these names would clash, so a wheel has them inside `tendon`, and its imports name them there. All
else is setuptools'. Relative imports cannot do it: from `runtime` to `symbolic` they need a package around both.
"""

from __future__ import annotations

import ast
import base64
import csv
import hashlib
import io
import re
import shutil
import tarfile
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

from setuptools import build_meta
from setuptools.build_meta import (
    build_editable,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
]

NAME, PACKAGES = "tendon", ("codegen", "runtime", "symbolic")
Settings = Mapping[str, Any] | None


def build_wheel(wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None) -> str:
    """The wheel of setuptools with everything in one package; its file's name."""
    with tempfile.TemporaryDirectory() as flat:
        name: str = build_meta.build_wheel(flat, config_settings, metadata_directory)
        gathered(Path(flat, name), Path(flat, "gathered"))
        shutil.move(Path(flat, "gathered"), Path(wheel_directory, name))
    return name


def build_sdist(sdist_directory: str, config_settings: Settings = None) -> str:
    """The archive of setuptools and this file, which builds the wheel from it; its file's name."""
    name: str = build_meta.build_sdist(sdist_directory, config_settings)
    path, own = Path(sdist_directory, name), Path(__file__).resolve()
    with tarfile.open(path) as given:
        members = [(member, given.extractfile(member)) for member in given.getmembers()]
        content = [(member, file.read() if file else b"") for member, file in members]
    with tarfile.open(path, "w:gz") as made:
        for member, data in content:
            made.addfile(member, io.BytesIO(data) if member.isfile() else None)
        made.add(own, Path(name.removesuffix(".tar.gz"), own.relative_to(Path.cwd().resolve())).as_posix())
    return name


def gathered(flat: Path, wheel: Path) -> None:
    """Write a wheel with the packages of a flat one inside the package NAME."""
    rows = []
    with ZipFile(flat) as read, ZipFile(wheel, "w", ZIP_DEFLATED) as written:
        record = next(name for name in read.namelist() if name.endswith(".dist-info/RECORD"))
        for item in read.infolist():
            if item.filename == record:
                continue
            data = read.read(item)
            path, inside = item.filename, item.filename.split("/")[0] in PACKAGES
            if path.endswith((".py", ".pyi")):
                data = renamed(data.decode("utf-8"), path).encode("utf-8")
            elif path.endswith(".dist-info/entry_points.txt"):
                data = re.sub(rf"(?m)= ({'|'.join(PACKAGES)})\b", rf"= {NAME}.\1", data.decode()).encode()
            elif path.endswith(".dist-info/top_level.txt"):
                data = f"{NAME}\n".encode()
            item.filename = f"{NAME}/{path}" if inside else path
            written.writestr(item, data)
            digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            rows.append((item.filename, f"sha256={digest}", len(data)))
        listed = io.StringIO()
        csv.writer(listed, lineterminator="\n").writerows([*rows, (record, "", "")])
        written.writestr(record, listed.getvalue())


def renamed(source: str, path: str) -> str:
    """A module that imports the packages from inside NAME. Raises ValueError for `import runtime`, which binds it."""
    lines = source.split("\n")
    for node in ast.walk(ast.parse(source, path)):
        if isinstance(node, ast.Import):
            wrong = [name.name for name in node.names if name.name.split(".")[0] in PACKAGES]
            if wrong:
                raise ValueError(f"{path} line {node.lineno}: import {wrong[0]}; write: from {wrong[0]} import ...")
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in PACKAGES and not node.level:
            line = lines[node.lineno - 1]
            lines[node.lineno - 1] = line.replace(f"from {node.module} ", f"from {NAME}.{node.module} ", 1)
    return "\n".join(lines)
