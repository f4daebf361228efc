"""Workers whose connections end: noticed soon if they are dead, and no harm if they are not."""

import signal
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import deadlines
import pytest
from inprocess import Service, worker_at
from proxy import Proxy
from sqlalchemy import create_engine, text

from eigenfail_services.hub.keys import HubKeys, KeyFolder

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]

SEED = 20261122
CUTS = 3
WORK = {
    "method": "monte_carlo",
    "planner": "idm",
    "simulator": "point_mass",
    "episodes": 60_000,
}


@pytest.fixture(params=["without keys", "with keys"])
def service(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Service, list[str]]]:
    """A service, and with which options workers come to it."""
    keys, options = None, []
    if request.param == "with keys":
        folder, file = KeyFolder(tmp_path / "keys"), tmp_path / "worker.key"
        folder.create("w", file)
        keys, options = HubKeys(folder), ["--key-file", str(file)]
    with closing(Service(tmp_path, keys)) as running:
        yield running, options


@pytest.mark.fault(
    "SIGKILL of a worker",
    group="processes",
    outcome="The hub sees the closed connection and, after about 3 s, leases the worker's "
    "episodes to others. The campaign keeps its digest.",
)
def test_who_is_killed_is_given_up_before_one_who_was_stopped_earlier(service) -> None:
    running, options = service
    with ExitStack() as stack:
        stopped, killed = (
            stack.enter_context(worker_at(running.hub.address, name, *options))
            for name in ("stopped", "killed")
        )
        running.crew(2)
        stopped.send_signal(signal.SIGSTOP)
        killed.kill()
        running.crew(1)
        assert running.hub.workers() == ["stopped"]
        stopped.send_signal(signal.SIGCONT)


@pytest.mark.fault(
    "worker connection cut",
    group="messages",
    outcome="A worker that connects again keeps its episodes. If it stays away, the hub gives"
    " it up after about 3 s if it sees the closed connection, and after 10 s at the "
    "latest. A worker that is back within 10 s adds no death to an episode.",
)
def test_lines_that_are_cut_cost_no_episode_and_count_no_death(service) -> None:
    running, options = service
    with ExitStack() as stack:
        proxy = stack.enter_context(closing(Proxy(running.hub.address, SEED)))
        for name in ("w0", "w1"):
            stack.enter_context(worker_at(proxy.address, name, *options))
        running.crew(2)
        campaign = running.begin(**WORK)
        for _ in range(CUTS):
            more = running.get(campaign).counts.completed + 100
            running.until(lambda n=more: running.get(campaign).counts.completed > n, "no results")
            before = {*running.hub._leases.sessions}
            proxy.cut()
            running.until(
                lambda old=before: len({*running.hub._leases.sessions} - old) == 2, "nobody is back"
            )
        assert running.hub._leases.list_interrupted() == []
    with create_engine(running.url).connect() as connection:
        assert connection.execute(text("select count(*) from deaths")).scalar() == 0
