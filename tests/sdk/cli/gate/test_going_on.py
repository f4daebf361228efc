"""A gate that is given again runs nothing twice; one that is in trouble says so."""

import os
import signal

from eigenfail.cli.render import INTERRUPTED


def test_the_same_gate_again_runs_nothing_twice(gate, store):
    first = gate("worse", "--json")
    count = len(store.campaigns.page(100).items)
    assert gate("worse", "--json").stdout == first.stdout
    assert len(store.campaigns.page(100).items) == count


def test_ctrl_c_pauses_and_the_same_gate_goes_on(eigenfail, suite, service, store, working_service):
    class Interrupting(type(service)):
        def run_some(self, campaign):
            super().run_some(campaign)
            if campaign.spec.name == "trio @ v2: two" and campaign.counts.completed == 0:
                os.kill(os.getpid(), signal.SIGINT)

    service.__class__ = Interrupting
    service.episodes_at_once = 4
    words = ("gate", suite("better"), "--planner-version", "v2", "--baseline", "v1")
    stopped = eigenfail(*words)
    assert stopped.exit_code == INTERRUPTED
    assert "To continue: eigenfail" in stopped.stderr
    assert "paused" in {campaign.state for campaign in store.campaigns.page(100).items}
    service.__class__ = working_service
    assert eigenfail(*words).exit_code == 0


def test_a_dead_campaign_is_service_trouble(eigenfail, baseline, suite, service):
    class Deadly(type(service)):
        def run_some(self, campaign):
            if campaign.spec.name == "trio @ v2: two":
                self.store.campaigns.move(campaign.id, "dead", "The learner ended.")
            else:
                super().run_some(campaign)

    service.__class__ = Deadly
    done = eigenfail("gate", suite("better"), "--planner-version", "v2", "--baseline", "v1")
    assert done.exit_code == 3
    assert "is dead, so its gate is inconclusive. The learner ended." in done.stderr
