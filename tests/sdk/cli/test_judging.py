"""Whether a campaign passes its gate while some of its episodes may hide a failure."""

import pytest
import typer

from eigenfail.cli.render import judge
from eigenfail.errors import ServiceError
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.estimates import Cost
from eigenfail.values.summary import Summary, Unresolved


def make_campaign(counts: Counts) -> Campaign:
    spec = CampaignSpec(
        name="hard", scenario="function", planner="hard:f", method="monte_carlo", episodes=200
    )
    return Campaign(id=7, spec=spec, state=CampaignState.DONE, counts=counts, created_ms=0)


def summarise(counts: Counts, unresolved: int) -> Summary:
    return Summary(
        campaign=7,
        name="hard",
        method="monte_carlo",
        counts=counts,
        failure_rate=None,
        mean_log_probability=None,
        log_probability_per_step=None,
        mean_severity=None,
        episodes_per_s=None,
        cost=Cost(0.0, 0.0, None, None, None),
        unresolved=Unresolved(unresolved),
    )


@pytest.mark.parametrize(
    ("errored", "unresolved", "said"),
    [
        (54, 0, "found no failure, but 54 episodes errored and may hide one"),
        (0, 2, "found no failure, but 2 episodes ended unresolved and may hide one"),
    ],
)
def test_gate_does_not_pass_with_episodes_that_may_hide_a_failure(errored, unresolved, said):
    counts = Counts(200, completed=200 - errored, errored=errored)
    with pytest.raises(ServiceError, match=said):
        judge(make_campaign(counts), True, summarise(counts, unresolved))
    judge(make_campaign(counts), False, summarise(counts, unresolved))


def test_gate_with_failures_ends_with_1_whatever_errored():
    counts = Counts(200, completed=146, errored=54, failures=1)
    with pytest.raises(typer.Exit) as exit_:
        judge(make_campaign(counts), True, summarise(counts, 0))
    assert exit_.value.exit_code == 1
