"""Workers that run episodes side by side, or have a bridge: who is lent how much of what."""

from collections import Counter

import pytest

from eigenfail.values.episode import EpisodeTask, PriorSource
from eigenfail.wire.messages import PROTOCOL, Hello
from eigenfail_services.hub.leases import Leases

SLOTS = 8
MANY = 10_000
LONG_S = 40.0

PRIOR = PriorSource()


def tasks(first: int, n: int) -> tuple[EpisodeTask, ...]:
    return tuple(EpisodeTask(index, index, PRIOR) for index in range(first, first + n))


class Table:
    """Leases, and workers that say how many they run side by side."""

    def __init__(self) -> None:
        self.leases = Leases()
        self.slots: dict[bytes, int] = {}

    def join(self, worker: bytes, slots: int = 1, *, bridge: bool = True) -> None:
        hello = Hello(PROTOCOL, worker.decode(), 256, life=worker.decode(), bridge=bridge)
        self.leases.open_session(worker, hello, 0.0)
        self.slots[worker] = slots

    def held(self, worker: bytes) -> list[tuple[int, int]]:
        return [*self.leases.sessions[worker].held]

    def lend(self) -> Counter[bytes]:
        """How many each was lent."""
        leased = self.leases.assign()
        return Counter({w: sum(len(a.tasks) for a in leased if a.worker == w) for w in self.slots})

    def beat(self) -> None:
        for worker, slots in self.slots.items():
            held = self.held(worker)
            self.leases.record_heartbeat(worker, held[0] if held else None, held, slots)

    def end(self, worker: bytes, n: int, took_s: float) -> None:
        for key in self.held(worker)[:n]:
            self.leases.record_result(*key, took_s)
            self.leases.record_verdict(*key)

    def warm_up(self, campaign: int = 1) -> None:
        """It is known how long an episode takes, and how many each runs; nobody holds any."""
        self.leases.offer(campaign, tasks(MANY, 60))
        while self.lend().total():
            self.beat()
            self.lend()
            for worker, slots in self.slots.items():
                self.end(worker, 256, LONG_S / slots)


@pytest.fixture
def table() -> Table:
    return Table()


def test_all_slots_stay_busy_however_long_an_episode_takes(table: Table) -> None:
    table.join(b"a", SLOTS)
    table.warm_up()
    table.leases.offer(1, tasks(0, MANY))
    for ended in (1, 3, SLOTS, 1, SLOTS):
        table.lend()
        table.beat()
        table.lend()
        assert SLOTS < len(table.held(b"a")) <= 2 * SLOTS
        table.end(b"a", ended, LONG_S / SLOTS)
    assert len(table.held(b"a")) <= 2 * SLOTS


def test_one_that_joins_late_fills_its_slots_with_long_ones_after_a_heartbeat(table: Table) -> None:
    table.join(b"a", SLOTS)
    table.warm_up()
    table.join(b"b", SLOTS)
    table.leases.offer(1, tasks(0, MANY))
    assert table.lend()[b"b"] == 1
    table.beat()
    table.lend()
    assert len(table.held(b"b")) > SLOTS


def test_the_last_ones_are_spread_over_all_slots(table: Table) -> None:
    for worker in (b"a", b"b"):
        table.join(worker, SLOTS)
    table.warm_up()
    table.leases.offer(1, tasks(0, 12))
    table.lend()
    table.beat()
    table.lend()
    assert sorted(len(table.held(worker)) for worker in (b"a", b"b")) == [6, 6]


def test_slots_are_those_of_the_campaign_that_runs_in_them(table: Table) -> None:
    table.join(b"a", SLOTS)
    table.warm_up(campaign=1)
    table.slots[b"a"] = 1
    table.warm_up(campaign=2)
    table.leases.offer(2, tasks(0, MANY))
    table.lend()
    table.beat()
    assert len(table.held(b"a")) == 1
    table.leases.remove_campaign(2)
    table.leases.offer(1, tasks(0, MANY))
    assert table.lend()[b"a"] == SLOTS
    table.leases.remove_campaign(1)
    table.leases.sessions[b"a"].forget_campaign(1)  # as it is told to drop a campaign
    assert table.leases.sessions[b"a"].slots(1) == 1


def test_two_campaigns_take_turns_by_the_slotful_and_share_alike(table: Table) -> None:
    table.join(b"a", SLOTS)
    for campaign in (1, 2):
        table.warm_up(campaign)
    for campaign in (1, 2):
        table.leases.offer(campaign, tasks(0, MANY))
    ended = Counter[int]()
    for _ in range(100):
        table.lend()
        table.beat()
        table.lend()
        held = table.held(b"a")
        assert len(held) > SLOTS
        runs = [key for key in held if key[0] == held[0][0]][:SLOTS]
        assert len(runs) == SLOTS
        ended.update(campaign for campaign, _ in runs)
        table.end(b"a", SLOTS, LONG_S / SLOTS)
    assert ended[1] == pytest.approx(ended[2], abs=2 * SLOTS)


def test_what_needs_a_bridge_goes_to_who_has_one_and_holds_nobody_up(table: Table) -> None:
    table.leases.require_bridge(1)
    table.join(b"without", bridge=False)
    assert table.leases.has_bridge() is False
    for campaign in (1, 2):
        table.leases.offer(campaign, tasks(0, 100))
    table.lend()
    assert {campaign for campaign, _ in table.held(b"without")} == {2}
    assert table.leases.list_unrunnable() == {1}
    table.join(b"with")
    assert table.leases.has_bridge() is True
    assert not table.leases.list_unrunnable()
    for _ in range(20):
        table.lend()
        for worker in (b"with", b"without"):
            assert table.held(worker)
            table.end(worker, 1, LONG_S)
    table.leases.remove_campaign(2)
    table.lend()
    assert {campaign for campaign, _ in table.held(b"with")} == {1}
    assert table.held(b"without") == []
    assert table.lend() == Counter()


@pytest.mark.parametrize("others", [0, 10])
def test_campaigns_on_bridges_share_those_whatever_goes_on_elsewhere(
    table: Table, others: int
) -> None:
    for campaign in (1, 2):
        table.leases.require_bridge(campaign)
    for campaign in (1, 2, 3):
        table.leases.offer(campaign, tasks(0, MANY))
    table.join(b"with")
    workers = [b"%d" % n for n in range(others)]
    for worker in workers:
        table.join(worker, bridge=False)
    ended = Counter[int]()
    for _ in range(300):
        table.lend()
        ended[table.held(b"with")[0][0]] += 1
        for worker in (b"with", *workers):
            table.end(worker, 1, 1.0)
    for campaign in (1, 2, 3):
        assert ended[campaign] == pytest.approx(100, abs=25)
