"""A risk from two small campaigns that a real service has run."""

import pytest

from eigenfail.client import Client
from eigenfail_assurance.risk.assessment import RiskVerdict
from eigenfail_assurance.risk.client import assess_risk
from eigenfail_assurance.risk.question import Driving, RiskQuestion, RiskScenario, RiskTarget


@pytest.mark.service
def test_two_campaigns_of_monte_carlo_are_a_risk(client: Client, lasting_worker: object) -> None:
    assert lasting_worker
    done = [
        client.campaigns.wait(
            client.campaigns.create(
                name=f"challenge {seed}",
                method="monte_carlo",
                episodes=30,
                seed=seed,
                planner="idm",
                simulator="point_mass",
            ).id
        )
        for seed in (1, 2)
    ]
    question = RiskQuestion(
        name="Motorway",
        target=RiskTarget(per_million_km=1e6),
        exposure=Driving(hours=100.0, kilometres=8_000.0),
        scenarios=tuple(
            RiskScenario(name=each.spec.name, encounters=20, campaigns=(each.spec.name,))
            for each in done
        ),
        severity=(50.0,),
    )
    found = assess_risk(client, question)
    failures = [each.counts.failures for each in done]
    assert [each.campaigns for each in found.scenarios] == [(each.id,) for each in done]
    assert found.per_hour.value == pytest.approx(0.2 * sum(failures) / 30)
    assert found.per_million_km is not None
    assert found.per_million_km.value == pytest.approx(0.2 * sum(failures) / 30 / 80.0 * 1e6)
    assert found.verdict is RiskVerdict.MET
    assert sum(each.counted for each in found.severity) == sum(failures)
    assert sum(each.episodes for each in found.next.shares) == 10_000
