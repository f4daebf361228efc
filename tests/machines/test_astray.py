"""What the machines and the bent messages found, each held fast by itself."""

import msgspec
import pytest
from benchmarks.faults.fake_services import LAYER, fake_learners, quiet
from benchmarks.faults.fake_worker import FakeWorker
from hub_room import Room, leased

from eigenfail.errors import ProtocolError
from eigenfail.testing.examples import result, spec
from eigenfail.values.episode import EpisodeTask, PolicySource, PriorSource
from eigenfail.values.learning import MOST_POLICIES, Policy
from eigenfail.wire.messages import (
    PROTOCOL,
    Heartbeat,
    Hello,
    Lease,
    Message,
    PolicyUpdate,
    Results,
    Setup,
    Welcome,
    encode,
    read_hub_message,
    read_worker_message,
)
from eigenfail_services.hub.commits import MAX_DEATHS
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.worker_table import MAX_UNNAMED_HEARTBEATS

SETUP = spec().setup()
TASK = EpisodeTask(0, 100, PriorSource())


@pytest.fixture
def learners():
    with quiet(), fake_learners() as learners:
        yield learners


@pytest.fixture
def room(monkeypatch: pytest.MonkeyPatch, learners) -> Room:
    return Room(monkeypatch, episodes=3)


def hello(credit: int = 8) -> Hello:
    return Hello(PROTOCOL, "w", credit)


@pytest.mark.fault(
    "lease, setup or policy lost on the way",
    group="messages",
    outcome="It is sent again, or the worker asks for it with a new hello.",
)
def test_a_lease_that_went_astray_is_given_again(room: Room) -> None:
    room.say()
    assert sorted(leased(room.say(hello()))) == [0, 1, 2]
    for _ in range(2):
        for _ in range(MAX_UNNAMED_HEARTBEATS - 1):
            assert leased(room.say(Heartbeat())) == []
        assert sorted(leased(room.say(Heartbeat()))) == [0, 1, 2]


@pytest.mark.fault("lease, setup or policy lost on the way")
def test_one_of_which_the_worker_names_all_did_not(room: Room) -> None:
    room.say()
    room.say(hello())
    beat = Heartbeat(room.campaign, 0, tuple((room.campaign, index) for index in range(3)))
    for _ in range(3 * MAX_UNNAMED_HEARTBEATS):
        assert leased(room.say(beat)) == []


@pytest.mark.fault("lease, setup or policy lost on the way")
def test_what_a_busy_worker_does_not_name_is_given_again(room: Room) -> None:
    room.say()
    room.say(hello())
    beat = Heartbeat(room.campaign, 0, ((room.campaign, 0), (room.campaign, 2)))
    for _ in range(MAX_UNNAMED_HEARTBEATS - 1):
        assert leased(room.say(beat)) == []
    assert leased(room.say(beat)) == [1]


def test_who_says_hello_again_has_not_died_of_its_episode(room: Room) -> None:
    room.say()
    room.say(hello())
    for _ in range(MAX_DEATHS + 1):
        said = room.say(Heartbeat(room.campaign, 0), hello())
        assert 0 in leased(said)
    assert room.store.campaigns.get(room.campaign).counts.errored == 0
    assert room.store.episodes.add_death(room.campaign, 0) == 1


@pytest.mark.fault("result that arrives twice, late, unasked or for another campaign")
def test_a_result_brought_before_its_round_is_proposed_is_not_run_again(
    room: Room, learners
) -> None:
    room.say(hello())
    room.say(hello(), by=b"other")
    learners[-1].status = -9  # its next life proposes what the first one did
    room.now_s -= 0.99  # so that the commit is still to come when it does
    room.say(Results(room.campaign, (result(0),)))
    again = [*leased(room.say()), *leased(room.say(by=b"other"))]
    assert 0 not in again
    assert room.store.episodes.finished(room.campaign, [0])


def test_a_worker_without_credit_is_given_nothing() -> None:
    leases = Leases()
    leases.open_session(b"w", hello(credit=0), 0.0)
    leases.offer(1, (TASK,))
    assert leases.assign() == []


@pytest.mark.fault(
    "arrays of another shape, or with invalid numbers",
    group="messages",
    outcome="They are refused before they are stored.",
)
@pytest.mark.parametrize("z", [[[0.0, 1.0]], [["1.0", "2.0"]], [[1e300, 0.0]], [None]])
def test_arrays_travel_packed_and_never_as_lists(z: list) -> None:
    told = msgspec.msgpack.decode(encode(Results(1, (result(0),))))
    told["results"][0]["noise"]["z"] = z
    with pytest.raises(ProtocolError):
        read_worker_message(msgspec.msgpack.encode(told))


@pytest.mark.parametrize("seconds", [float("nan"), float("inf"), 0.0, -1.0])
def test_a_heartbeat_that_is_no_time_is_no_welcome(seconds: float) -> None:
    with pytest.raises(ProtocolError):
        read_hub_message(encode(Welcome(seconds)))


def said_by(worker: FakeWorker, *messages: Message) -> list[type]:
    """What a worker says when it hears these and its time to speak has come."""
    worker.dealer.outbox.clear()
    worker.dealer.inbox.extend(map(encode, messages))
    worker._next_beat_s = 0.0
    worker.turn()
    worker.work()
    worker.turn()
    return [type(read_worker_message(data)) for data in worker.dealer.outbox]


@pytest.fixture
def worker():
    with quiet():
        worker = FakeWorker()
        worker.turn()
        yield worker


@pytest.mark.fault("lease, setup or policy lost on the way")
def test_a_worker_whose_setup_went_astray_says_hello_again(worker: FakeWorker) -> None:
    assert said_by(worker, Welcome(1.0), Lease(1, (TASK,))) == [Hello]
    assert Results in said_by(worker, Welcome(1.0), Setup(1, SETUP), Lease(1, (TASK,)))


@pytest.mark.fault("lease, setup or policy lost on the way")
def test_so_does_one_whose_policy_did(worker: FakeWorker) -> None:
    lease = Lease(1, (EpisodeTask(0, 100, PolicySource(2)),))
    update = PolicyUpdate(1, Policy(2, (), LAYER, LAYER, 3.0, 1))
    assert said_by(worker, Welcome(1.0), Setup(1, SETUP), lease) == [Hello]
    assert Results in said_by(worker, Welcome(1.0), update, lease)


@pytest.mark.fault(
    "unknown policy version",
    group="messages",
    outcome="The worker says hello again and is sent the policy; an engine without it errors "
    "that episode alone.",
)
def test_policies_of_the_future_do_not_end_a_worker(worker: FakeWorker) -> None:
    later = (Policy(10**6 + n, (), LAYER, LAYER, 3.0, 1) for n in range(MOST_POLICIES))
    lease = Lease(1, (EpisodeTask(0, 100, PolicySource(2)),))
    now = PolicyUpdate(1, Policy(2, (), LAYER, LAYER, 3.0, 1))
    said_by(worker, Welcome(1.0), Setup(1, SETUP), now, lease, *(PolicyUpdate(1, p) for p in later))
    assert said_by(worker) == [Hello]
