"""Gates whose report says something else than their episodes."""

import pytest
from msgspec.structs import replace

from eigenfail import __version__
from eigenfail.gate.report import GateRun, MemberReport, build_report
from eigenfail.gate.reruns import GateFinding, JudgedBy, Rerun, read_figures
from eigenfail.gate.verdicts import GateVerdict
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import StopRules
from eigenfail.values.estimates import Estimate, Interval
from eigenfail_assurance.evidence.bundle import make_bundle
from eigenfail_assurance.evidence.question import Claim, EvidenceQuestion, GateSolution
from eigenfail_assurance.evidence.records import EvidenceRecords, SolutionInput
from eigenfail_assurance.evidence.storage import write_bundle
from eigenfail_assurance.evidence.verification import verify_bundle


@pytest.fixture
def judge(tmp_path):
    """Makes the bundle of a gate as its author says it went, and verifies it."""

    def judge_gate(before, now, by=JudgedBy.EPISODE, known=(), **said):
        rerun = Rerun(
            **{
                "before": read_figures(before.campaign),
                "now": read_figures(now.campaign),
                "method": now.campaign.spec.method,
                "by": JudgedBy.RATE if "unpaired_because" in said else by,
                "words": "",
                **said,
            }
        )
        run = GateRun(suite="s", version="", run="s", baseline="v1", by=by)
        report = build_report(run, [MemberReport(member="a", rerun=rerun, known=known)])
        claim = Claim(text="None is new.", solutions=(GateSolution(report=report),))
        records = EvidenceRecords(
            {each.campaign.id: each for each in (before, now)}, (SolutionInput(),)
        )
        bundle = make_bundle(EvidenceQuestion(name="Q", claim=claim), records, __version__)
        write_bundle(bundle.files, tmp_path / "bundle")
        checked = verify_bundle(tmp_path / "bundle")
        assert checked.is_verified
        return checked.verdict

    return judge_gate


@pytest.fixture
def search(make):
    """Makes a search of 200 episodes with this number of failures."""

    def make_search(number, failures, **fields):
        outcomes = "c" * failures + "s" * (200 - failures)
        return make(outcomes, number, seed=number, method="ast", **fields)

    return make_search


LEARNS = {"unpaired_because": "ast learns."}


@pytest.mark.parametrize(
    ("failures", "said", "verdict"),
    [
        ((0, 150), GateVerdict.SAFE, "undecided"),
        ((0, 150), GateVerdict.STILL_FAILING, "undecided"),
        ((0, 150), GateVerdict.NEW, "refuted"),
        ((20, 80), GateVerdict.STILL_FAILING, "undecided"),
        ((20, 80), GateVerdict.NEW, "refuted"),
        ((20, 22), GateVerdict.STILL_FAILING, "supported"),
        ((80, 20), GateVerdict.FIXED, "supported"),
        ((0, 0), GateVerdict.SAFE, "supported"),
    ],
)
def test_a_verdict_by_rate_follows_from_the_counts(judge, search, failures, said, verdict):
    before, now = (search(number, count) for number, count in enumerate(failures, 1))
    assert judge(before, now, verdict=said, **LEARNS) == verdict


def test_without_an_interval_of_the_rate_nothing_is_known_of_a_rise(judge, search):
    rules = {"stop": StopRules(failures=500)}
    one, other = search(1, 20, **rules), search(2, 22, **rules)
    assert judge(one, other, verdict=GateVerdict.STILL_FAILING, **LEARNS) == "undecided"
    assert judge(one, search(2, 0), verdict=GateVerdict.SAFE, **LEARNS) == "supported"
    assert judge(search(1, 0, **rules), other, verdict=GateVerdict.SAFE, **LEARNS) == "undecided"


@pytest.mark.parametrize(("low", "verdict"), [(2e-4, "supported"), (4e-4, "undecided")])
def test_estimates_are_compared_by_their_intervals(judge, search, low, verdict):
    before, now = (
        search(number, 20, estimate=Estimate(by="subset", episodes=9, interval=Interval(*ends)))
        for number, ends in ((1, (1e-4, 3e-4)), (2, (low, 9e-4)))
    )
    assert judge(before, now, verdict=GateVerdict.STILL_FAILING, **LEARNS) == verdict


@pytest.mark.parametrize(
    ("now", "counts", "verdict"),
    [
        ("sssc", {GateVerdict.STILL_FAILING: 1}, "supported"),
        ("sscs", {}, "undecided"),
        ("sscs", {GateVerdict.STILL_FAILING: 1}, "undecided"),
        ("sscs", {GateVerdict.NEW: 1, GateVerdict.FIXED: 1}, "refuted"),
        ("ssec", {GateVerdict.STILL_FAILING: 1}, "undecided"),
    ],
)
def test_pairs_follow_from_the_outcomes(judge, make, now, counts, verdict):
    said = next(iter(counts), GateVerdict.SAFE)
    assert judge(make("sssc", 1), make(now, 2), verdict=said, counts=counts) == verdict


@pytest.mark.parametrize(
    ("fresh", "said", "verdict"),
    [
        (5, GateVerdict.STILL_FAILING, "supported"),
        (6, GateVerdict.STILL_FAILING, "undecided"),
        (6, GateVerdict.NEW, "refuted"),
    ],
)
def test_pairs_by_rate_are_judged_by_chance(judge, make, fresh, said, verdict):
    # McNemar's exact test: 2 ÷ 2^5 is above 0.05, 2 ÷ 2^6 is below.
    before, now = make("s" * 19 + "c", 1), make("c" * fresh + "s" * (19 - fresh) + "c", 2)
    counts = {GateVerdict.NEW: fresh, GateVerdict.STILL_FAILING: 1}
    assert judge(before, now, by=JudgedBy.RATE, verdict=said, counts=counts) == verdict


def test_the_same_noise_is_not_judged_by_rate(judge, make):
    one, other = "c" * 9 + "s" * 191, "s" + "c" * 9 + "s" * 190
    words = {"verdict": GateVerdict.STILL_FAILING, "unpaired_because": "their noise differs."}
    assert judge(make(one, 1), make(other, 2), **words) == "undecided"
    assert judge(make(one, 1), make(other, 2, seed=4), **words) == "supported"


def change(record, spec=None, **fields):
    campaign = record.campaign
    fields |= {"spec": replace(campaign.spec, **(spec or {}))}
    return replace(record, facts=replace(record.facts, campaign=replace(campaign, **fields)))


def test_the_rerun_is_another_campaign_of_the_version_that_is_done(judge, make):
    before, now = make("sssc", 1), make("sssc", 2)
    said = {"verdict": GateVerdict.STILL_FAILING, "counts": {GateVerdict.STILL_FAILING: 1}}
    assert judge(before, now, **said) == "supported"
    assert judge(before, before, **said) == "undecided"
    assert judge(before, change(now, {"planner_version": "v1"}), **said) == "undecided"
    running = {"state": CampaignState.RUNNING, "digest": None}
    assert judge(before, change(now, **running), **said) == "undecided"
    assert judge(change(before, **running), now, **said) == "undecided"


@pytest.mark.parametrize(
    ("finding", "verdict"),
    [
        ({"verdict": "still failing", "episode": "2/3", "was": "1/3"}, "supported"),
        ({"verdict": "still failing", "episode": "2/3"}, "supported"),
        ({"verdict": "still failing", "episode": "2/3", "was": "1/0"}, "undecided"),
        ({"verdict": "new", "episode": "2/3", "was": "1/0"}, "refuted"),
        ({"verdict": "fixed", "episode": "2/3"}, "undecided"),
        ({"verdict": "fixed", "episode": ""}, "undecided"),
        ({"verdict": "still failing", "episode": "2/9"}, "undecided"),
    ],
)
def test_known_failures_have_the_outcomes_of_their_episodes(judge, make, finding, verdict):
    known = GateFinding(what="mode 1", **finding | {"verdict": GateVerdict(finding["verdict"])})
    said = {"verdict": GateVerdict.STILL_FAILING, "counts": {GateVerdict.STILL_FAILING: 1}}
    assert judge(make("sssc", 1), make("sssc", 2), known=(known,), **said) == verdict


def test_a_report_that_leaves_out_episodes_in_doubt_is_not_followed(judge, make):
    """The third episode errored on both sides, and the report says that the gate is open."""
    before, now = make("ssec", 1), make("ssec", 2)
    counts = {GateVerdict.STILL_FAILING: 1}
    assert judge(before, now, verdict=GateVerdict.STILL_FAILING, counts=counts) == "undecided"
