"""The document of each verb, its JSON schema, and the guide's table of keys.

`python -m runtime.documents.verbs` writes the table anew; a test holds it up to date.
"""

from __future__ import annotations

from json import dumps
from pathlib import Path
from typing import Any

import msgspec

from runtime import files
from runtime.documents.diagnosis import DiagnosisDocument, ImprovementDocument
from runtime.documents.experiments import ExportedMotionDocument, FirstMotionDocument
from runtime.documents.fits import CompareDocument, IdentifyDocument, StatisticsFitDocument
from runtime.documents.generated import AddDocument, FirmwareDocument, GenerateDocument, VerifyDocument
from runtime.documents.models import (
    EffectDocument,
    EffectsDocument,
    ExportDocument,
    ImportDocument,
    InitControllerDocument,
    InitDocument,
    InitScenarioDocument,
)
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
from runtime.documents.replays import ReplayDocument

BY_VERB: dict[str, type[Document]] = {
    "init": InitDocument,
    "inspect": InspectDocument,
    "identify": IdentifyDocument,
    "compare": CompareDocument,
    "diagnose": DiagnosisDocument,
    "improve": ImprovementDocument,
    "replay": ReplayDocument,
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
OR_ELSE: dict[str, tuple[type[Document], ...]] = {
    "effects": (EffectDocument,),
    "experiment": (FirstMotionDocument,),
    "export": (ExportedMotionDocument,),
    "identify": (StatisticsFitDocument,),
    "init": (InitControllerDocument, InitScenarioDocument),
    "optimize": (InfeasibleDocument,),
}
"""A verb's other documents: of one effect by its name, without rivals, of a motion, with --statistics, with
--controller or --scenario, and where there is no plan."""
KEYS = Path(__file__).parent / "KEYS.md"


def documents(verb: str) -> list[type[Document]]:
    """What `tendon VERB --json` may write."""
    return [BY_VERB[verb], *OR_ELSE.get(verb, ())]


def schema(verb: str) -> dict[str, object]:
    """JSON schema of what `tendon VERB --json` writes."""
    references, components = msgspec.json.schema_components(documents(verb), ref_template="#/$defs/{name}")
    root = {"anyOf": list(references)} if len(references) > 1 else references[0]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **root, "$defs": components}


def table_of_keys() -> str:
    """Keys, units and meaning of every object in the documents, as Markdown."""
    written = list(dict.fromkeys(kind for verb in BY_VERB for kind in documents(verb)))
    _, components = msgspec.json.schema_components(written, ref_template="{name}")
    first = [kind.__name__ for kind in written]
    lines = [
        "# Keys of `--json`",
        "",
        "Every object that a verb writes with `--json`, with type, unit and meaning of its keys. `?` marks a key that "
        "may be absent; a number that is not finite is null. `tendon schema VERB` prints the same as JSON schema. "
        "Generated from `runtime/documents/` (`python -m runtime.documents.verbs`).",
        *table(("verb", "object", "what it is"), [_of_verb(verb, components) for verb in BY_VERB]),
    ]
    for name in [*first, *sorted(set(components) - set(first))]:
        component = components[name]
        required = component.get("required", [])
        rows = [
            (
                f"`{key}`{'' if key in required else '?'}",
                _type(entry),
                *(entry.get(k, "") for k in ("unit", "description")),
            )
            for key, entry in component["properties"].items()
        ]
        users = [other for other, keys in components.items() if f'"{name}"' in dumps(keys["properties"])]
        part_of = f" Part of {', '.join(map(_link, users))}." if users else ""
        lines += ["", f"## {name}", "", f"{_summary(component)}.{part_of}"]
        lines += table(("key", "type", "unit", "meaning"), rows)
    return "\n".join(lines) + "\n"


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    """Lines of a table in Markdown, after an empty one."""
    first, *others = ("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in (head, *rows))
    return ["", first, "|" + "---|" * len(head), *others]


def _of_verb(verb: str, components: Any) -> tuple[str, str, str]:
    names = [kind.__name__ for kind in documents(verb)]
    return f"`tendon {verb}`", " or ".join(map(_link, names)), _summary(components[names[0]])


def _summary(component: Any) -> str:
    return str(component.get("description", "")).partition(":")[0].rstrip(".")


def _link(name: str) -> str:
    return f"[{name}](#{name.lower()})"


def _type(entry: Any) -> str:
    """A JSON type in a few characters."""
    if "anyOf" in entry:
        return " or ".join(_type(part) for part in entry["anyOf"])
    if "$ref" in entry:
        return _link(entry["$ref"])
    if "enum" in entry:
        return ", ".join(f"`{value}`" for value in entry["enum"])
    if entry.get("type") == "array":
        inside = entry.get("items") or (*entry.get("prefixItems", ()), {})[0]
        return f"list of {_type(inside)}"
    if entry.get("type") == "object":
        return f"name → {_type(entry.get('additionalProperties', {}))}"
    return str(entry.get("type", "any"))


if __name__ == "__main__":
    files.replace(KEYS, table_of_keys().encode())
