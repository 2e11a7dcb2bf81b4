"""The page of a result of which only the document is left."""

from __future__ import annotations

from pathlib import Path

from runtime.documents.diagnosis import ImprovementDocument
from runtime.documents.fits import CompareDocument, IdentifyDocument
from runtime.documents.parts import given
from runtime.documents.replays import ReplayDocument
from runtime.plain_json import plain
from runtime.report import fits, loop, origin, replays
from runtime.report.page.html import ReportPage
from runtime.report.page.reports import TAGS, PageVerdict, headline_of, origin_group
from runtime.report.sections import Group, Section, texts
from runtime.report.summary import LoopDocument


def of_document(document: LoopDocument | IdentifyDocument | ReplayDocument) -> ReportPage:
    """What the terminal prints, as a page without plots."""
    provenance = given(document.provenance)
    answer = _verdict_of(document)
    name = "" if provenance is None or provenance.model is None else Path(provenance.model.typed).stem
    headline, further = headline_of(answer.sentence)
    return ReportPage(
        title=f"{name}: {answer.tag}".removeprefix(": "),
        model=name,
        kind=answer.kind,
        tag=answer.tag,
        made="" if provenance is None else origin.made(provenance),
        headline=headline,
        short=[*further, *texts(filter(None, [answer.more]))],
        groups=[Group("Result", tuple(_sections(document)), "result"), *origin_group(provenance)],
        drawings={},
        document=plain(document),
    )


def _sections(document: LoopDocument | IdentifyDocument | ReplayDocument) -> list[Section]:
    if isinstance(document, ReplayDocument):
        return replays.sections(document)
    return fits.identification(document) if isinstance(document, IdentifyDocument) else loop.sections(document)


def _verdict_of(document: LoopDocument | IdentifyDocument | ReplayDocument) -> PageVerdict:
    """The answer at the head of a document's page."""
    if isinstance(document, ReplayDocument):
        own = [step for step in document.steps if step.player == "tendon"]
        return PageVerdict("clean", "replay", replays.headline(own), "")
    if isinstance(document, CompareDocument):
        every = "; ".join(map(fits.joint_in_short, document.joints))
        return PageVerdict("comparison", TAGS["comparison"], every, "")
    if document.verdict == "fitted":
        return PageVerdict("comparison", document.verdict, document.reason, "")
    kind = "more" if isinstance(document, ImprovementDocument) and document.more_is_left else document.verdict
    return PageVerdict(kind, TAGS[kind], document.reason, "")
