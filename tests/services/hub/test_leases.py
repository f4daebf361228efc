"""The leases against a simple model: nothing lost, nothing held twice."""

from math import inf, nan

import msgspec
import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule
from lives import lives

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, PolicySource, PriorSource
from eigenfail.wire.messages import FINISHED, PROTOCOL, Hello, Holding, fingerprint_task
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.worker_table import MAX_UNNAMED_HEARTBEATS

WORKERS = st.sampled_from([b"a", b"b", b"c"])
CAMPAIGNS = st.sampled_from([1, 2])
SETUP = CampaignSpec(name="t", method="monte_carlo", episodes=9).setup()

Key = tuple[int, int]


def tasks(*indices: int) -> tuple[EpisodeTask, ...]:
    return tuple(EpisodeTask(index, index, PriorSource()) for index in indices)


def of_ours(_campaign: int, task: EpisodeTask) -> bytes:
    return fingerprint_task(SETUP, task)


def claim(campaign: int, index: int, *, right: bool = True) -> Holding:
    return Holding(campaign, index, of_ours(campaign, tasks(index + (not right))[0]))


def hello(worker: bytes = b"w", credit: int = 256, holdings: tuple[Holding, ...] = ()) -> Hello:
    return Hello(PROTOCOL, worker.decode(), credit, holdings=holdings)


class LeaseModel(RuleBasedStateMachine):
    """Any order of events; the model knows what is open, who was given what, and who holds it."""

    def __init__(self) -> None:
        super().__init__()
        self.leases = Leases()
        self.open: set[Key] = set()
        self.given: dict[bytes, set[Key]] = {}
        self.holdings: dict[bytes, dict[Key, bool]] = {}
        self.running: dict[bytes, Key] = {}
        self.suspected: set[Key] = set()
        self.next_index = 0

    def gone(self, worker: bytes) -> None:
        self.given.pop(worker, None)
        self.holdings.pop(worker, None)
        self.running.pop(worker, None)

    def ended(self, keys: set[Key]) -> None:
        self.open -= keys
        self.suspected -= keys
        for held in self.given.values():
            held.difference_update(keys)
        for holdings in self.holdings.values():
            for key in keys:
                holdings.pop(key, None)

    @rule(
        worker=WORKERS,
        credit=st.integers(1, 40),
        holdings=st.dictionaries(
            st.tuples(CAMPAIGNS, st.integers(0, 60)), st.booleans(), max_size=20
        ),
    )
    def join(self, worker: bytes, credit: int, holdings: dict[Key, bool]) -> None:
        told = tuple(claim(*key, right=right) for key, right in holdings.items())
        self.leases.open_session(worker, hello(worker, credit, told), 0.0)
        self.given[worker], self.holdings[worker] = set(), dict(holdings)
        self.running.pop(worker, None)

    @rule(worker=WORKERS)
    def leave(self, worker: bytes) -> None:
        self.leases.end_session(worker)
        self.gone(worker)

    @rule(worker=WORKERS, data=st.data())
    def beat(self, worker: bytes, data: st.DataObject) -> None:
        if held := self.given.get(worker):
            self.running[worker] = data.draw(st.sampled_from(sorted(held)))
            self.leases.record_heartbeat(
                worker, self.running[worker], held | set(self.holdings[worker])
            )

    @rule(worker=WORKERS)
    def lose(self, worker: bytes) -> None:
        """Its last heartbeat may be of an episode whose result has come since."""
        if worker not in self.given:
            return
        if (running := self.running.get(worker)) in self.given[worker]:
            self.suspected.add(running)
        self.leases.end_lost_session(worker)
        self.gone(worker)

    @rule()
    def clear_interrupted(self) -> None:
        assert {(c, task.index) for c, task in self.leases.list_interrupted()} == self.suspected
        for key in self.suspected:
            self.leases.clear_interrupted(*key)
        self.suspected.clear()

    @rule(worker=WORKERS, share=st.integers(1, 3))
    def name_only_some(self, worker: bytes, share: int) -> None:
        """For so long that it cannot be but that it does not hold the others."""
        if worker not in self.given:
            return
        named = {key for key in self.given[worker] | set(self.holdings[worker]) if key[1] % share}
        for _ in range(MAX_UNNAMED_HEARTBEATS):
            assert set(self.leases.sessions[worker].held) == self.given[worker]
            self.leases.record_heartbeat(worker, None, named)
        self.running.pop(worker, None)
        self.given[worker] &= named
        self.holdings[worker] = {
            k: right for k, right in self.holdings[worker].items() if k in named
        }

    @rule(campaign=CAMPAIGNS, n=st.integers(1, 30), at_once=st.booleans())
    def offer(self, campaign: int, n: int, at_once: bool) -> None:
        indices = range(self.next_index, self.next_index + n)
        self.next_index += n
        self.leases.offer(campaign, tasks(*indices))
        self.open |= {(campaign, index) for index in indices}
        if at_once:
            self.assign()

    @rule(campaign=CAMPAIGNS, weight=st.integers(1, 9))
    def weigh(self, campaign: int, weight: int) -> None:
        self.leases.set_weight(campaign, weight)

    @rule(campaign=CAMPAIGNS)
    def withdraw(self, campaign: int) -> None:
        self.leases.remove_campaign(campaign)
        self.ended({key for key in self.open if key[0] == campaign})
        for holdings in self.holdings.values():
            for key in [key for key in holdings if key[0] == campaign]:
                del holdings[key]

    @rule(campaign=CAMPAIGNS, worker=WORKERS)
    def lose_the_learner(self, campaign: int, worker: bytes) -> None:
        """The next one proposes all that is open again; meanwhile somebody leaves."""
        self.leases.unqueue_campaign(campaign)
        self.leave(worker)
        self.leases.offer(campaign, tasks(*(i for of, i in sorted(self.open) if of == campaign)))

    @rule(data=st.data(), wall_s=st.floats(0.001, 10.0))
    def bring(self, data: st.DataObject, wall_s: float) -> None:
        if self.open:
            self.accept(data.draw(st.sampled_from(sorted(self.open))), wall_s)

    @rule(worker=WORKERS)
    def bring_what_runs(self, worker: bytes) -> None:
        if (key := self.running.get(worker)) in self.open:
            self.accept(key, 0.01)

    def accept(self, key: Key, wall_s: float) -> None:
        self.leases.record_result(*key, wall_s)
        self.leases.offer(key[0], tasks(key[1]))  # brought, so that nobody needs to run it
        self.leases.record_verdict(*key)
        self.ended({key})

    @rule()
    def assign(self) -> None:
        self.adopt()
        for assignment in self.leases.assign():
            for task in assignment.tasks:
                key = (assignment.campaign, task.index)
                assert key in self.open - self.suspected
                assert all(key not in held for held in self.given.values())
                assert not any(holdings.get(key) for holdings in self.holdings.values())
                self.given[assignment.worker].add(key)

    def adopt(self) -> None:
        refused = self.leases.lease_held_episodes(of_ours)
        for worker, seat in self.leases.sessions.items():
            for key in set(seat.held) - self.given[worker]:
                assert self.holdings[worker].pop(key)
                assert key in self.open - self.suspected
                self.given[worker].add(key)
        for worker, campaign in refused:
            wrong = {key for key, right in self.holdings[worker].items() if not right}
            assert {key for key in wrong if key[0] == campaign} & self.open

    @invariant()
    def seats_hold_what_they_were_given(self) -> None:
        assert {w: set(seat.held) for w, seat in self.leases.sessions.items()} == self.given

    @invariant()
    def what_is_counted_as_it_comes_is_what_there_is(self) -> None:
        held = {key for keys in self.given.values() for key in keys}
        for campaign in (1, 2):
            assert self.leases.has_leases(campaign) == any(key[0] == campaign for key in held)
        for seat in self.leases.sessions.values():
            assert seat.load_s == pytest.approx(sum(seat._work_s.values()))
            assert seat._work_s.keys() == seat.held.keys()

    def teardown(self) -> None:
        """Whatever is open is run in the end, once, by a worker that brings all it gets."""
        self.clear_interrupted()
        for worker in list(self.given):
            self.leases.end_session(worker)
        self.leases.open_session(b"last", hello(b"last", 1_000), 0.0)
        while assignments := self.leases.assign():
            for assignment in assignments:
                for task in assignment.tasks:
                    self.open.remove((assignment.campaign, task.index))
                    self.leases.record_result(assignment.campaign, task.index, 0.01)
        assert not self.open


LeaseModel.TestCase.settings = lives(100, 40)
TestLeaseModel = LeaseModel.TestCase


def seated(*workers: bytes) -> Leases:
    leases = Leases()
    for worker in workers:
        leases.open_session(worker, hello(worker), 0.0)
    return leases


@pytest.mark.fault("worker ten times slower than the others")
@pytest.mark.parametrize(("takes_s", "held"), [(0.01, 200), (0.2, 10), (0.4, 5), (0.5, 1), (9, 1)])
def test_the_longer_episodes_take_the_fewer_are_leased_at_once(takes_s: float, held: int) -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(*range(1000)))
    leases.complete(1, 0, wall_s=takes_s)
    leases.assign()
    assert len(leases.sessions[b"a"].held) == held


def test_episodes_of_a_lost_worker_come_first_and_in_order() -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(*range(6)))
    first = [task.index for a in leases.assign() for task in a.tasks]
    leases.end_session(b"a")
    leases.offer(1, tasks(6))
    leases.open_session(b"b", hello(b"b"), 0.0)
    again = [task.index for a in leases.assign() for task in a.tasks]
    assert again == [*first, 6]


@pytest.mark.fault(
    "worker killed between its result and its next heartbeat",
    group="processes",
    outcome="No episode is suspected, and what it had not begun is leased to others.",
)
def test_a_worker_that_is_lost_between_its_result_and_its_next_beat_is_not_blamed() -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(0, 1))
    leases.assign()
    leases.record_heartbeat(b"a", (1, 0), {(1, 0), (1, 1)})
    leases.record_result(1, 0, 0.01)
    leases.end_lost_session(b"a")
    assert leases.list_interrupted() == []
    leases.open_session(b"b", hello(b"b"), 0.0)
    assert [task.index for a in leases.assign() for task in a.tasks] == [1]


def adopted(*holdings: Holding) -> Leases:
    """A worker that said this, before three episodes were offered, and another one."""
    leases = Leases()
    leases.open_session(b"a", hello(b"a", holdings=holdings), 0.0)
    leases.open_session(b"b", hello(b"b"), 0.0)
    leases.offer(1, tasks(0, 1, 2))
    return leases


def test_what_a_worker_holds_is_left_with_it() -> None:
    leases = adopted(claim(1, 0), Holding(1, 1, FINISHED), claim(1, 77), claim(5, 0))
    assert leases.lease_held_episodes(of_ours) == set()
    assert set(leases.sessions[b"a"].held) == {(1, 0), (1, 1)}
    assert [task.index for a in leases.assign() for task in a.tasks] == [2]


def test_what_a_worker_names_no_longer_is_leased_to_any() -> None:
    leases = Leases()
    leases.open_session(b"a", hello(b"a", holdings=(claim(1, 0),)), 0.0)
    for _ in range(MAX_UNNAMED_HEARTBEATS):
        leases.record_heartbeat(b"a", None, set())
    leases.offer(1, tasks(0))
    assert leases.lease_held_episodes(of_ours) == set()
    assert not leases.sessions[b"a"].held


def test_of_two_that_hold_the_same_the_second_has_it_when_the_first_is_gone() -> None:
    leases = Leases()
    for worker in (b"a", b"b"):
        leases.open_session(worker, hello(worker, holdings=(claim(1, 0),)), 0.0)
    leases.offer(1, tasks(0))
    leases.lease_held_episodes(of_ours)
    assert set(leases.sessions[b"a"].held) == {(1, 0)}
    leases.end_session(b"a")
    leases.lease_held_episodes(of_ours)
    assert set(leases.sessions[b"b"].held) == {(1, 0)}


@pytest.mark.fault("worker connection cut")
def test_a_worker_that_comes_by_another_connection_takes_its_episodes_along() -> None:
    leases = Leases()
    first = Hello(PROTOCOL, "w", 256, life="one")
    leases.open_session(b"a", first, 0.0)
    leases.offer(1, tasks(0))
    leases.assign()
    leases.record_heartbeat(b"a", (1, 0), {(1, 0)})
    leases.open_session(b"b", msgspec.structs.replace(first, holdings=(claim(1, 0),)), 0.0)
    leases.lease_held_episodes(of_ours)
    assert {w: set(seat.held) for w, seat in leases.sessions.items()} == {b"b": {(1, 0)}}
    assert leases.list_interrupted() == []


@pytest.mark.fault("SIGKILL of a learner")
def test_a_learner_that_is_lost_costs_no_lease() -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(0, 1))
    leases.assign()
    leases.unqueue_campaign(1)
    leases.offer(1, tasks(0, 1, 2))
    assert [task.index for a in leases.assign() for task in a.tasks] == [2]


def test_but_what_it_then_asks_for_is_another_task_that_is_leased_anew() -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(0))
    leases.assign()
    leases.unqueue_campaign(1)
    leases.offer(1, (EpisodeTask(0, 0, PolicySource(3)),))
    (task,) = (task for a in leases.assign() for task in a.tasks)
    assert task.source == PolicySource(3)


def test_a_learner_that_goes_further_back_leases_nothing_of_what_comes_later() -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(0, 1))
    leases.assign()
    leases.unqueue_campaign(1)
    leases.offer(1, tasks(0))  # of the round before: 1 is proposed again once that is whole
    leases.end_session(b"a")
    leases.open_session(b"b", hello(b"b"), 0.0)
    assert [task.index for a in leases.assign() for task in a.tasks] == [0]
    leases.offer(1, tasks(1))
    leases.end_session(b"b")
    leases.open_session(b"c", hello(b"c"), 0.0)
    assert [task.index for a in leases.assign() for task in a.tasks] == [0, 1]


@pytest.mark.fault("result that arrives twice, late, unasked or for another campaign")
def test_a_late_result_of_a_waiting_episode_saves_the_work() -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(0))
    leases.assign()
    leases.end_session(b"a")
    leases.record_result(1, 0, 0.1)
    leases.open_session(b"b", hello(b"b"), 0.0)
    assert leases.assign() == []


def test_campaigns_share_the_workers() -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(*range(100)))
    leases.offer(2, tasks(*range(100, 200)))
    leases.assign()
    held = [campaign for campaign, _ in leases.sessions[b"a"].held]
    assert abs(held.count(1) - held.count(2)) <= len(held) // 2
    assert min(held.count(1), held.count(2)) >= 2


@pytest.mark.parametrize("wall_s", [nan, inf, -inf, -1.0, 0.0])
def test_a_time_that_is_none_changes_no_pace(wall_s: float) -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(*range(1000)))
    leases.complete(1, 0, wall_s=0.4)
    leases.complete(1, 1, wall_s)
    leases.assign()
    assert len(leases.sessions[b"a"].held) == 5
