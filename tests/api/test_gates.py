"""Routes of gates: a report is checked, stored once, logged, and read again."""

import json

import msgspec
import pytest
from msgspec.structs import replace
from store_checks.gates import make_report

from eigenfail.gate.report import build_report
from eigenfail.gate.reruns import GateFinding, JudgedBy
from eigenfail.gate.results import LARGEST_REPORT, MOST_KNOWN, shorten_report
from eigenfail.gate.verdicts import GateVerdict

GATES = "/api/v1/gates"
GATE = json.loads(msgspec.json.encode(make_report(GateVerdict.NEW, GateVerdict.FIXED)))


def test_a_report_comes_back_as_it_was_sent_and_is_stored_once(http):
    made = http.post(GATES, json=GATE)
    assert (made.status_code, made.headers["Location"]) == (201, f"{GATES}/1")
    assert made.json()["open"] is False
    again = http.post(GATES, json=GATE)
    assert again.json() == made.json()
    found = http.get(made.headers["Location"]).json()
    assert found["report"] == GATE
    assert found["conclusions"][0] == made.json()["conclusion"]
    http.post(GATES, json=msgspec.to_builtins(make_report(GateVerdict.FIXED)))
    listed = http.get(GATES, params={"limit": 1}).json()
    assert ([each["id"] for each in listed["items"]], listed["next"]) == ([2], 2)
    assert http.get(GATES, params={"before": 2}).json()["items"] == [made.json()]


def test_a_verdict_is_an_event_that_names_the_result_once(http):
    for _ in range(2):
        http.post(GATES, json=GATE)
    http.post(GATES, json=msgspec.to_builtins(make_report(GateVerdict.FIXED)))
    events = http.get("/api/v1/events/list").json()["items"]
    found = sorted((each["kind"], each["subject"]) for each in events)
    assert found == [("gate.failed", 1), ("gate.passed", 2)]


@pytest.mark.parametrize(
    ("wrong", "field"),
    [
        ({"open": True}, "open"),
        ({"counts": {"fixed": 2}}, "counts"),
        ({"counts": {"fixed": -1}}, "counts"),
        ({"gate": GATE["gate"] | {"suite": "x" * 201}}, "gate.suite"),
        ({"members": [{"member": "a", "known": [{"verdict": "new"}]}]}, "members"),
        ({"members": "all"}, "members"),
    ],
)
def test_a_report_that_is_not_sound_is_refused(http, problem, wrong, field):
    told = problem(http.post(GATES, json=GATE | wrong), 422)
    assert told["field"].startswith(field)
    assert http.get(GATES).json()["items"] == []


def test_a_gate_that_lost_its_episodes_is_refused(http, problem):
    lost = {"verdict": "cannot be run", "what": "medoid 1", "problem": "infrastructure: lost"}
    report = {
        "gate": GATE["gate"],
        "open": False,
        "counts": {"cannot be run": 1},
        "members": [{"member": "a", "known": [lost]}],
    }
    assert "episodes were lost" in problem(http.post(GATES, json=report), 422)["detail"]


def test_a_large_report_is_shortened_to_what_the_service_takes(http):
    report = make_report(GateVerdict.NEW)
    (first, second) = report.members
    findings = first.known * (LARGEST_REPORT // 100)
    rerun = replace(first.rerun, findings=findings)
    large = replace(report, members=(replace(first, rerun=rerun), second))
    assert http.post(GATES, json=msgspec.to_builtins(large)).status_code == 413
    short = shorten_report(large)
    assert (short.counts, short.open) == (report.counts, report.open)
    assert "single episodes of reruns are left out" in short.members[0].notes[-1]
    assert http.post(GATES, json=msgspec.to_builtins(short)).status_code == 201
    assert shorten_report(report) is report


def test_a_large_report_keeps_an_error_that_is_not_of_the_infrastructure(http):
    report = make_report(GateVerdict.FIXED)
    (first, second) = report.members
    (error, lost) = (
        GateFinding(verdict=GateVerdict.CANNOT_RUN, what="episode 3", problem=problem)
        for problem in ("planner: ValueError", "infrastructure: lost")
    )
    findings = (*([lost] * (LARGEST_REPORT // 50)), error)
    counts = {GateVerdict.CANNOT_RUN: len(findings)}
    rerun = replace(first.rerun, by=JudgedBy.EPISODE, counts=counts, findings=findings)
    short = shorten_report(build_report(report.gate, [replace(first, rerun=rerun), second]))
    assert short.members[0].rerun.findings == (error,)
    assert not short.in_trouble
    assert http.post(GATES, json=msgspec.to_builtins(short)).status_code == 201


def test_known_failures_that_are_left_out_are_counted(http):
    report = make_report(GateVerdict.NEW, GateVerdict.FIXED)
    (first, second) = report.members
    known = first.known[::-1] * (LARGEST_REPORT // 200)
    large = build_report(report.gate, [replace(first, known=known), second])
    short = shorten_report(large)
    assert (short.counts, short.open) == (large.counts, large.open)
    assert [each.verdict for each in short.members[0].known] == [GateVerdict.NEW] * MOST_KNOWN
    left_out = f"{len(known) - MOST_KNOWN:,} known failures are left out"
    assert left_out in short.members[0].notes[-1]
    assert http.post(GATES, json=msgspec.to_builtins(short)).status_code == 201
