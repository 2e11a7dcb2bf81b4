"""The document of each verb, its JSON schema, and the guide's table of keys.

`python -m runtime.documents.verbs` writes the table anew; a test holds it up to date.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from runtime import files
from runtime.documents.diagnosis import DiagnosisDocument, ImprovementDocument
from runtime.documents.fits import CompareDocument, IdentifyDocument
from runtime.documents.generated import AddDocument, FirmwareDocument, GenerateDocument, VerifyDocument
from runtime.documents.models import EffectDocument, EffectsDocument, ExportDocument, ImportDocument, InitDocument
from runtime.documents.paper import PaperDocument
from runtime.documents.parts import Document
from runtime.documents.plans import (
    ExecuteDocument,
    InfeasibleDocument,
    OptimizeDocument,
    SweepDocument,
)
from runtime.documents.provenance import ReportDocument
from runtime.documents.recordings import ExperimentDocument, InspectDocument, SimulateDocument

BY_VERB: dict[str, type[Document]] = {
    "init": InitDocument,
    "inspect": InspectDocument,
    "identify": IdentifyDocument,
    "compare": CompareDocument,
    "diagnose": DiagnosisDocument,
    "improve": ImprovementDocument,
    "demo": ImprovementDocument,
    "simulate": SimulateDocument,
    "experiment": ExperimentDocument,
    "optimize": OptimizeDocument,
    "execute": ExecuteDocument,
    "sweep": SweepDocument,
    "paper": PaperDocument,
    "generate": GenerateDocument,
    "verify": VerifyDocument,
    "effects": EffectsDocument,
    "add": AddDocument,
    "firmware": FirmwareDocument,
    "import": ImportDocument,
    "export": ExportDocument,
    "report": ReportDocument,
}
OR_ELSE: dict[str, type[Document]] = {"effects": EffectDocument, "optimize": InfeasibleDocument}
"""A verb's other document: of one effect by its name, and where there is no plan."""
KEYS = Path(__file__).parent / "KEYS.md"


def schema(verb: str) -> dict[str, object]:
    """JSON schema of what `tendon VERB --json` writes."""
    kinds = [BY_VERB[verb], *([OR_ELSE[verb]] if verb in OR_ELSE else [])]
    references, components = msgspec.json.schema_components(kinds, ref_template="#/$defs/{name}")
    root = {"anyOf": list(references)} if len(kinds) > 1 else references[0]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **root, "$defs": components}


def table_of_keys() -> str:
    """Keys, units and meaning of every object in the documents, as Markdown."""
    schemas, components = msgspec.json.schema_components(list(dict.fromkeys(BY_VERB.values())), ref_template="{name}")
    verbs: dict[str, list[str]] = {}
    for verb, document in BY_VERB.items():
        verbs.setdefault(document.__name__, []).append(f"`tendon {verb}`")
    lines = [
        "# Keys of `--json`",
        "",
        "Generated from `runtime/documents/` (`python -m runtime.documents.verbs`). An object is named by its class; "
        "`[]` is a list, `?` a key that may be absent.",
    ]
    first = [reference["$ref"] for reference in schemas]
    for name in [*first, *sorted(set(components) - set(first))]:
        component = components[name]
        summary = component.get("description", "").partition(":")[0].rstrip(".")
        where = f" ({', '.join(verbs[name])})" if name in verbs else ""
        lines += [
            "",
            f"## {name}",
            "",
            f"{summary}{where}.",
            "",
            "| key | type | unit | meaning |",
            "|---|---|---|---|",
        ]
        for key, entry in component["properties"].items():
            absent = "" if key in component.get("required", []) else "?"
            row = (f"`{key}`{absent}", _type(entry), entry.get("unit", ""), entry.get("description", ""))
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |")
    return "\n".join(lines) + "\n"


def _type(entry: Any) -> str:
    """A JSON type in a few characters."""
    if "anyOf" in entry:
        return " or ".join(_type(part) for part in entry["anyOf"])
    if "$ref" in entry:
        return f"[{entry['$ref']}](#{entry['$ref'].lower()})"
    if "enum" in entry:
        return ", ".join(f"`{value}`" for value in entry["enum"])
    if entry.get("type") == "array":
        inside = entry.get("items") or (*entry.get("prefixItems", ()), {})[0]
        return f"{_type(inside)}[]"
    if entry.get("type") == "object":
        return f"name → {_type(entry.get('additionalProperties', {}))}"
    return str(entry.get("type", "any"))


if __name__ == "__main__":
    files.replace(KEYS, table_of_keys().encode())
