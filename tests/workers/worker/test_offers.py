"""What the bridge of a worker offers reaches its hub, and the next hub, and is withdrawn."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from threading import Thread

import deadlines
import pytest

from eigenfail.bridges import ADDRESS_VARIABLE
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.wire import messages
from eigenfail_workers.bridge.connection import SharedConnection, make_timeouts
from eigenfail_workers.worker import parent
from eigenfail_workers.worker.parent import Parent

pytestmark = pytest.mark.service

BRIDGE = Path(__file__).parents[3] / "examples" / "bridge" / "minimal.py"
BEATS = 8
ON_BRIDGE = CampaignSpec(
    name="t",
    method="monte_carlo",
    episodes=9,
    simulator="bridge",
    scenario_parameters={"steps": 9},
)


class Bridge:
    """The reference bridge as a program that comes and goes."""

    def __init__(self, address: str) -> None:
        self.address = address
        self.program: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        command = [sys.executable, str(BRIDGE), self.address]
        self.program = subprocess.Popen(command, env=environment)

    def stop(self) -> None:
        if self.program is not None:
            self.program.kill()
            self.program.wait()
            self.program = None


@pytest.fixture
def bridge(tmp_path, monkeypatch) -> Iterator[Bridge]:
    made = Bridge(f"ipc://{tmp_path}/b")
    monkeypatch.setenv(ADDRESS_VARIABLE, made.address)
    yield made
    made.stop()


@pytest.fixture
def worker(hub, bridge) -> Iterator[Parent]:
    made = Parent(hub.address, "w")
    thread = Thread(target=made.serve)
    thread.start()
    assert hub.hear(messages.Hello).bridge
    hub.say(messages.Welcome(heartbeat_s=0.2))
    yield made
    made.shut_down()
    made.shut_down()
    thread.join(timeout=deadlines.PROCESS_S)


def hear_beside_hello(hub, kind, *repeated) -> object:
    """Return the next message of a kind; a worker that thinks the hub is gone is let in again.

    A played hub says nothing by itself: where a bridge takes long to start, the worker asks anew.
    What the hub last said to it may be lost then, and is repeated.
    """
    while isinstance(heard := hub.hear(kind | messages.Hello), messages.Hello):
        for message in (messages.Welcome(heartbeat_s=0.2), *repeated):
            hub.say(message)
    return heard


def hear_offer(hub, *repeated) -> object:
    """Return the next offer that is known."""
    while (offer := hear_beside_hello(hub, messages.BridgeReport, *repeated).offer) is None:
        pass
    return offer


def test_the_offer_reaches_each_hub_and_is_withdrawn_with_the_bridge(hub, bridge, worker) -> None:
    assert hear_beside_hello(hub, messages.BridgeReport).offer is None
    bridge.start()
    offer = hear_offer(hub)
    assert offer.name == "minimal"
    assert "distance_m" in offer.scenarios[0].parameters
    hub.say(messages.Refusal("who are you?"))
    hub.hear(messages.Hello)
    hub.say(messages.Welcome(heartbeat_s=0.2))
    assert hear_beside_hello(hub, messages.BridgeReport).offer == offer
    bridge.stop()
    while hear_beside_hello(hub, messages.BridgeReport).offer is not None:
        pass


@pytest.mark.fault("messages lost, duplicated, delayed or reordered")
def test_a_report_that_was_lost_is_repeated(hub, bridge, worker, monkeypatch) -> None:
    monkeypatch.setattr(parent, "BEATS_PER_REPORT", 2)
    bridge.start()
    lost = hear_offer(hub)
    assert hear_beside_hello(hub, messages.BridgeReport).offer == lost
    bridge.stop()
    for _ in range(2):  # The first one to withdraw the offer may be lost as well.
        while hear_beside_hello(hub, messages.BridgeReport).offer is not None:
            pass


def test_a_bridge_is_not_asked_while_a_campaign_is_on_it(hub, bridge, worker) -> None:
    hear_beside_hello(hub, messages.BridgeReport)
    campaign = messages.Setup(1, ON_BRIDGE.setup())
    hub.say(campaign)
    bridge.start()
    with closing(SharedConnection(bridge.address, make_timeouts(deadlines.PROCESS_S))) as there:
        there.get(deadlines.PROCESS_S)
    for _ in range(BEATS):
        heard = hear_beside_hello(hub, messages.Heartbeat | messages.BridgeReport, campaign)
        assert isinstance(heard, messages.Heartbeat) or heard.offer is None
    hub.say(messages.Drop(1))
    assert hear_offer(hub, messages.Drop(1)).name == "minimal"
