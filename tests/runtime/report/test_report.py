"""The report: whole on one page, the same bytes twice, safe with any text, and with the figures of the result."""

from __future__ import annotations

import base64
import hashlib
import itertools
import json
import re
import shlex
from collections.abc import Callable
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from runtime import wording
from runtime.diagnosis import credibility, detection_limits
from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.gates import EDGE, REST, GateResult
from runtime.diagnosis.ranking import NOT_RANKED, Ranking
from runtime.diagnosis.score import Evidence
from runtime.diagnosis.steps import Errors, RepeatingResidual, SearchWork, Step, Trail
from runtime.diagnosis.verdict import Diagnosis, JointVerdict
from runtime.documents.diagnosis import RankedCandidate
from runtime.documents.parts import EffectAt
from runtime.identification.compare import Comparison, as_written, compare, series, structure_shares
from runtime.identification.estimate import Estimate
from runtime.identification.fitting import fit_motion
from runtime.identification.identify import prepared
from runtime.loop.improve import Improvement, floors
from runtime.model.loader import Model
from runtime.model.terms import Term, structure
from runtime.motion import spectra
from runtime.recordings.recording import Recording
from runtime.report import diagnosed, findings, fits, loop, reasons, terminal
from runtime.report.page import page_figures, reports
from runtime.report.page.html import fragment
from runtime.report.plots import joint_plots, style
from runtime.report.sensors import SensorWorth
from runtime.report.signals import joint_signals
from runtime.report.summary import Invocation, ResultSummary, about
from runtime.simulation import demo
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import Hidden, simulate
from tests.runtime.planning import planning_cases
from tests.runtime.studio.browser import launched

pytestmark = pytest.mark.xdist_group("report")  # its fixtures are made once
HOSTILE = '</script><img src="https://evil.example/x" onerror=alert(1)>&"\'$x^2$'
NOTHING_EXPLAINS = (JointVerdict(0, "nothing explains"),)
STRIBECK, ELASTICITY = Term("stribeck", 1), Term("elasticity", 1)
SECTIONS = [
    "Error against the noise floor",
    "The arm in motion",
    "Joint 1: stribeck added",
    "Findings",
    "The experiment that would decide",
    "Not named beside them",
    "Parameters",
    "Detection limits",
    "Put it into the model",
    "Recordings, band and skew",
]
ORIGIN = Invocation(Path("my arms/drive.toml"), (Path("run 1.csv"),), (Path("run2.csv"),), effects=Path("own.py"))


@pytest.fixture(scope="module")
def drive():
    """The demo's drive, compiled into this run's cache."""
    from runtime.workspace.source import Source

    return Source.shipped("drive").compiled.model()


@pytest.fixture(scope="module")
def one() -> Recording:
    """A drive with extra friction at creep."""
    t, q, tau = demo.record(3, repeats=1)
    run, whole = np.zeros(len(t), int), (slice(0, len(t)),)
    return Recording(
        Path("run.csv"), t, run, q[None], tau[None], types=("revolute",), segments=whole, temperature=(None,)
    )


@pytest.fixture(scope="module")
def improvement(drive, one) -> Improvement:
    """Fitted without and with that friction; the evidence is made up."""
    motion = prepared(drive, [one])
    known = structure(drive)
    shapes = {"speed": 0.15}
    steps = []
    for terms in (known, {**known, STRIBECK: shapes}):
        fit = fit_motion(drive, motion, terms, skew=0.5)
        joints = series(fit)
        errors = Errors(tuple(j.rms for j in joints), tuple(j.relative for j in joints))
        held_out = Errors(tuple(1.1 * r for r in errors.rms), tuple(1.1 * r for r in errors.relative))
        steps.append(Step(fit, joints, errors, held_out))
    named = replace(steps[1].after(steps[0], evidence(STRIBECK), NOT_RANKED), rivals=(ELASTICITY,))
    last = Ranking((evidence(ELASTICITY, EDGE.asked(0.0)),))
    seen = (detection_limits.Limit(ELASTICITY, "stiffness", "below", 41800.0, "N m/rad", 0, 0.1),)
    trail = Trail(drive, motion, None, ("run.csv",), (), named, last)
    alone = credibility.Tables(named.fit)
    found = Diagnosis((JointVerdict(0, "found"),), trail, trail, last, alone, seen=seen)
    end = trail.to(steps[1])
    left = Diagnosis((JointVerdict(0, "noise"),), end, end, last, alone, seen=seen)
    return Improvement("", found, left)


def evidence(term: Term, *closed: GateResult, gain: float = 456.0, eff: float = 0.123) -> Candidate:
    """closed: results of gates that a candidate does not pass."""
    return Candidate(term, {}, 0, 1.0, np.inf, eff=eff, evidence=Evidence(gain, 1.5, 1e9, 12.0), results=closed)


def rendered(result) -> str:
    return reports.report(result).html()


def worded(result) -> str:
    """A page without its drawings, which take most of its time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "svg", lambda *_: "<svg></svg>")
        return rendered(result)


@pytest.fixture(scope="module")
def page(improvement) -> str:
    return rendered(improvement)


class Reader(HTMLParser):
    """Tags with their attributes, the text outside scripts and styles, and what was left open."""

    EMPTY = frozenset({"meta", "br", "img", "link", "hr", "input"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.words: list[str] = []
        self.scripts: list[str] = []
        self.feed(text)
        self.text = re.sub(r"\s+", " ", " ".join(self.words))

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        inside = self.open[-1] if self.open else ""
        (self.scripts if inside == "script" else [] if inside == "style" else self.words).append(data)


@pytest.fixture(scope="module")
def summary(improvement, one) -> ResultSummary:
    """With the files that were named, and the floor of a recording that was held out."""
    return ResultSummary(improvement, ORIGIN, floors(improvement.steps[-1].fit, [one]))


@pytest.fixture(scope="module")
def story_text(summary) -> str:
    return Reader(worded(summary)).text


@pytest.fixture(scope="module")
def unexplained(improvement) -> Diagnosis:
    """The same data, had no candidate passed."""
    trail = improvement.found.found.to(improvement.steps[0])
    return replace(improvement.found, joints=NOTHING_EXPLAINS, found=trail, searched=trail)


def changed(diagnosis: Diagnosis, change: Callable[[Step], Step]) -> Diagnosis:
    """A diagnosis with every step changed."""
    last: Step | None = None
    for step in diagnosis.found.steps:
        last = replace(change(step), before=last)
    assert last is not None
    return replace(diagnosis, found=diagnosis.found.to(last), searched=diagnosis.searched.to(last))


@pytest.mark.parametrize("ended", ["complete", "budget", "time"])
def test_a_verdict_says_what_cut_its_search(improvement, unexplained, ended):
    """Wherever the verdict is read alone: at the prompt, on the page, in a notebook."""
    for made in (improvement.found, unexplained):
        cut = replace(made, searched=replace(made.searched, work=SearchWork(ended=ended)))
        _, *second = diagnosed.document(cut).reason.split(". ")
        said = [sentence for sentence in second if "The search was cut by its" in sentence]
        assert [{"time": "time limit", "budget": "budget"}[ended] in x for x in said] == [True] * (ended != "complete")


def test_page_needs_nothing_beside_it(page):
    read = Reader(page)
    assert read.open == []
    assert not re.search(r"(?:https?:)?//\w", re.sub(r"base64,[A-Za-z0-9+/=\s]+", "", page))
    assert "@import" not in page
    assert "url(" not in re.sub(r"url\(#[\w-]+\)", "", page)
    for tag, attributes in read.tags:
        assert tag not in ("link", "iframe", "object", "embed")
        assert tag != "script" or attributes.get("type", "application/json") == "application/json"
        for name in ("src", "href", "xlink:href"):
            value = attributes.get(name) or "#"
            assert value.startswith(("#", "data:image/png;base64,"))


def test_ids_are_unique_and_links_within_the_page_arrive(page):
    tags = Reader(page).tags
    ids = [a["id"] for _, a in tags if "id" in a]
    assert len(ids) == len(set(ids))
    for tag, attributes in tags:
        if tag == "a":
            assert attributes["href"][1:] in ids
    for name in re.findall(r"url\(#([\w-]+)\)|xlink:href=\"#([\w-]+)\"", page):
        assert (name[0] or name[1]) in ids


def test_same_result_same_bytes(improvement, page, tmp_path):
    path = reports.write_report(tmp_path / "deep" / "folder", improvement)
    assert path == tmp_path / "deep" / "folder" / "report.html"
    assert path.read_text(encoding="utf-8") == page
    assert [p.name for p in path.parent.iterdir()] == ["report.html"]
    assert len(page) < 3_000_000


def test_sections_in_their_order(page):
    headings = re.findall(r"<h2>(.*?)</h2>", page)
    assert headings[: len(SECTIONS)] == SECTIONS
    assert "tendon add drive.toml stribeck --joint 1" in page


def test_page_holds_the_numbers_of_the_json(improvement, page):
    read = Reader(page)
    document = ResultSummary(improvement).document.to_json()
    assert json.loads(read.scripts[-1]) == json.loads(json.dumps(document))
    for step in document["history"]:
        assert wording.percent(step["relative"][0]) in read.text
        assert wording.percent(step["held_out_relative"][0]) in read.text
    assert wording.number(document["joints"][0]["floor"]) in read.text
    fitted = document["identification"]["after"]["effects"]
    assert {e["effect"] for e in fitted} >= {"stribeck", "viscous"}
    for entry in fitted:
        for p in entry["parameters"].values():
            assert fits.estimate(Estimate(p["value"], tuple(p["interval"]), p["unit"])) in read.text
    assert "0.123 N m" in read.text  # the torque that only the finding explains
    assert "its shape lies at the edge of what was searched" in read.text
    assert "stiffness less than 41800 N m/rad" in read.text
    assert "elasticity at joint 1" in read.text


def test_page_can_be_read_aloud(page):
    """Every figure has words for what it shows, every table says what its cells are, headings skip no level."""
    tags = Reader(page).tags
    captions = page.count("<figcaption>")
    drawn = [a for tag, a in tags if tag == "svg"]
    assert len(drawn) == captions > 8
    assert all(a["role"] == "img" and len(a["aria-label"] or "") > 20 for a in drawn)
    assert all(a.get("scope") in ("row", "col") for tag, a in tags if tag == "th")
    levels = [int(tag[1]) for tag, _ in tags if re.fullmatch(r"h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(b - a <= 1 for a, b in itertools.pairwise(levels))


def test_text_stands_out_in_light_and_dark(page):
    """Contrast of at least 4.5, as WCAG asks of text, on both grounds and in both schemes."""
    schemes = re.findall(r":root[^{]*\{([^}]*--paper.*?)\}", page, re.DOTALL)
    assert len(schemes) == 3  # light, dark of the system, dark of a page's own choice
    for scheme in schemes:
        colour = dict(re.findall(r"--(\w+): (#\w{6})", scheme))
        for name in ("ink", "faint", "before", "after", "good", "doubt"):
            for ground in ("paper", "raised"):
                assert contrast(colour[name], colour[ground]) >= 4.5, (name, ground)


def contrast(one: str, other: str) -> float:
    """Ratio of relative luminances; Web Content Accessibility Guidelines 2.1."""

    def luminance(colour: str) -> float:
        parts = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    dark, light = sorted([luminance(one), luminance(other)])
    return (light + 0.05) / (dark + 0.05)


def test_no_colour_of_a_figure_escapes_the_page(page):
    """Colours are the page's, so that figures turn dark with it."""
    sheet = page[page.index("<style>") : page.index("</style>")]
    body = page.replace(sheet, "")
    for colour in style.COLOURS.values():
        assert colour not in body


def test_moving_picture_turns_as_the_recording_did(page, one):
    """Its frames against the raw encoder at their times, by the direction in which the link is drawn."""
    data = json.loads(Reader(page).scripts[0])
    t = data["begins"] + np.array(data["t"]) / 1000
    assert 50 < len(t) <= 400
    assert np.all(np.diff(t) > 0)
    corners = np.array(data["bodies"][0], dtype=float).reshape(len(t), -1, 2)
    x, y = (corners[:, -1] - corners[:, 0]).T
    recorded = np.interp(t, one.t - one.t[0], one.q[0])
    np.testing.assert_allclose(np.hypot(x, y), np.hypot(x, y).mean(), atol=1.5)
    away = np.angle(np.exp(1j * (np.arctan2(-y, x) - recorded)))
    assert np.abs(away).max() < 1.5 / np.hypot(x, y).mean() + 1e-3
    before, after = (np.array(m, dtype=float)[:, 0] for m in data["marks"])
    seen = before >= 0
    assert seen.mean() > 0.5
    assert np.sqrt(np.mean(before[seen] ** 2)) > 2 * np.sqrt(np.mean(after[seen] ** 2))


def test_what_was_demanded_is_drawn_under_what_was_measured(drive, one):
    asked = replace(one, q_desired=one.q + 0.1)
    page = worded(compare(drive, [asked]))
    data = json.loads(Reader(page).scripts[0])
    assert "The arm as demanded, dashed, and as it was measured" in page
    assert page.count('<polyline class="arm') == 2
    demanded, measured = (np.array(body, dtype=float).reshape(len(body), -1, 2) for body in data["bodies"])
    turned = [np.arctan2(-(b[:, -1, 1] - b[:, 0, 1]), b[:, -1, 0] - b[:, 0, 0]) for b in (demanded, measured)]
    np.testing.assert_allclose(np.angle(np.exp(1j * (turned[0] - turned[1]))), 0.1, atol=0.02)


def test_what_sensors_were_worth_is_on_the_page(improvement, page):
    assert "Contribution of the sensors" not in page
    worth = SensorWorth(("q1_link",), (ELASTICITY,), (), ())
    summary = ResultSummary(improvement)
    document = msgspec.structs.replace(summary.document, sensors=[worth.document()])
    summary.__dict__["document"] = document
    assert loop.sensors(document) == ["Contribution of the sensors: q1_link: alone rules out elasticity@1."]
    assert loop.sensors(document)[0] in Reader(worded(summary)).text


def test_commands_can_be_copied(summary, story_text):
    text = story_text
    assert "tendon add 'my arms/drive.toml' stribeck --joint 1 --effects own.py" in text
    assert "tendon identify 'my arms/drive.toml' 'run 1.csv' --write --effects own.py" in text
    assert "tendon experiment 'my arms/drive.toml' --between stribeck@1,elasticity@1 --effects own.py" in text
    assert summary.document.commands == summary.commands


def test_the_model_files_own_words_and_sources_are_cited():
    text = '# A rig.\n# B. Author, "Its data", 2019.\n#\n# Which numbers are what:\nname = "rig"\n'
    assert about(text) == 'A rig. B. Author, "Its data", 2019.'
    assert about('name = "rig"  # bare\n') == about("") == ""


def test_what_is_done_already_is_not_asked_for(summary):
    done = replace(summary, given=replace(ORIGIN, improved=Path("better.toml")))
    assert not any(c.command.startswith("tendon add") for c in done.commands)
    assert "The improved model is in better.toml" in Reader(worded(done)).text.replace(" .", ".")
    assert not done.document.commands[0].command.startswith("tendon identify")


@given(name=st.text(min_size=1).filter(lambda s: "\0" not in s), joint=st.none() | st.integers(1, 7))
def test_a_shell_reads_a_command_as_it_was_meant(name, joint):
    invocation = Invocation(Path(name), (Path(name),), maps=(f"q1={name}",))
    words = shlex.split(invocation.add(Term("gravity", joint)))
    assert words[:2] == ["tendon", "add"]
    assert Path(words[2]) == Path(name)
    assert words[3:] == ["gravity"] + ([] if joint is None else ["--joint", str(joint)])
    assert not any(w.startswith("-") for w in shlex.split(invocation.identify())[2:4])
    assert shlex.split(invocation.identify())[4:] == ["--map", f"q1={name}", "--write"]


def test_floor_of_a_recording_is_the_same_held_out(improvement, summary, story_text):
    """The fitted recording, held out, has the floor that it has as the fitted one."""
    fitted = improvement.steps[-1].joints[0].floor
    assert summary.held_out_floors[0].value == pytest.approx(fitted.value, rel=1e-9)
    # The fixture's held-out errors are 1.1 times the fitted ones in rms and relative: the same torque.
    assert summary.held_out_floor(0) == pytest.approx(summary.floor(0), rel=1e-9)
    assert f"noise floor, held out {wording.percent(summary.floor(0))}" in story_text
    assert summary.document.held_out_floors[0].floor == summary.held_out_floors[0].value
    assert floors(improvement.steps[-1].fit, []) == ()


def ranked(term: Term, model: Model, *closed: GateResult, **values: float) -> RankedCandidate:
    """A candidate as documents have it."""
    found = diagnosed.evidence_entry(evidence(term, *closed, **values), model)
    return RankedCandidate(effect=term.effect, joint=term.joint, evidence=found)


def test_why_a_candidate_was_not_named(summary):
    finding = summary.document.history[1].finding
    context, model = reports.context(summary), summary.diagnosis.model

    def why(other: RankedCandidate, rivals=(), scale: float = 1.0) -> str:
        scaled = {k: msgspec.structs.replace(p, floor=scale * p.floor) for k, p in context.places.items()}
        around = context._replace(places=scaled)
        own = msgspec.structs.replace(finding, rivals=[EffectAt(effect=t.effect, joint=t.joint) for t in rivals])
        return findings.in_place_of(other, own, around)

    behind = ranked(ELASTICITY, model, gain=100.0)
    assert why(behind, (ELASTICITY,)) == (
        "is not ruled out: it is as likely as stribeck within what the data tell (gain 100 against 456)"
    )
    assert why(behind) == ("is ruled out: it passes every gate by itself, but gains 356 less than stribeck at joint 1")
    assert "the error falls less than with stribeck" in why(ranked(ELASTICITY, model, gain=1000.0))
    elsewhere = context._replace(places={**context.places, 2: context.places[1]})
    other = ranked(Term("elasticity", 2), model)
    assert findings.in_place_of(other, finding, elsewhere).startswith("is set aside: it acts at another joint")
    named = elsewhere._replace(also={("elasticity", 2)})
    assert findings.in_place_of(other, finding, named).startswith("is named too")
    failing = ranked(ELASTICITY, model, REST.asked(0.01), EDGE.asked(0.0))
    assert why(failing) == (
        "is ruled out: a law over the same signals explains all but 1 % of what both explain; its shape lies at the "
        "edge of what was searched"
    )
    assert "next to nothing" in why(failing, scale=1000.0)
    useless = ranked(ELASTICITY, model, REST.asked(0.01), gain=-12.3)
    assert findings.why_not_named(useless, context, held_out=False).endswith("the likelihood gains nothing with it")
    passing = findings.why_not_named(ranked(ELASTICITY, model), context, held_out=True)
    assert passing.endswith("or by the held-out recording")


def card_of(improvement: Improvement, ranking: Ranking, rivals: tuple[Term, ...]) -> Reader:
    """The page's card of the finding, had its search ended so."""
    finding = replace(improvement.findings[0], ranking=ranking, rivals=rivals)
    summary = ResultSummary(replace(improvement.found, found=improvement.found.found.to(finding)))
    return Reader(fragment(reports.finding_card(summary, 0)))


def test_every_finalist_has_its_reason(improvement):
    first, closed = improvement.findings[0].candidate, evidence(Term("cable", 1), REST.asked(0.01))
    ranking = Ranking((first, evidence(ELASTICITY), closed))
    # A pair leaves a rival that has no evidence.
    text = card_of(improvement, ranking, (ELASTICITY, Term("gravity"))).text
    rows = text[text.index("why, or why not") :]
    order = [rows.index(name) for name in ("stribeck at joint 1 named", "elasticity at joint 1 rival", "gravity rival")]
    assert order == sorted(order)
    for why in (
        "Not ruled out: it is as likely as stribeck",
        "it fits about as well",
        "Ruled out: a law over the same signals explains all but 1 % of what both explain.",
    ):
        assert why in rows


def test_what_gains_nothing_takes_no_row(improvement):
    """But what was named too does: many candidates of an arm of seven joints are of no account to a finding."""
    weak = evidence(Term("cable", 1), REST.asked(0.01), gain=-7.0)
    read = card_of(improvement, Ranking((improvement.findings[0].candidate, weak)), ())
    assert [tag for tag, attributes in read.tags if tag == "th" and attributes.get("scope") == "row"] == ["th"]
    assert "Ruled out because the likelihood gains nothing with them: cable at joint 1." in read.text
    last = replace(improvement.found, ranking=Ranking((weak,)))
    assert "the likelihood gains nothing with them: cable at joint 1." in Reader(worded(ResultSummary(last))).text


def test_an_effect_with_a_memory_is_drawn_over_the_time_in_which_it_acts(improvement):
    finding = improvement.findings[0]
    info = improvement.found.model.library.effects["elasticity"]
    assert info.states
    (figure,) = page_figures.of_finding(finding, info, "one", alone=True)
    assert "acts most" in figure.caption
    assert page_figures.of_finding(finding, replace(info, states=()), "two", alone=True) == []


def test_unexplained_shows_where_and_proposes_a_draft(unexplained):
    summary = ResultSummary(unexplained, ORIGIN)
    text = Reader(worded(summary)).text
    assert "What is left unexplained" in text
    assert "share of the residual's power that each signal explains: velocity" in text
    assert "tendon diagnose 'my arms/drive.toml' 'run 1.csv' --draft guess.py --effects own.py" in text
    assert "tendon add" not in text


def test_a_line_in_the_spectrum_is_pointed_at(unexplained):
    step = unexplained.steps[0]
    motion, fit = step.fit.motion, step.fit
    wave = np.sin(2 * np.pi * 3.7 * np.arange(len(fit.residual[0])) / motion.row_rate(0))
    ringing = replace(step.fit, residual=[step.fit.residual[0] + wave])
    found = changed(unexplained, lambda s: replace(s, fit=ringing))
    text = Reader(fragment(reports.left_over(ResultSummary(found)))).text
    line = re.search(r"Strongest line of its spectrum: ([\d.]+) Hz", text)[1]
    assert float(line) == pytest.approx(3.7, abs=0.03)  # one bin of 37 s


@given(frequency=st.floats(1.0, 40.0), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_lines_are_found_in_noise_and_not_in_noise_alone(frequency, seed):
    noise = np.random.default_rng(seed).standard_normal(4000)
    assert spectra.strongest_line(noise, 100.0) is None
    line = spectra.strongest_line(noise + 3 * np.sin(2 * np.pi * frequency * np.arange(4000) / 100.0), 100.0)
    assert line is not None
    # Two bins of a Hann window over 40 s; 4.5 of the power of 5.5 is in the line, scattered by its own noise.
    assert abs(line.frequency - frequency) < 0.05
    assert line.share == pytest.approx(4.5 / 5.5, abs=0.1)


@given(frequency=st.floats(8.0, 36.0), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_a_peak_that_holds_little_is_named_and_a_slope_is_none(frequency, seed):
    """A wave of a sixteenth of the power in white noise; slow noise, whose spectrum only falls, has no peak."""
    noise = np.random.default_rng(seed).standard_normal(6000)
    wave = 0.35 * np.sin(2 * np.pi * frequency * np.arange(6000) / 100.0)
    assert spectra.strongest_line(noise + wave, 100.0) is None
    assert min(abs(f - frequency) for f in spectra.peaks(noise + wave, 100.0, 40.0)) < 0.5
    slow = lfilter([1.0], [1.0, -0.9], noise)
    assert all(abs(f - frequency) < 0.5 for f in spectra.peaks(wave + noise, 100.0, 40.0)[:1])
    assert len(spectra.peaks(slow, 100.0, 40.0)) <= 1  # chance has one in some hundred


def test_peaks_are_named_beside_clean_and_what_is_left_in_the_badge(improvement, capsys):
    step = improvement.left.last
    motion, fit = step.fit.motion, step.fit
    wave = 0.4 * step.joints[0].rms * np.sin(2 * np.pi * 12.3 * np.arange(len(fit.residual[0])) / motion.row_rate(0))
    humming = replace(step.fit, residual=[step.fit.residual[0] + wave])
    clean = changed(improvement.left, lambda s: replace(s, fit=humming))
    summary = ResultSummary(clean)
    (peak,) = summary.document.peaks
    assert min(abs(f - 12.3) for f in peak.frequencies_hz) < 0.4
    page = Reader(worded(summary)).text
    assert re.search(r"Peaks in the spectrum of the residual, with little of its power: joint 1 at .*12\.\d+ Hz", page)
    terminal.show(loop.sections(summary.document))
    assert "Peaks in the spectrum of the residual" in capsys.readouterr().out
    more = replace(improvement, left=replace(improvement.left, joints=NOTHING_EXPLAINS))
    assert "effect found, more is left" in Reader(worded(more)).text
    assert "more is left" not in Reader(worded(improvement)).text


def test_all_of_a_recording_shows_measurement_and_prediction_apart(improvement):
    step = improvement.steps[-1]
    trace, _ = page_figures._trace(improvement.steps[0].joints[0], step.joints[0])
    measured, predicted, _ = joint_plots.torque_over_time(trace).axes
    assert [len(ax.lines) - 1 for ax in (measured, predicted)] == [1, 1]  # and a line at 0
    assert measured.get_ylim() == predicted.get_ylim()


def test_refused_says_what_to_record(unexplained, monkeypatch):
    monkeypatch.setattr(credibility, "poor_excitation", lambda _: "short motion")
    text = Reader(worded(replace(unexplained, joints=(JointVerdict(0, "excitation"),)))).text
    assert re.search(r"The joints move for [0-9.]+ s only; record at least", text)
    assert "What to record" in text
    assert "Several constant speeds" in text  # viscous friction, in the model


def test_values_that_do_not_exist_are_null_in_the_page(improvement):
    """A rest position of a spring of no stiffness is no number."""
    last = improvement.steps[-1]
    inference = last.fit.inference
    values = {**inference.values, STRIBECK: {"speed": Estimate(float("nan"), None, "rad/s")}}
    fit = replace(last.fit)
    fit.__dict__["inference"] = replace(inference, values=values)
    found = changed(improvement.found, lambda s: replace(s, fit=fit) if s is last else s)
    document = json.loads(json.dumps(ResultSummary(found).document.to_json(), allow_nan=False))
    assert document["findings"][0]["parameters"]["speed"]["value"] is None


def test_the_figures_name_their_colours_and_cut_no_label(summary):
    """Legends stand above the panels; the values behind the bars fit beside them."""
    error = page_figures.error(summary.steps, 0, 0.02)
    follows = page_figures.structure(summary.first, summary.last, 0).figure
    over = next(
        drawn.figure
        for drawn in page_figures.of_joint(summary.first, summary.last, 0, summary.findings_at(0))
        if drawn.caption.startswith("Residual over velocity")
    )
    named = [
        [text.get_text() for text in axes.get_legend().get_texts()] for f in (error, follows, over) for axes in f.axes
    ]
    assert named == [["fitted", "held out", "noise floor"], ["before", "after"], ["before", "stribeck"], ["after"]]
    for figure in (error, follows):
        figure.canvas.draw()
        (axes,) = figure.axes
        right = figure.bbox.x1
        assert axes.texts
        assert all(text.get_window_extent().x1 <= right for text in axes.texts)


def test_what_is_read_of_all_samples_is_the_number_of_the_tables(summary):
    """Although the page holds a part of the samples."""
    first, last = summary.first, summary.last
    held = joint_signals.of_joint(first, last, 0, "stribeck").embedded()
    whole = held["spec"]["whole"]
    for name, step in (("residual before", first), ("residual after", last)):
        assert whole[name][1] == pytest.approx(step.fitted.rms[0], rel=1e-12)


FREE = """() => [...document.querySelectorAll('.figures')].map(figures => {
    const places = [...figures.children].map(child => child.getBoundingClientRect());
    const reach = top => Math.max(...places.filter(p => Math.round(p.top) === top).map(p => p.right));
    const tops = [...new Set(places.map(p => Math.round(p.top)))];
    return tops.map(top => figures.getBoundingClientRect().right - reach(top));
})"""
"""Pixels that each row of each group of figures leaves free on the right."""


def test_no_row_of_figures_is_half_empty(summary, tmp_path):
    path = reports.write_report(tmp_path, summary)
    with contextmanager(launched)() as browser:
        page = browser.new_page()
        for width in (1300, 900, 390):
            page.set_viewport_size({"width": width, "height": 900})
            page.goto(path.as_uri())
            groups = page.evaluate(FREE)
            assert len(groups) >= 2
            assert all(abs(free) < 1 for rows in groups for free in rows), (width, groups)


def test_terminal_is_short_and_says_the_same(summary, unexplained, capsys):
    terminal.show(loop.sections(summary.document))
    out = capsys.readouterr().out
    assert "stribeck at joint 1" in out
    assert out.startswith("EFFECT: stribeck or elasticity explains ")
    said = r" % of what was missing at joint 1; [\d.]+ % of its torque is left, 1 × the floor: noise"
    assert re.search(said, out)
    assert re.search(r"Gained, error of the torque: joint 1 [\d.]+ % -> [\d.]+ % \(held out [\d.]+ %", out)
    assert "Unexplained:" not in out
    assert re.search(r"held out: joint 1 [\d.]+ N m \((repeats|spectrum)\)", out)
    assert "tendon add 'my arms/drive.toml' stribeck --joint 1 --effects own.py" in out
    assert "stiffness < 41800 N m/rad" in out
    assert len(out.splitlines()) < 70
    terminal.show(loop.sections(ResultSummary(unexplained, ORIGIN).document))
    out = capsys.readouterr().out
    assert out.startswith("UNEXPLAINED: ")
    assert "--draft guess.py" in out
    assert len(out.splitlines()) < 40


def test_improve_says_effect_where_what_was_added_holds(improvement, monkeypatch):
    """With the size of what is left; not where the error on recordings that were not fitted rose."""
    monkeypatch.setattr(reasons, "after_effect", lambda *_: RepeatingResidual(0.5, "velocity", True))
    more = replace(improvement, left=replace(improvement.left, joints=NOTHING_EXPLAINS))
    document = ResultSummary(more).document
    assert (document.verdict, document.joints[0].verdict, document.more_is_left) == ("effect", "unexplained", True)
    assert document.reason.endswith(" % of its torque is left, 1 × the floor: coloured, follows velocity")
    before = improvement.steps[0].held_out
    worse = Errors(tuple(2 * rms for rms in before.rms), before.relative)
    rose = replace(more, found=changed(more.found, lambda s: replace(s, held_out=worse if s.chosen else before)))
    assert (rose.verdict, ResultSummary(rose).document.more_is_left) == ("unexplained", False)
    assert reasons.of_improvement(rose) == reasons.reason(rose.left)


def test_joints_are_called_by_their_names_too(improvement, capsys):
    def named(diagnosis: Diagnosis) -> Diagnosis:
        return changed(diagnosis, lambda s: replace(s, joints=tuple(replace(j, name="elbow") for j in s.joints)))

    whole = Improvement(improvement.model_text, named(improvement.found), named(improvement.left))
    summary = ResultSummary(whole, ORIGIN)
    assert [j.name for j in summary.document.joints] == ["elbow"]
    page = worded(summary)
    assert "Joint 1 elbow: stribeck added" in page
    assert "stribeck at joint 1 (elbow)" in page
    terminal.show(loop.sections(summary.document))
    printed = capsys.readouterr().out
    assert "stribeck at joint 1 (elbow): residual" in printed
    assert "elasticity at joint 1 (elbow) is ruled out: its shape lies" in printed
    assert "1 elbow" in printed


def test_text_of_the_user_stays_text(improvement):
    model = improvement.found.model

    def renamed(step: Step) -> Step:
        problem = copy(step.fit.problem)
        problem.model = Renamed(model, HOSTILE)
        return replace(step, fit=replace(step.fit, problem=problem))

    found, left = (changed(diagnosis, renamed) for diagnosis in (improvement.found, improvement.left))
    page = rendered(replace(improvement, found=found, left=left))
    read = Reader(page)
    assert HOSTILE in read.text
    assert "<img" not in page
    assert [tag for tag, _ in read.tags].count("script") == 5  # the motion, the signals, what shows each, the result
    assert json.loads(read.scripts[-1])["reason"].startswith("stribeck or elasticity explains")


class Renamed:
    """A model under another name."""

    def __init__(self, model, name: str) -> None:
        self._model, self.name = model, name

    def __getattr__(self, name: str):
        return getattr(self._model, name)


def test_comparison_says_where_the_residual_sits(improvement):
    step = improvement.steps[0]
    comparison = Comparison(step.fit, step.joints, as_written(step.fit))
    text = Reader(rendered(comparison)).text
    assert re.search(r"the fitted model misses [\d.]+ % of the torque, [\d.]+ times the noise floor", text)
    assert "of what it misses follows velocity" in text  # extra friction at creep
    assert "What the residual follows" in text
    assert "Findings" not in text
    assert "Residual over position" in text


def test_a_joint_that_never_moves_is_no_joint_at_its_floor(library, capsys):
    """Where one joint of two is held, its page has no figures of it, and no error of zero."""
    model = planning_cases.arm(library, "rr", effects={"viscous": {"coefficient": 1.0}})
    t = np.arange(8000) / 1000
    swing = 0.7 * np.sin(2 * np.pi * 0.31 * t) * np.cos(2 * np.pi * 0.9 * t)
    made, _ = simulate(model, motion=np.array([0 * t, swing]))
    summary = ResultSummary(compare(model, [made]))
    assert (summary.moves(0), summary.moves(1)) == (False, True)
    page = Reader(worded(summary))
    assert page.text.count("it never moves, and nothing of it is compared") == 2
    assert not any(str(tag.get("id", "")).startswith("time1") for _, tag in page.tags)
    terminal.show(loop.sections(summary.document))
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    (row,) = (row for row in rows if row[:1] == ["1"])
    assert row[1:3] == ["–", "–"]
    assert row[-2:] == ["never", "moves"]


def test_parameters_of_joints_at_their_floor_fold_away(library):
    """Of two joints the first has a spring that the model lacks; the second one's friction is not the file's."""
    model = planning_cases.arm(library, "rr", effects={"viscous": {"coefficient": 1.0}})
    plant = planning_cases.arm(library, "rr", effects={"viscous": {"coefficient": 2.0}})
    spring = Hidden(Term("linear_spring", 1), {"stiffness": 20.0, "rest": 0.0})
    made, _ = simulate(plant, [spring], SimulationSettings(seconds=20.0))
    text = worded(ResultSummary(compare(model, [made])))
    parameters = text[text.index('<section id="parameters">') : text.index('<section id="method">')]
    first, second = re.findall(r"<details( open)?>\s*<summary><h4>Joint \d</h4>(.*?)</summary>", parameters)[:2]
    assert (first[0], second[0]) == (" open", "")
    assert "1 contradicts the model file" in second[1]


def test_diagnosis_without_a_finding(improvement):
    text = Reader(worded(improvement.left)).text
    assert "The residual is noise (" in text
    assert "Considered, and not named" in text
    assert "Detection limits" in text


def test_residual_that_changes_sign_with_the_direction_is_seen_over_load(improvement):
    """Gear friction: opposite over the load in the two directions, so a single curve over it is flat."""
    s = improvement.steps[0].joints[0]
    rng = np.random.default_rng(0)
    load = rng.uniform(-1, 1, len(s.q))
    noise = 0.1 * rng.standard_normal(len(s.q))
    made = replace(s, load=load, tau=s.predicted + np.abs(load) * np.sign(s.qd) + noise)
    found = structure_shares(made)
    # |load| about its mean has a variance of 1/12 and its mean 1/4; the noise 0.01.
    assert found["load"] > 0.9
    assert found["load"] > found["position"]


def test_a_function_of_a_slow_signal_is_told_from_a_slow_disturbance(improvement):
    """Both hang together from row to row; what a curve over the velocity leaves does for the disturbance alone."""
    s = improvement.steps[0].joints[0]
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 20.0, 800)
    speed, noise = np.sin(2 * np.pi * 0.11 * t), 0.1 * rng.standard_normal(len(t))
    drift = np.sin(2 * np.pi * 0.29 * t) + np.cos(2 * np.pi * 0.47 * t)
    slow = replace(
        s, t=t, piece=np.zeros(len(t), dtype=int), q=t, qd=speed, qdd=t, load=t, warmth=None, predicted=0 * t
    )
    # exp(-(v/0.3)²) of either sign has a variance of a fifth over a sine, the noise one of 0.01.
    friction = structure_shares(replace(slow, tau=np.sign(speed) * np.exp(-((speed / 0.3) ** 2)) + noise))
    assert friction["velocity"] > 0.8
    assert structure_shares(replace(slow, tau=drift + noise))["velocity"] < 0.3


def test_running_mean_follows_a_curve_and_has_no_slivers():
    x = np.concatenate([np.random.default_rng(0).uniform(-1, 1, 4000), np.full(4000, 0.5)])
    mean_x, mean_y = joint_plots.running_mean(x, 2 * x + 1)
    np.testing.assert_allclose(mean_y, 2 * mean_x + 1, atol=1e-12)  # means of a line lie on it
    assert np.all(np.diff(mean_x) > 0)
    assert len(joint_plots.running_mean(x[:3], x[:3])[0]) == 0


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.23654, "0.2365"),
        (-0.01528, "−0.01528"),
        (41800.0, "41800"),
        (1.23456e-7, "1.235·10⁻⁷"),
        (0.0, "0"),
        (9.99996, "10"),
        (float("nan"), "–"),
        (None, "–"),
    ],
)
def test_numbers(value, text):
    assert wording.number(value) == text


def test_an_estimate_has_the_digits_that_its_interval_supports():
    assert fits.estimate(Estimate(0.23640, (0.23617, 0.23663), "kg m^2")) == "0.23640 ± 0.00023"
    assert fits.estimate(Estimate(203.47, (180.0, 226.94), "N s/m")) == "203 ± 23"
    assert fits.estimate(Estimate(1.0, None, "N", ("viscous@1 coefficient",))).endswith(
        "only together with viscous@1 coefficient)"
    )
    assert wording.unit("N m s^3/rad^3") == "N m s³/rad³"


def test_figures_draw_extremes():
    """One sample, no spread, empty directions: nothing to see, and no error."""
    flat = np.zeros(1)
    axis = joint_plots.PlotAxis("velocity, rad/s", flat, creep=True)
    assert joint_plots.residual_over(axis, flat, flat, 0.1, "N m", flat, "none")
    trace = SimpleNamespace(t=flat, piece=np.zeros(1, int))
    assert joint_plots.torque_over_time(joint_plots.Trace(trace.t, trace.piece, flat, flat, None, 0.1, "N m"))
    assert joint_plots.spectrum(flat, flat, None, 0.0, 10.0, "N m")
    assert joint_plots.error_fall(["as in the file"], [0.0], None, 0.0)


def test_a_browser_may_run_the_pages_own_scripts_and_nothing_else(page):
    policy = re.search(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">', page)[1]
    assert page.index("Content-Security-Policy") < page.index("<title>")
    rules = {name: rest for name, _, rest in (rule.strip().partition(" ") for rule in policy.split(";"))}
    assert (rules["default-src"], rules["base-uri"], rules["form-action"]) == ("'none'",) * 3
    own = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in own]
    assert own
    assert rules["script-src"] == " ".join(f"'sha256-{digest}'" for digest in digests)
    assert not re.search(r"""\son[a-z]+\s*=\s*["']|javascript:""", re.sub(r"<script.*?</script>", "", page, flags=re.S))
