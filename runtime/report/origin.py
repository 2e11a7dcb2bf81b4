"""Sections of what a result was made from."""

from __future__ import annotations

from runtime.documents.diagnosis import CommandEntry
from runtime.documents.provenance import Provenance
from runtime.report.sections import Commands, Facts, Section, table, words


def made(provenance: Provenance) -> str:
    """When a result was made and by which version, in a few words."""
    return f"{provenance.date.replace('T', ' ').replace('Z', ' UTC')}, Tendon {provenance.version}"


def sections(provenance: Provenance) -> list[Section]:
    """Date, version and command of a result, and every file with its full name and hash."""
    rows = [(part, file.path, file.sha256 or "no file") for part, file in provenance.files]
    return [
        Facts((("made", made(provenance)), ("in the folder", provenance.folder))),
        *([Commands((CommandEntry(what="made it", command=provenance.command),))] if provenance.command else []),
        table(("file", words("full name"), words("SHA-256")), rows),
    ]
