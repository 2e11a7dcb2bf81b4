"""The verb that makes a controller's firmware."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from runtime.cli.opening import opened
from runtime.cli.options import EffectsFile, Json, ModelFile
from runtime.cli.output import NO, emit
from runtime.cli.places import FILLED, check_directory
from runtime.cli.rendered import own_directory

app = typer.Typer()


@app.command(epilog="Example: tendon firmware vishard4 --target cortex-m4f")
def firmware(
    model: ModelFile,
    target: Annotated[str, typer.Option(metavar="NAME", help="cortex-m4f, cortex-m7, or host.")] = "cortex-m4f",
    toolchain: Annotated[
        str | None, typer.Option(metavar="NAME", help="gcc or zig, in place of what is found first.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Default: ./generated/NAME/firmware."), FILLED] = None,
    check: Annotated[bool, typer.Option("--check", help="Write nothing; exit 1 if the files are stale.")] = False,
    effects: EffectsFile = None,
    json: Json = None,
) -> None:
    """Write the controller's firmware and compile it. Size, stack; files that do not say they are generated stay."""
    from runtime.report.terminal.pages import working

    source = opened(model, effects)
    name = source.arm().name
    directory = out if out is not None else own_directory(source, name) / "firmware"
    check_directory(directory)
    if check:
        with working(f"deriving {name}"):
            stale = source.firmware(directory).stale()
        emit(json, {"name": name, "directory": str(directory), "stale": stale}, _show_check)
        if stale:
            raise typer.Exit(NO)
        return
    with working(f"deriving {name} and compiling its firmware"):
        prepared = source.controller(target, toolchain)
        tree = source.firmware(directory)
    tree.write()
    report = _install(prepared, directory / "build" / target)
    document: dict[str, Any] = {
        "name": name,
        "directory": str(directory),
        "target": target,
        "files": sorted(tree.files),
        "kept": list(tree.kept),
        "stale": [],
        "build": report,
    }
    emit(json, document, _show)
    if not report["fits"]:
        raise typer.Exit(NO)


def _install(prepared: Path, place: Path) -> dict[str, Any]:
    """Copy what was compiled; the report that stands beside it, with the files' places."""
    import json

    from runtime import files

    report: dict[str, Any] = json.loads((prepared / "image.json").read_text("utf-8"))
    place.mkdir(parents=True, exist_ok=True)
    for name in report["outputs"]:
        files.replace(place / name, (prepared / name).read_bytes())
    files.replace(place / "image.json", (prepared / "image.json").read_bytes())
    return report | {"outputs": [str(place / name) for name in report["outputs"]]}


def _show_check(document: Mapping[str, Any]) -> None:
    from runtime.report.terminal.pages import say

    say(*(document["stale"] or [f"{document['directory']}: up to date"]))


def _show(document: Mapping[str, Any]) -> None:
    from runtime.report.terminal.pages import say

    build = document["build"]
    tools = build["toolchain"]
    say(f"{document['directory']}: {len(document['files'])} files")
    if document["kept"]:
        say(f"left as they are, yours: {', '.join(document['kept'])}")
    say(", ".join(build["outputs"]), f"compiled for {build['target']} by {tools['version']} ({tools['why']})")
    if build["stack"] is None:
        return
    stack = build["stack"]
    chain = " > ".join(f"{name} {size}" for name, size in stack["chain"])
    say(
        f"text {build['text']:,} B, data {build['data']:,} B, bss {build['bss']:,} B",
        f"worst stack {stack['worst']:,} B of {build['stack_size']:,}: {chain}; {stack['handlers']} more in a fault",
        *(f"the stack has no known bound: {why}" for why in stack["unknown"]),
        "functions for double precision, a heap or text: " + (", ".join(build["forbidden"]) or "none"),
    )
