"""What a gate says of all of it, and how often it is wrong."""

import pytest

from eigenfail.gate import report
from eigenfail.gate.reruns import GateFinding, JudgedBy, Rerun, RerunFigures
from eigenfail.gate.verdicts import GateVerdict

CHANCE, SEARCH = ("monte_carlo", ""), ("ast", "it learns.")


def judged_by_rate(kind, failures, **fields):
    method, unpaired_because = kind
    before = RerunFigures(campaign=1, completed=9, failures=failures, errored=0)
    base = {"before": before, "now": before, "words": "", "by": JudgedBy.RATE, "method": method}
    given = {"verdict": GateVerdict.NEW, **fields}
    return Rerun(**base, **given, unpaired_because=unpaired_because)


@pytest.mark.parametrize(
    ("reruns", "told"),
    [
        (
            [(SEARCH, 3)],
            "new, by its rate, in up to about 2.5 % of pairs of runs; failures of a search",
        ),
        ([(SEARCH, 3)] * 3, "in up to about 7.3 % of pairs of runs; failures of a search"),
        (
            [(CHANCE, 3)],
            "by its rate or by one of its modes, in up to about 5.0 % of pairs of runs.",
        ),
        ([(SEARCH, 0)], "25.0 % of pairs of runs (the baseline found none in 1: there one failure"),
        ([(CHANCE, 0)], "by its rate, in up to about 50.0 % of pairs of runs (the baseline"),
        ([(CHANCE, 3), (SEARCH, 3)], "modes, in up to about 7.4 % of pairs of runs; failures of a"),
        (
            [(CHANCE, 3), (SEARCH, 0)],
            "in up to about 28.8 % of pairs of runs (the baseline found none in",
        ),
    ],
)
def test_it_is_told_how_often_nothing_is_called_new(reruns, told):
    assert told in report._describe_false_alarms([judged_by_rate(*each) for each in reruns])


def gate_with(kind, verdict):
    """What a gate says of a campaign with a new mode."""
    mode = GateFinding(verdict=GateVerdict.UNPROVEN, what="new mode 1")
    rerun = judged_by_rate(kind, 3, verdict=verdict, new_modes=(mode,))
    gate = report.GateRun(suite="s", version="v2", run="s @ v2", baseline="v1")
    return report.build_report(gate, [report.MemberReport(member="m", rerun=rerun)])


def test_a_new_mode_of_a_search_is_told_and_closes_nothing():
    found = gate_with(SEARCH, GateVerdict.STILL_FAILING)
    assert found.open
    said = " ".join(report.list_conclusions(found))
    assert "Reported, not judged: failure modes of searches that only v2 has: 1." in said


def test_nothing_is_left_unjudged_where_failures_are_independent():
    assert "not judged" not in " ".join(report.list_conclusions(gate_with(CHANCE, GateVerdict.NEW)))
