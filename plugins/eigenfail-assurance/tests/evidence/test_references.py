"""Bundles whose numbers come from other campaigns than the question names, and what is refused."""

import pytest
from msgspec.structs import replace

from eigenfail import __version__
from eigenfail.errors import InvalidValue
from eigenfail.gate.report import GateRun, build_report
from eigenfail.values.campaign import CampaignState
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.proof import Proof, ProvenScenario, ReplayedNoise, ReplayKind, Reproduction
from eigenfail_assurance.evidence.bundle import make_bundle
from eigenfail_assurance.evidence.question import (
    Claim,
    EvidenceQuestion,
    GateSolution,
    ProbabilitySolution,
    ReplaySolution,
    RiskSolution,
    SearchSolution,
)
from eigenfail_assurance.evidence.records import EvidenceRecords, SolutionInput
from eigenfail_assurance.evidence.storage import write_bundle
from eigenfail_assurance.evidence.verification import verify_bundle
from eigenfail_assurance.risk.question import Driving, RiskQuestion, RiskScenario, RiskTarget


@pytest.fixture
def find_places(tmp_path, monkeypatch):
    """Makes a bundle as somebody does who leaves out the check, and lists what verify finds."""

    def verify_solution(solution, given, *records):
        question = EvidenceQuestion(name="Q", claim=Claim(text="It holds.", solutions=(solution,)))
        known = EvidenceRecords({each.campaign.id: each for each in records}, (given,))
        with monkeypatch.context() as forger:
            forger.setattr(
                "eigenfail_assurance.evidence.solutions.check_references",
                lambda *_: None,
                raising=False,
            )
            write_bundle(make_bundle(question, known, __version__).files, tmp_path / "bundle")
        checked = verify_bundle(tmp_path / "bundle")
        if checked.defects:
            with pytest.raises(InvalidValue):
                make_bundle(question, known, __version__)
        return [each.where for each in checked.defects]

    return verify_solution


def vary(record, **fields):
    campaign = record.campaign
    changed = replace(campaign, spec=replace(campaign.spec, **fields))
    return replace(record, facts=replace(record.facts, campaign=changed))


REFUSED = ["Sn1: campaigns"]
BOTH = ProbabilitySolution(campaigns=(1, 2), at_most=0.5)


@pytest.mark.parametrize(
    "case",
    [
        ((1,), ((1,),), []),
        (("made up 1",), ((1,),), []),
        ((1, 2), ((1, 2),), []),
        ((1,), ((2,),), REFUSED),
        (("made up 1",), ((2,),), REFUSED),
        ((1,), ((1, 2),), REFUSED),
        ((1, 2), ((1,),), REFUSED),
        ((1, 2), ((1,), (2,)), REFUSED),
        ((1, 1), ((1, 1),), REFUSED),
        ((1, "made up 1"), ((1, 1),), REFUSED),
    ],
)
@pytest.mark.parametrize("kind", [ProbabilitySolution, SearchSolution])
def test_the_campaigns_are_those_that_the_question_names(make, find_places, kind, case):
    named, groups, places = case
    solution = kind(campaigns=named, **({"at_most": 0.5} if kind is ProbabilitySolution else {}))
    used = {each for group in groups for each in group}
    records = [make("s" * 9, each, seed=each) for each in used]
    assert find_places(solution, SolutionInput(campaigns=groups), *records) == places


@pytest.mark.parametrize(
    "varied",
    [
        {"planner": "rulebook"},
        {"planner_settings": {"min_gap_m": 9.0}},
        {"planner_version": "v2"},
        {"scenario": "lead_brake"},
        {"scenario_parameters": {"ego_speed_mps": 9.0}},
        {"simulator": "highway"},
        {"disturbance": DisturbanceModel(scale=0.5)},
        {"seed": 1},
    ],
)
def test_campaigns_that_are_counted_together_differ_in_seed_and_budget_alone(
    make, find_places, varied
):
    one, other = make("s" * 9, 1, seed=1), make("s" * 8, 2, seed=1 if "seed" in varied else 2)
    given = SolutionInput(campaigns=((1, 2),))
    assert find_places(BOTH, given, one, vary(other, **varied)) == REFUSED


def test_a_search_counts_no_episode_twice_and_may_have_several_methods(make, find_places):
    solution, given = SearchSolution(campaigns=(1, 2)), SolutionInput(campaigns=((1, 2),))
    assert find_places(solution, given, make("sss", 1), make("ssss", 2)) == REFUSED


def test_replays_of_the_same_noise_are_the_same_episodes_from_any_seed(make, find_places):
    solution, given = SearchSolution(campaigns=(1, 2)), SolutionInput(campaigns=((1, 2),))
    one, other = make("sss", 1, method="replay"), make("ssss", 2, seed=4, method="replay")
    assert find_places(solution, given, one, other) == REFUSED


def test_searches_of_several_methods_are_counted_together(make, find_places):
    solution, given = SearchSolution(campaigns=(1, 2)), SolutionInput(campaigns=((1, 2),))
    assert find_places(solution, given, make("sss", 1), make("ssss", 2, method="ast")) == []


@pytest.mark.parametrize(
    ("groups", "fields", "places"),
    [
        (((1,), (2,)), {}, []),
        (((2,), (1,)), {}, REFUSED),
        (((1,), (2,)), {"planner": "rulebook"}, ["Sn1: scenarios[1].campaigns"]),
    ],
)
def test_a_risk_is_that_of_its_scenarios_and_of_one_planner(
    make, find_places, groups, fields, places
):
    scenarios = tuple(
        RiskScenario(name=f"{number}", per_hour=1.0, campaigns=(number,)) for number in (1, 2)
    )
    question = RiskQuestion(
        name="Road",
        target=RiskTarget(per_hour=0.9),
        exposure=Driving(hours=1.0),
        scenarios=scenarios,
    )
    records = [make("s" * 9, 1, seed=1), vary(make("s" * 9, 2, seed=2), **fields)]
    given = SolutionInput(campaigns=groups)
    assert find_places(RiskSolution(question=question), given, *records) == places


def prove(analysis):
    replays = (ReplayedNoise(what=ReplayKind.EIGENFAILURE, mode=0, campaign=2, index=0),)
    none = {"eigenfailures": Reproduction(), "medoids": Reproduction()}
    scenario = ProvenScenario(
        scenario_parameters={}, campaign=2, state=CampaignState.DONE, replays=replays, **none
    )
    return Proof(
        analysis=analysis,
        done=True,
        reproduced=Reproduction(),
        modes=(),
        scenarios=(scenario,),
        **none,
    )


@pytest.mark.parametrize(
    ("replayed", "fields", "places"),
    [
        (7, {}, []),
        (8, {}, ["Sn1: proof"]),
        (7, {"planner": "rulebook"}, ["Sn1: proof"]),
    ],
)
def test_replays_are_those_of_the_proof_with_the_planner_of_the_campaign(
    make, find_places, replayed, fields, places
):
    replay = vary(make("c", 2, method="replay"), settings={"analysis": replayed}, **fields)
    given = SolutionInput(campaigns=((1,),), proof=prove(7))
    assert find_places(ReplaySolution(campaign=1), given, make("cs", 1), replay) == places


def test_a_gate_takes_its_campaigns_from_its_report_alone(make, find_places):
    report = build_report(GateRun(suite="s", version="v2", run="s v2", baseline="v1"), [])
    given = SolutionInput(campaigns=((1,),))
    assert find_places(GateSolution(report=report), given, make("s")) == REFUSED
