"""JUnit XML, read back as Jenkins, GitLab and GitHub read it."""

from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.gate.report import GateRun, MemberReport, _remove_illegal, build_report, to_junit
from eigenfail.gate.reruns import GateFinding, JudgedBy, Rerun, RerunFigures
from eigenfail.gate.verdicts import GateVerdict


def finding(became, what="a failure", **fields):
    return GateFinding(verdict=became, what=what, replay="eigenfail episode replay 2/1", **fields)


def document(strict=False, by=JudgedBy.EPISODE, method="monte_carlo", new_modes=()):
    sides = [RerunFigures(campaign=n, completed=9, failures=n, errored=0) for n in (1, 2)]
    rerun = Rerun(
        before=sides[0],
        now=sides[1],
        method=method,
        verdict=GateVerdict.NEW,
        by=by,
        words="9 pairs",
        counts={GateVerdict.NEW: 1, GateVerdict.STILL_FAILING: 1},
        findings=(
            finding(GateVerdict.NEW, "episode 1"),
            finding(GateVerdict.STILL_FAILING, "episode 2"),
        ),
        modes="There is a new mode.",
        new_modes=new_modes,
        wall_s=2.0,
    )
    known = (
        finding(GateVerdict.FIXED, "fixed one", wall_s=0.25),
        finding(GateVerdict.STILL_FAILING, "old one"),
        finding(GateVerdict.CANNOT_RUN, "broken one", problem="planner: <boom> & \x00\x1b[31m"),
    )
    members = [
        MemberReport(member="a", baseline=sides[0], known=known, rerun=rerun),
        MemberReport(member="b", notes=("It is not in the baseline.",)),
    ]
    gate = GateRun(suite="s", version="v2", run="s @ v2", baseline="v1", strict=strict)
    return ET.fromstring(to_junit(build_report(gate, members)))


def test_the_document_has_a_suite_for_each_member_with_its_properties():
    root = document()
    assert root.tag == "testsuites"
    assert [suite.get("name") for suite in root] == ["s: a", "s: b"]
    properties = {each.get("name"): each.get("value") for each in root[0].iter("property")}
    assert properties["baseline"] == "v1"
    assert properties["version"] == "v2"
    assert (properties["failures"], properties["failures before"]) == ("2 of 9", "1 of 9")
    assert properties["new"] == "1"


def ended(case):
    tags = {child.tag for child in case} - {"system-out"}
    return tags.pop() if tags else "passed"


def test_what_closes_the_gate_fails_and_what_was_there_is_skipped():
    cases = {case.get("name"): ended(case) for case in document().iter("testcase")}
    assert cases == {
        "fixed one": "passed",
        "old one": "skipped",
        "broken one": "error",
        "campaign 1": "failure",
        "episode 1": "failure",
        "It is not in the baseline.": "skipped",
    }
    strict = {case.get("name"): ended(case) for case in document(strict=True).iter("testcase")}
    assert strict["old one"] == "failure"


def test_the_totals_are_those_of_the_cases():
    for group in (document(), *document()):
        cases = list(group.iter("testcase"))
        counted = {"failures": "failure", "errors": "error", "skipped": "skipped"}
        assert group.get("tests") == str(len(cases))
        for name, tag in counted.items():
            assert group.get(name) == str(sum(ended(case) == tag for case in cases))
    assert document().get("time") == "2.250"


def test_a_failure_says_how_to_see_it():
    (failure,) = document().findall(".//testcase[@name='episode 1']/failure")
    assert failure.get("type") == failure.get("message") == "new"
    assert "eigenfail episode replay 2/1" in failure.text
    (whole,) = document().findall(".//testcase[@name='campaign 1']/failure")
    assert "9 pairs" in whole.text


def test_judged_as_a_whole_its_episodes_are_no_cases():
    names = {case.get("name") for case in document(by=JudgedBy.RATE).iter("testcase")}
    assert "campaign 1" in names
    assert "episode 1" not in names


@pytest.mark.parametrize(
    ("method", "became", "end", "message"),
    [
        ("monte_carlo", GateVerdict.NEW, "failure", "new"),
        ("ast", GateVerdict.UNPROVEN, "skipped", "not judged"),
    ],
)
def test_a_new_mode_is_a_case_that_fails_only_where_it_is_judged(method, became, end, message):
    modes = (finding(became, "new mode 2"),)
    root = document(strict=True, by=JudgedBy.RATE, method=method, new_modes=modes)
    (case,) = root.findall(".//testcase[@name='new mode 2']")
    assert ended(case) == end
    assert case.find(end).get("message") == message
    assert "eigenfail episode replay 2/1\nThere is a new mode." in case.find(end).text


def test_characters_that_xml_cannot_hold_are_left_out():
    (error,) = document().findall(".//error")
    assert error.text.startswith("planner: <boom> & [31m")


@given(text=st.text(st.characters(codec="utf-8")))
def test_any_text_can_be_read_back(text):
    root = ET.fromstring("<a/>")
    root.text = _remove_illegal(text)
    again = ET.fromstring(ET.tostring(root, encoding="utf-8"))
    assert (again.text or "") == _remove_illegal(text)
    assert set(text) - set(_remove_illegal(text)) <= {
        chr(code) for code in (*range(32), 0xFFFE, 0xFFFF)
    }
