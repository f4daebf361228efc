"""The services, the controller, and everything at once, killed in the middle and started again."""

import subprocess
import sys
import time
from pathlib import Path

import deadlines
import pytest
from stage import Stage
from started import wait_until
from storm import write_lock

from eigenfail.client import Client
from eigenfail.values.campaign import CampaignState

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]

FIELDS = {"name": "chaos", "method": "monte_carlo", "planner": "idm", "episodes": 100_000}
LONGER_THAN_A_LEASE_S = 11.0


@pytest.mark.fault(
    "SIGKILL of the services",
    group="processes",
    outcome="Results that were not committed stay with their workers, which bring them to the"
    " next services. Jobs are free after 10 s, or within 2 s if the next services run on"
    " the same machine. `eigenfail up` exits with 3; start it again to continue.",
)
@pytest.mark.fault(
    "SIGKILL of every process at once",
    group="processes",
    outcome="The next start continues every campaign; digests are unchanged.",
)
def test_killed_services_go_on_where_they_were(stage: Stage, undisturbed: dict[str, str]) -> None:
    services = stage.services()
    workers = [stage.worker(), stage.worker()]
    campaigns = stage.launch()
    stage.wait_for(campaigns["monte_carlo"], 200)
    services.kill()
    services = stage.services()
    for worker in workers:
        stage.wait_for_more_from(worker, 20)  # the same workers, to whom nobody spoke
    for process in (services, *workers):  # now everything, the learners included
        process.kill()
    assert not stage.are_over(campaigns)
    stage.services()
    stage.worker()
    stage.unchanged(campaigns, undisturbed)


@pytest.mark.fault(
    "SIGKILL of the controller",
    group="processes",
    outcome="Campaigns continue without it, and every answered request is stored. Pages "
    "resume their event stream once it runs again. `eigenfail up` exits with 3.",
)
def test_what_was_granted_outlives_who_granted_it(stage: Stage) -> None:
    controller = stage.controller()
    with Client(controller.url) as client:
        paused, cancelled = (client.campaigns.create(**FIELDS).id for _ in range(2))
        controller.kill()
    assert stage.campaign(cancelled).state is CampaignState.QUEUED
    services, _worker = stage.services(), stage.worker()
    stage.wait_for(paused, 1)
    controller = stage.controller()
    with Client(controller.url) as client:
        client.campaigns.pause(paused)
        client.campaigns.cancel(cancelled)
    for process in (controller, services):
        process.kill()
    assert stage.campaign(paused).state in {CampaignState.PAUSING, CampaignState.PAUSED}
    assert stage.campaign(cancelled).state in {CampaignState.CANCELLING, CampaignState.CANCELLED}


@pytest.mark.fault(
    "restart of the controller while a client waits for a campaign",
    group="processes",
    outcome="The client waits up to a minute for the controller to come back, and then "
    "continues to wait for the campaign.",
)
def test_who_watches_a_campaign_waits_for_a_controller_that_is_started_anew(
    stage: Stage, tmp_path: Path
) -> None:
    campaign, controller = stage.create(method="monte_carlo", episodes=9), stage.controller()
    command = [Path(sys.executable).with_name("eigenfail"), "campaign", "show", str(campaign)]
    said, log = tmp_path / "said", tmp_path / "log"
    with said.open("wb") as out, log.open("wb") as complaints:
        watching = subprocess.Popen(
            [*command, "--watch", "--url", controller.url], stdout=out, stderr=complaints
        )
    wait_until(lambda: b"queued" in said.read_bytes(), "it is watched")
    controller.kill()
    wait_until(lambda: b"waiting" in log.read_bytes(), "it is missed")
    assert watching.poll() is None
    stage.controller(controller.url)
    stage.move(campaign, CampaignState.CANCELLED)
    assert watching.wait(deadlines.PROCESS_S) == 0
    assert b"cancelled" in said.read_bytes()


@pytest.mark.fault(
    "write lock of another program on the SQLite file",
    group="storage",
    outcome="Nothing is acknowledged meanwhile. When the lock is released, work continues, and "
    "the campaigns keep their digests.",
)
def test_a_write_lock_of_another_program_costs_no_episode(
    stage: Stage, undisturbed: dict[str, str]
) -> None:
    stage.services()
    stage.worker()
    campaigns = stage.launch("monte_carlo", "ast")
    stage.wait_for(campaigns["monte_carlo"], 100)
    with write_lock(stage.url):
        before = stage.finished(campaigns["monte_carlo"])
        time.sleep(LONGER_THAN_A_LEASE_S)
        assert stage.finished(campaigns["monte_carlo"]) == before
    assert not stage.are_over(campaigns)
    assert stage.unchanged(campaigns, undisturbed).repeated == 0
