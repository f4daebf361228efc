"""What campaigns that run together say of themselves."""

from msgspec.structs import replace

from eigenfail.cli.render import describe_suite
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec


def campaign(counts):
    spec = CampaignSpec(name="s: a", method="ast", episodes=counts.planned)
    return Campaign(id=1, spec=spec, state=CampaignState.DONE, counts=counts, created_ms=0)


def test_one_thing_is_not_called_several():
    one = campaign(Counts(1, completed=1, failures=1))
    assert describe_suite("s", [one]) == "s: 1 of 1 campaign over: 1/1 episode, 1 failure"
    more = replace(one, counts=Counts(4, completed=3, failures=2))
    assert describe_suite("s", [more, None]) == "s: 1 of 2 campaigns over: 3/4 episodes, 2 failures"
