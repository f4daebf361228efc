"""The severity of failures that chains have sampled."""

import pytest
from chain_campaigns import CHAINS, EPISODES, Campaigns

from eigenfail import plugins
from eigenfail_assurance.risk.campaigns import assess_campaigns
from eigenfail_assurance.risk.question import Driving, RiskQuestion, RiskScenario, RiskTarget
from eigenfail_services.campaigns.summary import find_chain_mixing

pytestmark = pytest.mark.skipif(
    "chains" not in plugins.names(plugins.METHODS), reason="the method chains is not installed"
)


@pytest.fixture
def campaigns():
    made = Campaigns()
    yield made
    made.store.close()


def test_the_severity_of_a_risk_is_that_of_failures_after_burn_in(campaigns):
    moved = campaigns.finish(campaigns.chains())
    question = RiskQuestion(
        name="q",
        target=RiskTarget(per_hour=1.0),
        exposure=Driving(hours=10.0),
        scenarios=(
            RiskScenario(
                name="a", encounters=3, campaigns=(campaigns.before,), failures_from=moved
            ),
        ),
        severity=(50.0,),
    )
    found = assess_campaigns(campaigns.store, question)
    late = campaigns.store.episodes.finished(moved, range(CHAINS * 11, EPISODES))
    failures = sum(result.is_failure for result in late)
    assert failures < campaigns.store.campaigns.get(moved).counts.failures
    assert sum(each.counted for each in found.severity) == failures
    verdict = find_chain_mixing(campaigns.store, campaigns.store.campaigns.get(moved)).verdict
    (note,) = (each for each in found.notes if "burn-in" in each)
    assert note.startswith(f"Severity from campaign {moved} is that of its failures after burn-in.")
    assert note.endswith(verdict)
