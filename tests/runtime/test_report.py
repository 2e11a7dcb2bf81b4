"""The report: whole on one page, the same bytes twice, safe with any text, and with the figures of the result."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from runtime import demo_plant, limits, plots, plots_time, report, wording
from runtime.candidates import Candidate
from runtime.compare import Comparison, as_written, series, structure_shares
from runtime.covariance import Estimate
from runtime.diagnose import Diagnosis, Errors, Finding, Step
from runtime.identify import identify_motion, prepared
from runtime.improve import Improvement
from runtime.judge import Evidence, Verdict
from runtime.origin import Origin
from runtime.recording import Recording
from runtime.story import Story
from runtime.terms import Term, structure

HOSTILE = '</script><img src="https://evil.example/x" onerror=alert(1)>&"\'$x^2$'
STRIBECK, ELASTICITY = Term("stribeck", 1), Term("elasticity", 1)
SECTIONS = [
    "In short",
    "Error against the noise floor",
    "Joint 1: stribeck added",
    "Findings",
    "The experiment that would decide",
    "Not named beside them",
    "Parameters",
    "Detection limits",
    "Put it into the model",
    "Recordings, band and skew",
]
ORIGIN = Origin(Path("my arms/drive.toml"), (Path("run 1.csv"),), (Path("run2.csv"),), effects=Path("own.py"))


@pytest.fixture(scope="module")
def drive():
    """The demo's drive, compiled into this run's cache."""
    from runtime.cli import Source

    return Source.shipped("drive").model()


@pytest.fixture(scope="module")
def improvement(drive) -> Improvement:
    """A drive with extra friction at creep, fitted without and with it; the evidence is made up."""
    t, q, tau = demo_plant.record(3, repeats=1)
    run, whole = np.zeros(len(t), int), (slice(0, len(t)),)
    one = Recording(
        Path("run.csv"), t, run, q[None], tau[None], types=("revolute",), segments=whole, temperature=(None,)
    )
    motion = prepared(drive, [one])
    known = structure(drive)
    shapes = {"speed": 0.15}
    steps = []
    for added, terms in ((None, known), (STRIBECK, {**known, STRIBECK: shapes})):
        identification = identify_motion(drive, motion, terms, skew=0.5)
        joints = series(identification)
        errors = Errors(tuple(j.rms for j in joints), tuple(j.relative for j in joints))
        held_out = Errors(tuple(1.1 * r for r in errors.rms), tuple(1.1 * r for r in errors.relative))
        steps.append(Step(added, identification, joints, errors, held_out))
    finding = Finding(evidence(STRIBECK), (ELASTICITY,), Verdict((), ()), *steps)
    last = (Verdict((evidence(ELASTICITY, "its shape lies at the edge of what was searched"),), ()),)
    seen = (limits.Limit(ELASTICITY, "stiffness", "below", 41800.0, "N m/rad"),)
    found = Diagnosis("effect", "the model lacks stribeck", tuple(steps), (finding,), last, seen)
    left = Diagnosis("clean", "the residual is noise", (steps[-1],), (), last, seen)
    return Improvement("", found, left)


def evidence(term: Term, *failed: str) -> Evidence:
    candidate = Candidate(term, None, {}, 0, None, (), None, False)  # type: ignore[arg-type]
    return Evidence(candidate, 0.123, 0.9, 456.0, 234.0, 0.5, failed, np.zeros(3))


@pytest.fixture(scope="module")
def page(improvement) -> str:
    return report.render(improvement)


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


def test_page_needs_nothing_beside_it(page):
    read = Reader(page)
    assert read.open == []
    assert not re.search(r"(?:https?:)?//\w", re.sub(r"base64,[A-Za-z0-9+/=\s]+", "", page))
    assert "@import" not in page
    assert "url(" not in re.sub(r"url\(#[\w-]+\)", "", page)
    for tag, attributes in read.tags:
        assert tag not in ("link", "iframe", "object", "embed")
        assert tag != "script" or attributes["type"] == "application/json"
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
    path = report.write_report(tmp_path / "deep" / "folder", improvement)
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
    document = Story(improvement).document
    assert json.loads(read.scripts[-1]) == json.loads(json.dumps(document))
    for step in document["history"]:
        assert wording.percent(step["relative"][0]) in read.text
        assert wording.percent(step["held_out_relative"][0]) in read.text
    assert wording.number(document["joints"][0]["floor"]) in read.text
    fitted = document["identification"]["after"]["effects"]
    assert {e["effect"] for e in fitted} >= {"stribeck", "viscous"}
    for entry in fitted:
        for p in entry["parameters"].values():
            assert wording.estimate(Estimate(p["value"], tuple(p["interval"]), p["unit"])) in read.text
    assert "0.123 N m" in read.text  # the torque that only the finding explains
    assert "its shape lies at the edge of what was searched" in read.text
    assert "stiffness less than 41800 N m/rad" in read.text
    assert "elasticity at joint 1" in read.text


def test_text_of_the_user_stays_text(improvement):
    model = improvement.found.model
    steps = tuple(
        replace(s, identification=replace(s.identification, model=Renamed(model, HOSTILE))) for s in improvement.steps
    )
    found = replace(improvement.found, reason=f"{HOSTILE}.csv is odd", steps=steps)
    page = report.render(replace(improvement, found=found, left=replace(improvement.left, reason=HOSTILE)))
    read = Reader(page)
    assert HOSTILE in read.text
    assert "<img" not in page
    assert [tag for tag, _ in read.tags].count("script") == 1
    assert json.loads(read.scripts[-1])["reason"] == HOSTILE


class Renamed:
    """A model under another name."""

    def __init__(self, model, name: str) -> None:
        self._model, self.name = model, name

    def __getattr__(self, name: str):
        return getattr(self._model, name)


def test_comparison_says_where_the_residual_sits(improvement):
    step = improvement.steps[0]
    comparison = Comparison(step.identification, step.joints, as_written(step.identification))
    text = Reader(report.render(comparison)).text
    assert re.search(r"the fitted model misses [\d.]+ % of the torque, [\d.]+ times the noise floor", text)
    assert "of what it misses follows velocity" in text  # extra friction at creep
    assert "What the residual follows" in text
    assert "Findings" not in text
    assert "Residual over position" in text


def test_diagnosis_without_a_finding(improvement):
    text = Reader(report.render(improvement.left)).text
    assert "The residual is noise." in text
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


def test_running_mean_follows_a_curve_and_has_no_slivers():
    x = np.concatenate([np.random.default_rng(0).uniform(-1, 1, 4000), np.full(4000, 0.5)])
    mean_x, mean_y = plots.running_mean(x, 2 * x + 1)
    np.testing.assert_allclose(mean_y, 2 * mean_x + 1, atol=1e-12)  # means of a line lie on it
    assert np.all(np.diff(mean_x) > 0)
    assert len(plots.running_mean(x[:3], x[:3])[0]) == 0


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
    assert wording.estimate(Estimate(0.23640, (0.23617, 0.23663), "kg m^2")) == "0.23640 ± 0.00023"
    assert wording.estimate(Estimate(203.47, (180.0, 226.94), "N s/m")) == "203 ± 23"
    assert wording.estimate(Estimate(1.0, None, "N", ("viscous@1 coefficient",))).endswith(
        "only together with viscous@1 coefficient)"
    )
    assert wording.unit("N m s^3/rad^3") == "N m s³/rad³"


def test_figures_draw_extremes():
    """One sample, no spread, empty directions: nothing to see, and no error."""
    flat = np.zeros(1)
    axis = plots.Axis("velocity, rad/s", flat, creep=True)
    assert plots.residual_over(axis, flat, flat, 0.1, "N m", flat, "none")
    trace = SimpleNamespace(t=flat, piece=np.zeros(1, int))
    assert plots_time.torque_over_time(plots_time.Trace(trace.t, trace.piece, flat, flat, None, 0.1, "N m"))
    assert plots.spectrum(flat, flat, None, 0.0, 10.0, "N m")
    assert plots.error_fall(["as in the file"], [0.0], None, 0.0)
