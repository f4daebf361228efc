"""A learner killed before its first checkpoint, while it learns, and behind a checkpoint."""

import deadlines
import pytest
from stage import CAMPAIGNS, Stage
from started import Services, wait_until

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]


@pytest.mark.fault(
    "SIGKILL of a learner",
    group="processes",
    outcome="The learner starts again from its checkpoint and learns the same. Workers keep "
    "their leases and continue.",
)
@pytest.mark.parametrize("method", ["ast", "difs"])
def test_a_killed_learner_learns_the_same(
    stage: Stage, undisturbed: dict[str, str], method: str
) -> None:
    services = stage.services()
    campaign = stage.create(**CAMPAIGNS[method])
    kill_learner(services)  # before it has said anything
    stage.worker()
    stage.wait_for(campaign, 24)  # a whole number of rounds: it learns from the last one
    saved_ms = stage.saved_ms(campaign)
    kill_learner(services)
    stage.wait_for(campaign, 40)
    stage.wait_for_checkpoint(campaign, saved_ms)
    assert not stage.is_over(campaign)
    kill_learner(services)
    stage.unchanged({method: campaign}, undisturbed)


def kill_learner(services: Services) -> None:
    """kill -9 of the only one, and wait until there is another."""
    wait_until(lambda: len(services.learners()) == 1, "a learner lives")
    (learner,) = services.learners()
    learner.kill()
    wait_until(
        lambda: [each.pid for each in services.learners()] not in ([], [learner.pid]),
        "another learner lives",
    )
