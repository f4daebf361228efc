"""Campaigns of chains, from the failures of an earlier campaign to what is said of their mixing."""

from collections.abc import Iterator

import pytest
from chain_campaigns import CHAINS, EPISODES, Campaigns

from eigenfail.errors import Conflict, InvalidValue, LearnerFailed
from eigenfail.presentation.analyses import describe_chain_mixing
from eigenfail.values.analysis import AnalysisSettings
from eigenfail_searches.chains.diagnostics import judge_projections
from eigenfail_services.campaigns.analysis_jobs import run_analysis
from eigenfail_services.campaigns.summary import find_chain_mixing


@pytest.fixture(scope="module")
def campaigns() -> Iterator[Campaigns]:
    made = Campaigns()
    yield made
    made.store.close()


@pytest.fixture(scope="module")
def moved(campaigns) -> int:
    return campaigns.finish(campaigns.chains())


def test_the_mixing_of_a_campaign_is_told(campaigns, moved) -> None:
    found = find_chain_mixing(campaigns.store, campaigns.store.campaigns.get(moved))
    assert (found.chains, found.started) == (CHAINS, CHAINS)
    assert found.first_sample == CHAINS * (1 + 10)
    assert found.moves == EPISODES - found.first_sample
    assert found.draws == found.moves // CHAINS
    late = campaigns.store.episodes.finished(moved, range(found.first_sample, EPISODES))
    assert found.accepted == sum(result.is_failure for result in late)
    assert found.projections[0].r_hat == max(one.r_hat for one in found.projections)
    assert (found.mixed, found.verdict) == judge_projections(found.projections)
    assert not found.mixed
    assert "shares of the starts" in found.remark
    *sentences, table = describe_chain_mixing(found)
    assert sentences[0] == "Chains: the starts of 5 of 5 failed."
    assert sentences[2:] == [found.verdict, found.remark]
    assert len(table.rows) == len(found.projections)


def test_an_analysis_takes_the_failures_after_burn_in_and_says_so(campaigns, moved) -> None:
    first = CHAINS * 11
    results = {}
    for failures in ("latest", "all"):
        settings = AnalysisSettings(failures=failures, clusters=2, bootstrap=0)
        analysis = campaigns.store.analyses.create(moved, settings).id
        run_analysis(campaigns.store, analysis)
        results[failures] = campaigns.store.analyses.get(analysis).result
    every = results["all"].episodes
    assert every[0] == 0
    assert results["latest"].episodes == tuple(index for index in every if index >= first)
    assert f"after burn-in, from episode {first} on" in results["latest"].notes[-1]
    assert "before the end of burn-in" in results["all"].notes[-1]


def test_a_campaign_with_less_than_its_burn_in_is_not_judged(campaigns) -> None:
    number = campaigns.chains()
    with pytest.raises(Conflict, match=f"No chain of campaign {number} has started"):
        find_chain_mixing(campaigns.store, campaigns.store.campaigns.get(number))
    with pytest.raises(Conflict, match="monte_carlo, which has no chains"):
        find_chain_mixing(campaigns.store, campaigns.store.campaigns.get(campaigns.before))
    few = {"campaign": campaigns.before, "chains": CHAINS, "burn_in": 0.9}
    short = campaigns.finish(campaigns.chains(episodes=50, settings=few))
    found = find_chain_mixing(campaigns.store, campaigns.store.campaigns.get(short))
    assert (found.projections, found.mixed) == ((), False)
    assert found.verdict.startswith("Not known yet")


def test_starts_that_are_safe_in_another_scenario_end_the_campaign(campaigns) -> None:
    faster_car = {"distance_m": 70.0, "actor_speed_mps": 16.0}
    number = campaigns.chains(scenario_parameters=faster_car)
    with pytest.raises(LearnerFailed, match="None of the 5 failures"):
        campaigns.finish(number)


def test_campaigns_that_no_chain_can_start_from_are_refused(campaigns) -> None:
    store = campaigns.store
    safe = campaigns.run(method="monte_carlo", episodes=3, scenario_parameters={"distance_m": 70.0})
    queued = campaigns.create(method="monte_carlo", episodes=3)
    merging = {"scenario": "merge_in", "simulator": "highway"}
    for settings, fields, problem in (
        ({"campaign": 99}, {}, "Campaign 99 does not exist"),
        ({"campaign": safe}, {}, f"campaign {safe} has no failure to start from"),
        ({"campaign": queued}, {}, "has not ended"),
        ({"campaign": campaigns.before}, merging, "steps, here they have"),
    ):
        with pytest.raises(InvalidValue, match=problem) as refused:
            campaigns.chains(settings=settings | {"chains": CHAINS}, **fields)
        assert refused.value.field == "settings.campaign"
        assert refused.value.remedy
    assert store.campaigns.get(safe).counts.failures == 0
