"""Whether a gate is open, from what was found."""

from hypothesis import given
from hypothesis import strategies as st

from eigenfail.gate import report
from eigenfail.gate.reruns import GateFinding, JudgedBy, Rerun, RerunFigures
from eigenfail.gate.verdicts import CLOSING, GateVerdict


def gate_of(*verdicts, strict=False, problem=""):
    known = tuple(finding_of(each, problem) for each in verdicts)
    gate = report.GateRun(suite="s", version="v2", run="s @ v2", baseline="v1", strict=strict)
    return report.build_report(gate, [report.MemberReport(member="m", known=known)])


def finding_of(became, problem):
    return GateFinding(verdict=became, what="a failure", problem=problem)


@given(verdicts=st.lists(st.sampled_from(GateVerdict), max_size=6))
def test_a_gate_is_open_unless_something_closes_it(verdicts):
    found = gate_of(*verdicts)
    assert found.open == (not CLOSING & set(verdicts))
    assert sum(found.counts.values()) == len(verdicts)
    strict = gate_of(*verdicts, strict=True)
    assert strict.open == (set(verdicts) <= {GateVerdict.FIXED, GateVerdict.SAFE})


def test_lost_episodes_alone_are_trouble_of_the_machinery():
    lost = "infrastructure: the worker was lost"
    assert gate_of(GateVerdict.CANNOT_RUN, problem=lost).in_trouble
    assert not gate_of(GateVerdict.CANNOT_RUN, problem="planner: ValueError").in_trouble
    assert not gate_of(GateVerdict.CANNOT_RUN, GateVerdict.NEW, problem=lost).in_trouble
    assert not gate_of(GateVerdict.FIXED, problem=lost).in_trouble
    assert not gate_of().in_trouble


def gate_of_rerun(*, verdict=GateVerdict.SAFE, errored=0, unresolved=0):
    """A gate over one campaign, with the episodes that would close it if they failed."""
    before, now = (RerunFigures(campaign=n, completed=9, failures=0, errored=0) for n in (1, 2))
    facts = {"method": "monte_carlo", "by": JudgedBy.RATE, "words": "", "verdict": verdict}
    rerun = Rerun(
        before=before, now=now, hidden_errored=errored, hidden_unresolved=unresolved, **facts
    )
    gate = report.GateRun(suite="s", version="v2", run="s @ v2", baseline="v1")
    return report.build_report(gate, [report.MemberReport(member="m", rerun=rerun)])


def test_episodes_that_may_hide_a_failure_keep_a_gate_from_opening():
    errored = gate_of_rerun(errored=54)
    assert (errored.open, errored.in_trouble) == (False, True)
    assert report.describe_conclusion(errored) == (
        "The gate of s @ v2 against v1 is inconclusive: 54 errored episodes of campaign 2 may hide "
        "a new failure."
    )
    unresolved = gate_of_rerun(unresolved=1)
    assert "1 unresolved episode of campaign 2 may hide" in report.describe_conclusion(unresolved)
    junit = report.to_junit(unresolved)
    assert b'<error message="cannot be run" type="cannot be run">1 unresolved' in junit
    assert gate_of_rerun().open


def test_a_new_failure_closes_a_gate_whatever_else_is_hidden():
    found = gate_of_rerun(verdict=GateVerdict.NEW, errored=5, unresolved=5)
    assert (found.state, found.in_trouble) == ("closed", False)


def test_a_rerun_judged_as_a_whole_counts_once():
    sides = [RerunFigures(campaign=n, completed=9, failures=5, errored=0) for n in (1, 2)]
    base = {"before": sides[0], "now": sides[1], "verdict": GateVerdict.NEW, "words": ""}
    base["method"] = "monte_carlo"
    whole = Rerun(**base, by=JudgedBy.RATE, counts={GateVerdict.NEW: 3})
    each = Rerun(**base, by=JudgedBy.EPISODE, counts={GateVerdict.NEW: 3, GateVerdict.FIXED: 1})
    assert report.MemberReport(member="m", rerun=whole).count_verdicts() == {"new": 1}
    assert report.MemberReport(member="m", rerun=each).count_verdicts() == {"new": 3, "fixed": 1}
