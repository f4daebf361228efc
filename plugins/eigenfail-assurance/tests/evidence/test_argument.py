"""The graph of an argument and its picture: verdicts, places, and shapes."""

from itertools import combinations
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from eigenfail_assurance.evidence.argument import JudgedSolution, build_graph, judge_claim
from eigenfail_assurance.evidence.assumptions import Surroundings
from eigenfail_assurance.evidence.bundle import make_bundle
from eigenfail_assurance.evidence.drawing import draw_graph
from eigenfail_assurance.evidence.judgement import ClaimVerdict, SolutionFinding
from eigenfail_assurance.evidence.question import Claim, EvidenceQuestion, SearchSolution
from eigenfail_assurance.evidence.records import EvidenceRecords, SolutionInput

SVG = "{http://www.w3.org/2000/svg}"
SOLUTION = SearchSolution(campaigns=(1,))


def judge(verdict, context=(), assumptions=()):
    finding = SolutionFinding(verdict=ClaimVerdict(verdict), words=f"It is {verdict}.")
    return JudgedSolution(finding, Surroundings(tuple(context), tuple(assumptions)), "0" * 64)


def claim_with(solutions, *claims, **fields):
    return Claim(text="A claim.", solutions=(SOLUTION,) * solutions, claims=claims, **fields)


@pytest.mark.parametrize(
    ("below", "verdict"),
    [
        ((), "undeveloped"),
        (("supported", "supported"), "supported"),
        (("supported", "undecided"), "undecided"),
        (("supported", "undeveloped"), "undecided"),
        (("undeveloped", "refuted", "supported"), "refuted"),
    ],
)
def test_a_claim_needs_all_that_is_below_it(below, verdict):
    assert judge_claim([ClaimVerdict(each) for each in below]) == verdict


@given(st.lists(st.sampled_from(ClaimVerdict), min_size=1, max_size=6), st.data())
def test_more_support_never_hurts(below, data):
    order = [*map(ClaimVerdict, ("refuted", "undecided", "supported"))]
    place = data.draw(st.integers(0, len(below) - 1))
    better = [*below]
    better[place] = ClaimVerdict.SUPPORTED
    assert order.index(judge_claim(better)) >= order.index(judge_claim(below))


def test_unsupported_goals_are_undeveloped_and_refuted_ones_are_not():
    claims = [claim_with(1), claim_with(1), claim_with(1), claim_with(0)]
    judged = [judge(each) for each in ("supported", "refuted", "undecided")]
    graph = build_graph("Name", claim_with(0, *claims), judged)
    goals = [each for each in graph.elements if each.kind == "goal"]
    assert [each.verdict for each in goals] == [
        *("refuted", "supported", "refuted", "undecided", "undeveloped")
    ]
    assert [each.undeveloped for each in goals] == [False, False, False, True, True]


def test_what_claims_share_stands_once_above_them():
    left, right = claim_with(0, claim_with(1), claim_with(1)), claim_with(1)
    judged = [
        judge("supported", assumptions=["Of both sides.", "Of the left side."]),
        judge("supported", assumptions=["Of the left side.", "Of one."]),
        judge("supported", assumptions=["Of both sides."], context=["Of the right side."]),
    ]
    graph = build_graph("Name", claim_with(0, left, right), judged)
    texts = {each.id: each.text for each in graph.elements}
    beside = {texts[e.target]: e.source for e in graph.links if e.kind == "InContextOf"}
    assert beside == {
        "Of both sides.": "G1",
        "Of the left side.": "G2",
        "Of one.": "G4",
        "Of the right side.": "G5",
    }


def test_a_strategy_stands_between_a_claim_and_its_parts():
    graph = build_graph("Name", claim_with(1, argument="By counting."), [judge("supported")])
    assert [(each.source, each.target) for each in graph.links] == [("G1", "S1"), ("S1", "Sn1")]
    alone = build_graph("Name", claim_with(0, argument="By nothing."), [])
    assert [each.id for each in alone.elements] == ["G1"]


def test_several_planners_are_an_assumption_of_the_top_claim(make):
    records = {number: make("ss", number) for number in (1, 2)}
    inputs = tuple(SolutionInput(campaigns=((number,),)) for number in records)
    parts = [Claim(text="Part.", solutions=(SearchSolution(campaigns=(each,)),)) for each in (1, 2)]
    question = EvidenceQuestion(name="Name", claim=claim_with(0, *parts))
    alike = make_bundle(question, EvidenceRecords(records, inputs), "1").graph
    assert not any("several planners" in each.text for each in alike.elements)
    facts = records[2].facts
    spec = replace(facts.campaign.spec, planner="rulebook")
    facts = replace(facts, campaign=replace(facts.campaign, spec=spec))
    records[2] = replace(records[2], facts=facts)
    other = make_bundle(question, EvidenceRecords(records, inputs), "1").graph
    (told,) = [each.id for each in other.elements if "('idm', 'rulebook')" in each.text]
    assert [each.source for each in other.links if each.target == told] == ["G1"]


words = st.text(max_size=150).map(lambda text: f"Text {text}")
claims = st.recursive(
    st.builds(claim_with, st.integers(0, 2)),
    lambda inner: st.builds(
        lambda solutions, parts, argument: claim_with(solutions, *parts, argument=argument),
        st.integers(0, 2),
        st.lists(inner, max_size=3),
        st.sampled_from(("", "Argument over parts.")),
    ),
    max_leaves=6,
)


@settings(max_examples=40, deadline=None)
@given(claims, st.data())
def test_no_two_elements_of_a_picture_overlap(claim, data):
    verdicts = st.sampled_from(("supported", "refuted", "undecided"))
    judged = [
        judge(
            data.draw(verdicts),
            data.draw(st.lists(words, max_size=2)),
            data.draw(st.lists(words, max_size=2)),
        )
        for _ in claim.list_solutions()
    ]
    graph = build_graph("A <name>", claim, judged)
    picture = ET.fromstring(draw_graph(graph))
    groups = {each.get("id"): each for each in picture.iter(f"{SVG}g")}
    assert groups.keys() == {each.id for each in graph.elements}
    boxes = [find_box(each) for each in groups.values()]
    for one, other in combinations(boxes, 2):
        beside = one[2] <= other[0] or other[2] <= one[0]
        assert beside or one[3] <= other[1] or other[3] <= one[1]
    left, top, width, height = map(float, picture.get("viewBox").split())
    for box in boxes:
        assert box[0] >= left
        assert box[1] >= top
        assert box[2] <= left + width
        assert box[3] <= top + height


def find_box(group):
    """The left, upper, right and lower end of the inner outline of an element."""
    shapes = [each for each in group if each.tag in {f"{SVG}{n}" for n in OUTLINES}]
    return OUTLINES[shapes[0].tag.removeprefix(SVG)](shapes[0])


def read_rectangle(shape):
    x, y, width, height = (float(shape.get(name)) for name in ("x", "y", "width", "height"))
    return x, y, x + width, y + height


def read_ellipse(shape):
    x, y, rx, ry = (float(shape.get(name)) for name in ("cx", "cy", "rx", "ry"))
    return x - rx, y - ry, x + rx, y + ry


def read_polygon(shape):
    points = [tuple(map(float, each.split(","))) for each in shape.get("points").split()]
    xs, ys = zip(*points, strict=True)
    return min(xs), min(ys), max(xs), max(ys)


OUTLINES = {"rect": read_rectangle, "ellipse": read_ellipse, "polygon": read_polygon}


def test_a_verdict_is_not_told_by_colour_alone():
    parts = [claim_with(1), claim_with(1), claim_with(0)]
    graph = build_graph("Name", claim_with(0, *parts), [judge("supported"), judge("refuted")])
    picture = ET.fromstring(draw_graph(graph))
    by_id = {each.get("id"): each for each in picture.iter(f"{SVG}g")}
    for element in graph.elements:
        texts = [each.text for each in by_id[element.id].iter(f"{SVG}text")]
        assert texts[0] == f"{element.id} · {element.verdict}"
        crosses = [*by_id[element.id].iter(f"{SVG}path")]
        diamonds = [*by_id[element.id].iter(f"{SVG}polygon")]
        assert len(crosses) == (element.verdict == "refuted")
        assert len(diamonds) == element.undeveloped
    assert picture.get("role") == "img"
    assert "G3, refuted: A claim." in picture.find(f"{SVG}desc").text
