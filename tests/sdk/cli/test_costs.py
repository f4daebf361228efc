"""`eigenfail campaign cost`: what failures cost, method beside method."""

import json

import msgspec
import pytest

from eigenfail.filters import make_outcome_condition
from eigenfail.values.episode import Outcome
from eigenfail.values.summary import CampaignCost


@pytest.fixture
def costs(eigenfail):
    """What the command prints as JSON."""

    def ask(*campaigns):
        told = eigenfail("campaign", "cost", *campaigns, "--json")
        assert told.exit_code == 0, told.output
        return msgspec.json.decode(told.stdout, type=list[CampaignCost])

    return ask


def test_methods_stand_side_by_side(eigenfail, done, spec_file, costs, store):
    rulebook = spec_file.read_text().replace('"idm"', '"rulebook"')
    spec_file.write_text(rulebook.replace("= 24", "= 8"))
    calm = json.loads(eigenfail("run", spec_file, "--json").stdout)["campaign"]
    told = eigenfail("campaign", "cost", done, calm)
    assert told.exit_code == 0, told.output
    found = costs(done, calm)
    assert [each.campaign for each in found] == [done, calm]
    words = " ".join(told.stdout.split())
    assert f"{done} monte_carlo {calm} monte_carlo" in words
    assert f"Campaign {done}: No analysis is done" in words
    assert "100 % 0 % 0 % 0 %" in words
    last = [line.split() for line in told.stdout.splitlines() if "failures" in line][-1]
    assert last[1:3] == [str(store.campaigns.get(done).counts.failures), "failures"]


def test_without_a_failure_there_is_a_bound(eigenfail, spec_file, costs):
    calm = spec_file.read_text().replace('"idm"', '"rulebook"').replace("= 24", "= 8")
    spec_file.write_text(calm)
    campaign = json.loads(eigenfail("run", spec_file, "--json").stdout)["campaign"]
    (found,) = costs(campaign)
    assert found.failures == 0
    assert "≥ 0.0" in eigenfail("campaign", "cost", campaign).stdout


def test_it_costs_what_it_found(done, costs, store):
    (found,) = costs(done)
    crashes = store.episodes.page(done, 100, where=make_outcome_condition(Outcome.COLLISION)).items
    assert found.curve[-1].failures == found.failures == len(crashes)
    assert found.curve[-1].usd == pytest.approx(found.cost.total_usd)


def test_what_does_not_exist_exits_with_2(check_session, done):
    check_session("cli/errors/cost", ("campaign", "cost", done, 99), ("campaign", "cost"))
