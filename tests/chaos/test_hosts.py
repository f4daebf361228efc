"""Controller, services and workers on machines of their own: cut off, slow, late, and gone."""

import json
import subprocess
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import deadlines
import pytest
from hosts import Host, Namespaces, Network
from sqlalchemy import text
from stage import Stage
from started import wait_until

from eigenfail_services.store.migrate import upgrade

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]

PORT = 8441
RATE = "1mbit"
FIELDS = {"method": "ast", "episodes": 36, "settings": {"round_size": 12}, "simulator": "highway"}
BROUGHT = text("SELECT count(*) FROM episodes WHERE campaign = :campaign AND worker = :worker")


@pytest.fixture
def network() -> Iterator[Network]:
    try:
        made = Network()
    except (Namespaces, OSError) as error:
        pytest.skip(f"NOT PROVED HERE: hosts of their own, as there are no namespaces: {error}")
    with closing(made):
        yield made


class Site:
    """A controller's host, the services' host, and hosts of workers that hold a key."""

    def __init__(self, network: Network, url: str, folder: Path) -> None:
        self.network, self._url, self._folder = network, url, folder
        self._keys = folder / "hub-keys"
        self.desk, self.core = network.host("desk"), network.host("core")
        self.hub = f"tcp://{self.core.address}:{PORT}"
        self._running: dict[Host, subprocess.Popen[bytes]] = {}

    def open(self) -> None:
        """Make a key for each worker's host, and start what is no worker."""
        for name in ("rack1", "rack2", "rack3"):
            file = str(self._folder / f"{name}.key")
            words = ("create", name, "--hub-keys", str(self._keys), "--file", file)
            self.core.eigenfail("worker", "key", *words)
        database = ("--database", self._url)
        self.desk.start("eigenfail_api", *database, log=self._folder / "controller.log")
        hub = ("--hub", self.hub, "--hub-keys", str(self._keys), "--launcher", "none")
        self.core.start("eigenfail_services", *database, *hub, log=self.log)

    @property
    def log(self) -> Path:
        return self._folder / "services.log"

    def worker(self, name: str) -> Host:
        """One more host, with a worker on it."""
        host = self.network.host(name)
        self.man(host)
        return host

    def man(self, host: Host) -> None:
        """Start a worker on a host."""
        words = ("--connect", self.hub, "--name", f"w-{host.name}")
        key = ("--key-file", str(self._folder / f"{host.name}.key"))
        log = self._folder / f"{host.name}.log"
        self._running[host] = host.start("eigenfail_workers", *words, *key, log=log)

    def send_home(self, host: Host) -> int:
        """Ask the worker of a host to leave; its exit status."""
        self._running[host].terminate()
        return self._running[host].wait(deadlines.PROCESS_S)

    def listed(self) -> dict[str, tuple[str, str]]:
        """Workers with their hosts and states, as the command line lists them on the desk."""
        told = self.desk.eigenfail("worker", "list", "--json")
        return {each["worker"]: (each["host"], each["state"]) for each in json.loads(told)}

    def wait_until_lost(self, host: Host) -> None:
        """Until the services have given up the worker of a host."""
        words = ("worker lost", f"worker=w-{host.name}")
        wait_until(
            lambda: any(
                all(word in line for word in words) for line in self.log.read_text().splitlines()
            ),
            f"the worker of {host.name} is given up",
        )


@pytest.mark.fault(
    "host of a worker disconnected, slow, late or gone",
    group="messages",
    outcome="Its episodes go to others after 10 s. Results that it finished count when it is "
    "back; the campaign keeps its digest.",
)
def test_hosts_that_are_cut_off_slow_late_and_gone_change_nothing(
    network: Network, postgres_url: str, tmp_path: Path
) -> None:
    upgrade(postgres_url)
    stage, site = Stage(postgres_url, tmp_path), Site(network, postgres_url, tmp_path)
    try:
        befall(stage, site)
    finally:
        stage.end()


def befall(stage: Stage, site: Site) -> None:
    site.open()
    first, second = site.worker("rack1"), site.worker("rack2")
    calm = stage.create(**FIELDS)
    digest = stage.finish(calm).digests[calm]

    campaign = stage.create(**FIELDS)
    stage.wait_for(campaign, 4)
    site.network.unplug(second)
    # With the first one gone, too, the rest of the campaign is the late host's: however slowly it
    # starts on a loaded machine, the campaign cannot be over before it has brought a result.
    assert site.send_home(first) == 0
    assert not stage.is_over(campaign), "nothing befell the campaign"
    late = site.network.host("rack3")
    site.network.slow_down(late, RATE)
    site.man(late)
    site.wait_until_lost(second)
    wait_until(lambda: brought(stage, campaign, late) > 0, "the late host brings a result")
    site.network.plug_in(second)
    found = stage.finish(campaign)

    assert found.digests[campaign] == digest
    names = [f"w-{host.name}" for host in (second, late)]
    wait_until(lambda: names == sorted(present(site.listed())), "both others are listed")
    listed = site.listed()
    assert {listed[f"w-{host.name}"][0] for host in (second, late)} == {"rack2", "rack3"}
    assert listed["w-rack1"] == ("", "gone")


def present(listed: dict[str, tuple[str, str]]) -> list[str]:
    return [name for name, (_, state) in listed.items() if state != "gone"]


def brought(stage: Stage, campaign: int, host: Host) -> int:
    return stage.ask(BROUGHT, {"campaign": campaign, "worker": f"w-{host.name}"})
