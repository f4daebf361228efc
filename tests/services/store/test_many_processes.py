"""Several processes on one database file: waiting, killed, out of room."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from typing import TypeVar

import deadlines
import pytest
from accepted import accept_spec
from store_checks.crowds import at_once
from store_checks.jobs import waited_for

from eigenfail.testing.examples import spec
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.records import JobKind
from eigenfail_services.store.store import Store, open_store

pytestmark = pytest.mark.service

Answer = TypeVar("Answer")

PATIENCE_S = deadlines.CAMPAIGN_S
MOST_TURNS = 2_000
"""Of another writer, while one waits for four of its own: more would be starving."""

PREAMBLE = """
import json, sys, time
from accepted import accept_specs
from eigenfail.errors import StoreUnavailable
from eigenfail.testing.examples import result, spec
from store_checks.examples import deliver, running
from eigenfail.values.campaign import CampaignState
from eigenfail.values.records import Delivery
from eigenfail_services.store.store import open_store
def tell(**words): print(json.dumps(words), flush=True)
"""

OPEN = "open_store(sys.argv[1]).close()"

COMMIT_FOREVER = """
store = open_store(sys.argv[1])
campaign = running(store, episodes=1_000_000)
tell(campaign=campaign.id)
index = 0
while True:
    deliver(store, campaign, *map(result, range(index, index + 64)))
    index += 64
    tell(acked=index)
"""

CREATE_FOREVER = """
store = open_store(sys.argv[1])
acked = 0
while True:
    wanted = accept_specs(spec(seed=seed) for seed in range(20))
    store.campaigns.create_many(wanted, str(acked))
    acked += 20
    tell(acked=acked)
"""

RUN_OUT_OF_ROOM = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
store = open_store(sys.argv[1])
campaign = running(store, episodes=1_000_000)
_, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, hard))
acked = 0
try:
    while True:
        deliver(store, campaign, *map(result, range(acked, acked + 64)))
        acked += 64
except StoreUnavailable as error:
    full = str(error)
counts = store.campaigns.get(campaign.id).counts
stored = len(store.episodes.finished(campaign.id, range(acked + 64)))
resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
again = deliver(store, campaign, *map(result, range(acked, acked + 64)))
tell(acked=acked, completed=counts.completed, stored=stored, full=full, again=again)
"""


STAND_STILL = """
import signal
from eigenfail.errors import ClaimLost
stopped = []
signal.signal(signal.SIGCONT, lambda *_: stopped.append(True))
store = open_store(sys.argv[1])
campaign = running(store).id
claim = store.jobs.claim("old", 0.2)
store.checkpoints.save(campaign, b"old", claim=claim)
tell(campaign=campaign)
while not stopped:
    time.sleep(0.01)
writes = (
    lambda: store.checkpoints.save(campaign, b"older", claim=claim),
    lambda: store.campaigns.move(campaign, CampaignState.DEAD, "It diverged.", claim),
    lambda: store.campaigns.add_active(campaign, 5.0, claim=claim),
)
refused = 0
for write in writes:
    try:
        write()
    except ClaimLost:
        refused += 1
tell(refused=refused, held=store.jobs.renew(claim, 60.0))
"""


@pytest.fixture
def start():
    """Starts Python on a piece of code; ends what is left of it."""
    started = []

    def start(code: str, *arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", PREAMBLE + code, *arguments]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()
        process.stdout.close()


def settled(ask: Callable[[], Answer]) -> Answer:
    """What the store says, once a server has noticed that its client is gone."""
    before, found = None, ask()
    while before != found:
        time.sleep(0.2)
        before, found = found, ask()
    return found


@pytest.mark.fault("many processes that write to one database")
def test_a_new_database_may_be_opened_by_many_at_once(start, tmp_path, postgres_url) -> None:
    for url in (f"sqlite:///{tmp_path / 'a.db'}", postgres_url):
        processes = [start(OPEN, url) for _ in range(2)]
        at_once(lambda _, url=url: open_store(url).close())
        assert [process.wait(PATIENCE_S) for process in processes] == [0, 0]
        store = open_store(url, migrate=False)
        assert store.campaigns.create(accept_spec(spec())).id == 1
        store.close()


@pytest.mark.fault(
    "many processes that write to one database",
    group="storage",
    outcome="They wait for each other; the counts stay right.",
)
def test_two_writing_processes_wait_for_each_other(start, url) -> None:
    process = start(COMMIT_FOREVER, url)
    busy = json.loads(process.stdout.readline())["campaign"]
    store, turns = open_store(url), []
    while len(turns) < 15 or (len(turns) < 3_000 and not sum(turns)):
        before = counts_of(store, busy).completed
        campaign = store.campaigns.create(accept_spec(spec())).id
        store.campaigns.move(campaign, CampaignState.RUNNING)
        store.campaigns.move(campaign, CampaignState.DONE)
        store.campaigns.add_active(busy, 0.1)
        turns.append((counts_of(store, busy).completed - before) // 64)
        assert process.poll() is None
    # Told in the other's turns, not in seconds, which depend on who else is busy here.
    assert max(turns) < MOST_TURNS
    assert sum(turns) > 0
    store.close()


def counts_of(store: Store, campaign: int) -> Counts:
    return store.campaigns.get(campaign).counts


@pytest.mark.fault(
    "SIGKILL of a process that writes to the database",
    group="storage",
    outcome="Everything that was acknowledged is there, and a group of campaigns is stored "
    "whole or not at all.",
)
def test_what_was_acknowledged_survives_a_kill_at_any_moment(start, url) -> None:
    for delay_s in (0.05, 0.13, 0.29):
        process = start(COMMIT_FOREVER, url)
        campaign = json.loads(process.stdout.readline())["campaign"]
        time.sleep(delay_s)
        process.send_signal(signal.SIGKILL)
        acked = [json.loads(line)["acked"] for line in process.stdout if line.endswith("\n")]
        store = open_store(url)
        counts = settled(lambda store=store, campaign=campaign: counts_of(store, campaign))
        stored = store.episodes.finished(campaign, range(counts.completed + 1_000))
        assert [each.index for each in stored] == list(range(counts.completed))
        assert counts.completed >= max(acked, default=0)
        assert counts.completed % 64 == 0
        store.close()


@pytest.mark.fault("SIGKILL of a process that writes to the database")
def test_a_kill_in_the_middle_of_many_campaigns_leaves_all_of_them_or_none(start, url) -> None:
    store, there = open_store(url), 0
    for delay_s in (0.02, 0.06, 0.1):
        process = start(CREATE_FOREVER, url)
        first = json.loads(process.stdout.readline())["acked"]
        time.sleep(delay_s)
        process.send_signal(signal.SIGKILL)
        acked = [json.loads(line)["acked"] for line in process.stdout if line.endswith("\n")]
        seeds = [each.spec.seed for each in settled(lambda: everything(store))]
        # The keys of the next process are those of the first one: it makes what is missing.
        assert seeds == [*reversed(range(20))] * (len(seeds) // 20)
        assert len(seeds) >= max([there, first, *acked])
        there = len(seeds)
        assert store.jobs.waiting(JobKind.CAMPAIGN) == len(seeds)
    store.close()


@pytest.mark.fault("SIGSTOP of the services")
def test_who_was_stopped_beyond_its_lease_writes_nothing_when_it_goes_on(start, url) -> None:
    process = start(STAND_STILL, url)
    campaign = json.loads(process.stdout.readline())["campaign"]
    process.send_signal(signal.SIGSTOP)
    store = open_store(url)
    claim = waited_for(store)
    assert claim.subject == campaign
    store.checkpoints.save(campaign, b"new", claim=claim)
    before = store.campaigns.get(campaign)
    process.send_signal(signal.SIGCONT)
    told = json.loads(process.communicate(timeout=PATIENCE_S)[0])
    assert told == {"refused": 3, "held": False}
    assert store.checkpoints.load(campaign) == b"new"
    assert store.campaigns.get(campaign) == before
    ended = store.campaigns.move(campaign, CampaignState.DONE, claim=claim)
    assert ended.state is CampaignState.DONE
    store.close()


def everything(store: Store) -> tuple[Campaign, ...]:
    return store.campaigns.page(100_000).items


@pytest.mark.fault("disk full")
def test_a_full_disk_loses_nothing_and_work_goes_on_after_it(start, sqlite_url) -> None:
    process = start(RUN_OUT_OF_ROOM, sqlite_url)
    told = json.loads(process.communicate(timeout=PATIENCE_S)[0])
    assert told["acked"] == told["completed"] == told["stored"] > 0
    assert "has room" in told["full"]
    assert told["again"] == ["kept"] * 64
