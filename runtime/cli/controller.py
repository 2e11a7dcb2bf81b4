"""`tendon init --controller`: what the controller of an arm lacks, proposed and, if asked for, written."""

from __future__ import annotations

from pathlib import Path

from runtime.cli.inputs import check_own, opened
from runtime.cli.output import emit
from runtime.documents.models import InitControllerDocument, ProposedEntry
from runtime.workspace.names import UsageError


def init_controller(
    model: Path, out: Path | None, write: bool, *, new_gains: bool, effects: Path | None, json: str | None
) -> None:
    """Propose; into the model file (write), into a copy (out), or on the terminal alone. Raises UsageError."""
    from runtime import files
    from runtime.report import models, terminal
    from runtime.workspace.proposing import propose_controller

    if write and out is not None:
        raise UsageError("--write changes the model file and --out writes a copy; leave one of them out")
    if write:
        check_own(model)
    if out is not None and out.exists():
        raise UsageError(f"{out}: already exists; choose another name")
    source = opened(model, effects)
    with terminal.working("deriving the arm and sampling its poses"):
        found = propose_controller(source, new_gains)
    document = InitControllerDocument(
        model=str(model),
        out=str(source.path if write else out) if write or out is not None else None,
        name=found.edits.arm.name,
        bandwidth=found.loop.bandwidth,
        limit=found.loop.why,
        proposed=[
            ProposedEntry(
                joint=p.joint, key=".".join((*p.table, p.key)), value=p.value, unit=found.edits.unit(p), why=p.why
            )
            for p in found.values
        ],
    )
    if write:
        found.edits.write()
    elif out is not None:
        files.replace(out, found.edits.text.encode())
    emit(json, document, terminal.printer(models.controller))
