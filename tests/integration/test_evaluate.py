"""On a real service: what a campaign has learnt is evaluated elsewhere, and an ensemble runs."""

import deadlines
import pytest

from eigenfail.errors import InvalidValue
from eigenfail.values.campaign import CampaignState

pytestmark = pytest.mark.service

FIELDS = {"name": "chain", "planner": "idm", "episodes": 40, "simulator": "point_mass"}
AST = {"round_size": 5, "warm_up": 5, "gradient_steps": 1}


def finish(client, **fields):
    created = client.campaigns.create(**FIELDS | fields)
    ended = client.campaigns.wait(created.id, timeout_s=deadlines.CAMPAIGN_S)
    assert ended.state is CampaignState.DONE, ended.stopped_because
    assert ended.counts.completed == ended.counts.planned
    return ended.id


def test_train_then_evaluate_there_and_farther_away(client, lasting_worker, start_worker) -> None:
    trained = finish(client, method="cem", seed=1)
    evaluate = {"method": "evaluate", "settings": {"campaign": trained}, "seed": 2}
    here = finish(client, **evaluate)
    assert client.campaigns.digest(here) == again(client, start_worker, **evaluate)
    finish(client, **evaluate, scenario_parameters={"distance_m": 63.0})
    rows = list(client.episodes.list(here))
    assert {row.source for row in rows} == {"trajectory"}


def again(client, start_worker, **fields):
    start_worker()
    return client.campaigns.digest(finish(client, **fields))


def test_what_cannot_be_evaluated_is_refused_at_once(client, lasting_worker) -> None:
    plain = finish(client, method="monte_carlo", episodes=2)
    for campaign, problem in ((plain, "learns nothing"), (10_000, "Campaign 10000 does not exist")):
        with pytest.raises(InvalidValue, match=problem):
            client.campaigns.create(**FIELDS, method="evaluate", settings={"campaign": campaign})


def test_an_ensemble_of_policies_is_the_same_whoever_runs_it(
    client, lasting_worker, start_worker
) -> None:
    """Every round brings another member's policy, more of them than a worker keeps."""
    settings = {"members": 3, "settings": AST}
    one = finish(client, method="ensemble", settings=settings, episodes=75)
    digest = client.campaigns.digest(one)
    assert again(client, start_worker, method="ensemble", settings=settings, episodes=75) == digest
    assert {row.source for row in client.episodes.list(one)} == {"policy"}
