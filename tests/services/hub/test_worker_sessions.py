"""The talk with workers, message by message, without a socket."""

import msgspec
import numpy as np
import pytest
from structlog.testing import capture_logs

from eigenfail.bridges import MAX_OFFER_BYTES, BridgeOffer, OfferedPlanner, OfferedScenario
from eigenfail.values import episode
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.learning import Layer, Policy
from eigenfail.values.records import Verdict
from eigenfail.versions import versions
from eigenfail.wire.messages import (
    LONGEST_LIFE,
    MAX_HOLDINGS,
    PROTOCOL,
    Ack,
    BridgeReport,
    Drop,
    Goodbye,
    Heartbeat,
    Hello,
    Holding,
    Lease,
    PolicyUpdate,
    Refusal,
    Results,
    Setup,
    Welcome,
    encode,
    fingerprint_task,
    split,
)
from eigenfail_services.hub import worker_sessions
from eigenfail_services.hub.commits import CommitQueue
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.worker_sessions import WorkerSessions
from eigenfail_services.hub.worker_table import MAX_UNNAMED_HEARTBEATS

SPEC = CampaignSpec(name="t", method="monte_carlo", episodes=9)
LAYER = Layer(np.zeros((2, 2), np.float32), np.zeros(2, np.float32))


PRIOR = episode.PriorSource()


class Spec(msgspec.Struct):
    campaign: int = 1
    setup: object = SPEC.setup()


class FakeRun:
    spec = Spec()

    def __init__(self, *, resumed: bool = False) -> None:
        self.resumed = resumed

    def find_policy(self, version: int) -> Policy:
        return Policy(version, (), LAYER, LAYER, 3.0, 1)


class Episodes:
    def commit(self, campaign, deliveries, _meanwhile):
        return [Verdict.KEPT for _ in deliveries]


def done(index: int):
    return episode.unrunnable(
        episode.EpisodeTask(index, 0, episode.PriorSource()), episode.EpisodeFault("input", "test")
    )


class Room:
    """Worker sessions, and everything that it sent."""

    def __init__(self) -> None:
        self.sent: list[tuple[bytes, object]] = []
        self.leases = Leases()
        self.commits = CommitQueue(Episodes())  # type: ignore[arg-type]
        self.sessions = WorkerSessions(
            lambda w, m: self.sent.append((w, m)), self.leases, self.commits
        )

    def said_to(self, worker: bytes) -> list[type]:
        kinds = [type(message) for to, message in self.sent if to == worker]
        self.sent.clear()
        return kinds

    def join(self, worker: bytes, protocol: int = PROTOCOL, **more) -> None:
        self.sessions.handle(worker, encode(Hello(protocol, worker.decode(), 64, **more)))

    def offer(self, *indices: int, source: episode.Source = PRIOR, resumed: bool = False) -> None:
        self.leases.offer(1, tuple(episode.EpisodeTask(i, 0, source) for i in indices))
        self.assign(resumed=resumed)

    def assign(self, *, resumed: bool = False) -> None:
        self.sessions.assign({1: FakeRun(resumed=resumed)})  # type: ignore[dict-item]

    def leased_to(self, worker: bytes) -> list[int]:
        leases = [m for to, m in self.sent if to == worker and isinstance(m, Lease)]
        return [task.index for lease in leases for task in lease.tasks]


@pytest.fixture
def room() -> Room:
    return Room()


def test_a_stranger_is_asked_to_say_hello(room: Room) -> None:
    room.sessions.handle(b"x", encode(Heartbeat()))
    assert room.said_to(b"x") == [Refusal]


def test_a_leaving_worker_s_episodes_go_to_another(room: Room) -> None:
    room.join(b"a")
    room.offer(0)
    room.sessions.handle(b"a", encode(Heartbeat(1, 0, ((1, 0),))))
    room.sessions.handle(b"a", encode(Goodbye()))
    room.join(b"b")
    room.assign()
    assert room.said_to(b"b") == [Welcome, Setup, Lease]


OURS = versions()["eigenfail"]
MAJOR, MINOR, PATCH = map(int, OURS.split("."))
NEWER = f"{MAJOR}.{MINOR + 1}.0"


@pytest.mark.fault(
    "worker with another protocol version",
    group="messages",
    outcome="It is refused, and both logs name both versions.",
)
@pytest.mark.parametrize(
    ("protocol", "theirs"),
    [(PROTOCOL + 1, NEWER), (PROTOCOL - 1, "0.0.9"), (PROTOCOL, NEWER), (99, "")],
)
def test_another_release_is_refused_with_both_versions(room: Room, protocol, theirs) -> None:
    with capture_logs() as log:
        for _ in range(2):
            room.join(b"a", protocol, versions={"eigenfail": theirs} if theirs else {})
    assert room.leases.sessions == {}
    refusal = room.sent[0][1]
    assert isinstance(refusal, Refusal)
    of = f" (eigenfail {theirs})" if theirs else ""
    assert refusal.reason == (
        f"The worker speaks protocol {protocol}{of}, the hub speaks {PROTOCOL} (eigenfail {OURS}): "
        "install the same eigenfail on both."
    )
    assert [(line["event"], line["why"]) for line in log] == [("worker refused", refusal.reason)]


@pytest.mark.fault(
    "worker whose processor computes differently",
    group="messages",
    outcome="It is refused, and both logs name both processors: the last bits of its results would"
    " differ, and with them the episodes of a search.",
)
def test_a_processor_that_computes_differently_is_refused_and_named(room: Room) -> None:
    ours = versions()["processor"]
    room.join(b"a", versions={"eigenfail": OURS, "processor": "Chip 3"})
    room.join(b"b", versions={"eigenfail": OURS, "processor": ours})
    (_, refusal), (_, welcome) = room.sent
    assert f'"Chip 3", the hub\'s "{ours}"' in refusal.reason
    assert isinstance(welcome, Welcome)


@pytest.mark.fault("worker with another protocol version")
def test_a_hello_with_words_of_a_later_protocol_is_refused_with_both_versions(room: Room) -> None:
    later = {"type": "Hello", "protocol": PROTOCOL + 1, "worker": 7, "mood": ["good"]}
    room.sessions.handle(b"a", msgspec.msgpack.encode(later | {"versions": {"eigenfail": NEWER}}))
    room.sessions.handle(b"b", msgspec.msgpack.encode(later | {"protocol": PROTOCOL}))
    (_, refused), (_, unreadable) = room.sent
    assert f"protocol {PROTOCOL + 1} (eigenfail {NEWER})" in refused.reason
    assert "Not a message of this protocol" in unreadable.reason


def test_a_correction_more_or_less_is_let_in_and_told(room: Room) -> None:
    other = f"{MAJOR}.{MINOR}.{PATCH + 1}"
    with capture_logs() as log:
        room.join(b"a", versions={"eigenfail": other})
        room.join(b"b", versions={"eigenfail": OURS})
    assert [seat.arrival.versions["eigenfail"] for seat in room.leases.sessions.values()] == [
        other,
        OURS,
    ]
    told = [line for line in log if line["event"] == "worker of another version"]
    assert [(line["worker"], line["worker_has"], line["hub_has"]) for line in told] == [
        ("a", other, OURS)
    ]


def test_setup_and_policy_come_once_before_the_lease(room: Room) -> None:
    room.join(b"a")
    room.said_to(b"a")
    room.offer(0, source=episode.PolicySource(4))
    assert room.said_to(b"a") == [Setup, PolicyUpdate, Lease]
    room.offer(1, source=episode.PolicySource(4))
    room.offer(2)
    assert set(room.said_to(b"a")) == {Lease}


def test_results_are_acknowledged_after_their_commit_alone(room: Room) -> None:
    room.join(b"a")
    room.said_to(b"a")
    room.sessions.handle(b"a", encode(Results(1, (done(0),))))
    assert room.said_to(b"a") == []
    room.sessions.acknowledge(room.commits.flush(now=True))
    assert room.said_to(b"a") == [Ack]


def test_a_worker_is_told_once_of_all_that_was_committed_together(room: Room) -> None:
    for worker in (b"a", b"b"):
        room.join(worker)
    for worker, campaign, index in ((b"a", 1, 0), (b"b", 1, 1), (b"a", 1, 2), (b"a", 2, 0)):
        room.sessions.handle(worker, encode(Results(campaign, (done(index),))))
    del room.sent[:]
    room.sessions.acknowledge(room.commits.flush(now=True))
    assert sorted((to, ack.campaign, ack.indices) for to, ack in room.sent) == [
        (b"a", 1, (0, 2)),
        (b"a", 2, (0,)),
        (b"b", 1, (1,)),
    ]


def offer(parameters: int) -> BridgeOffer:
    """The offer of a bridge whose scenario has some parameters with long names."""
    names = tuple(f"{number:0200}" for number in range(parameters))
    return BridgeOffer("b", "1", (OfferedScenario("s", 0.1, 9, names),), (OfferedPlanner("p"),))


def test_what_a_bridge_offers_is_kept_with_the_session_of_its_worker(room: Room) -> None:
    room.join(b"a", bridge=True)
    session = room.leases.sessions[b"a"]
    assert session.offer is None
    with capture_logs() as logged:
        for said, kept in (
            (offer(3), True),
            (None, False),
            (offer(3), True),
            (offer(2_000), False),
        ):
            for frame in split(BridgeReport(said)):
                room.sessions.handle(b"a", frame)
            assert (session.offer is not None) is kept
    (warned,) = logged
    assert (warned["event"], warned["worker"]) == ("offer of a bridge not kept", "a")
    assert warned["bytes"] > warned["most"] == MAX_OFFER_BYTES
    room.sessions.handle(b"b", encode(BridgeReport(offer(1))))
    assert b"b" not in room.leases.sessions


def test_a_worker_without_a_bridge_reports_no_offer(room: Room) -> None:
    room.join(b"a")
    room.sessions.handle(b"a", encode(BridgeReport(offer(1))))
    assert room.leases.sessions[b"a"].offer is None


NAN = float("nan")
BENT_OFFERS = {
    "text": "everything",
    "number": 7,
    "list": [],
    "empty": {},
    "no scenarios": {"scenarios": None},
    "scenario without steps": {"scenarios": [{"name": "s", "dt_s": 0.1}]},
    "endless scenario": {"scenarios": [{"name": "s", "dt_s": 0.1, "steps": 10_001}]},
    "step of NaN": {"scenarios": [{"name": "s", "dt_s": NAN, "steps": 9}]},
    "parameters with defaults": {
        "scenarios": [{"name": "s", "dt_s": 0.1, "steps": 9, "parameters": {"a": 1}}]
    },
    "nameless planner": {"planners": [{"name": ""}]},
    "long name": {"name": "x" * 201},
    "channels of numbers": {"channels": [1, 2]},
    "signals in a text": {"signals": "gap_m"},
}


@pytest.mark.fault("malformed, nested, lying or foreign messages")
@pytest.mark.parametrize("name", BENT_OFFERS)
def test_a_bent_offer_is_refused_and_the_last_one_stays(room: Room, name: str) -> None:
    room.join(b"a", bridge=True)
    room.sessions.handle(b"a", encode(BridgeReport(offer(3))))
    kept, bent = room.leases.sessions[b"a"].offer, BENT_OFFERS[name]
    said = msgspec.msgpack.decode(encode(BridgeReport(offer(3))))
    whole = said["offer"] | bent if isinstance(bent, dict) and bent else bent
    room.sessions.handle(b"a", msgspec.msgpack.encode(said | {"offer": whole}))
    assert room.leases.sessions[b"a"].offer == kept is not None


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time, in its one place."""
    now_s = [100.0]
    monkeypatch.setattr(worker_sessions.time, "monotonic", lambda: now_s[0])
    return now_s


@pytest.mark.fault("SIGSTOP of the services")
def test_a_hub_that_was_held_up_does_not_take_its_own_silence_for_the_workers(clock) -> None:
    room = Room()
    room.join(b"a")
    room.sessions.expire_silent()
    clock[0] += 4 * worker_sessions.SILENCE_LIMIT_S
    room.sessions.expire_silent()
    assert b"a" in room.leases.sessions


def held(index: int, source: episode.Source = PRIOR) -> Holding:
    """What a worker says that has that task of campaign 1."""
    return Holding(1, index, fingerprint_task(SPEC.setup(), episode.EpisodeTask(index, 0, source)))


def test_what_a_worker_holds_waits_for_its_round_and_stays_with_it(room: Room) -> None:
    room.join(b"a", holdings=(held(0), held(1), Holding(1, 2)))
    room.join(b"b")
    room.assign()
    room.offer(0, 1, 2, 3, 4)
    assert set(room.leases.sessions[b"a"].held) >= {(1, 0), (1, 1), (1, 2)}
    assert sorted([*room.leased_to(b"a"), *room.leased_to(b"b")]) == [3, 4]


def test_it_is_free_again_when_it_is_no_longer_named(room: Room) -> None:
    room.join(b"a", holdings=(held(0), held(1)))
    room.offer(0, 1)
    for _ in range(MAX_UNNAMED_HEARTBEATS):
        room.join(b"b")
        room.assign()
        assert room.leased_to(b"b") == []
        room.sessions.handle(b"a", encode(Heartbeat(1, 0, ((1, 0),))))
    room.sessions.handle(b"b", encode(Goodbye()))
    room.join(b"c")
    room.assign()
    assert room.leased_to(b"a") + room.leased_to(b"c") == [1]


@pytest.mark.fault(
    "worker that holds an episode of another database",
    group="messages",
    outcome="The fingerprint of setup and task differs; the worker drops the campaign, and "
    "its episodes are leased again.",
)
@pytest.mark.parametrize("mine", [held(0, episode.PolicySource(3)), held(1), Holding(1, 0, b"?")])
def test_who_holds_another_task_is_told_to_drop_it_and_sent_all_anew(room: Room, mine) -> None:
    room.join(b"a", holdings=(msgspec.structs.replace(mine, index=0),))
    room.offer(0, source=episode.PolicySource(4))
    assert room.said_to(b"a") == [Welcome, Drop, Setup, PolicyUpdate, Lease]


NONSENSE = (
    {"claims": [{"campaign": 1, "index": 0}] * (MAX_HOLDINGS + 1)},
    {"claims": [{"campaign": -1, "index": 0}]},
    {"claims": [{"campaign": 1, "index": 0.5}]},
    {"claims": [{"campaign": 1, "index": 0, "task": b"long" * 5}]},
    {"claims": [{"campaign": 1, "index": 0, "colour": "red"}]},
    {"claims": [7]},
    {"claims": {"campaign": 1}},
    {"life": "x" * (LONGEST_LIFE + 1)},
)


@pytest.mark.fault("malformed, nested, lying or foreign messages")
@pytest.mark.parametrize("bent", NONSENSE, ids=lambda bent: str(bent)[:60])
def test_claims_that_are_none_are_refused_at_the_border(room: Room, bent: dict) -> None:
    told = msgspec.msgpack.decode(encode(Hello(PROTOCOL, "a", 64)))
    room.sessions.handle(b"a", msgspec.msgpack.encode(told | bent))
    assert room.said_to(b"a") == [Refusal]
    assert room.leases.sessions == {}


def test_a_hello_said_again_before_its_welcome_came_changes_nothing(room: Room) -> None:
    room.join(b"a", life="one")
    room.offer(0, 1)
    room.sent.clear()
    room.join(b"a", life="one")
    room.assign()
    assert room.said_to(b"a") == [Welcome]
    room.join(b"a", life="one", asked=1)
    room.assign()
    assert room.said_to(b"a")[:3] == [Welcome, Setup, Lease]


def test_a_hub_that_has_just_begun_waits_for_those_who_hold_what_goes_on(clock) -> None:
    room = Room()
    room.join(b"a")
    room.offer(0, 1, resumed=True)
    assert room.leased_to(b"a") == []
    clock[0] += worker_sessions.ADOPTION_GRACE_S / 2
    room.join(b"b", holdings=(held(0),))
    room.assign(resumed=True)
    assert room.leased_to(b"a") == []
    clock[0] += worker_sessions.ADOPTION_GRACE_S / 2
    room.assign(resumed=True)
    assert room.leased_to(b"a") == [1]
    assert set(room.leases.sessions[b"b"].held) == {(1, 0)}


def test_a_heartbeat_that_declines_nothing_has_the_bytes_of_earlier_releases() -> None:
    assert b"declined" not in encode(Heartbeat(1, 2, ((1, 2),), 3))


@pytest.mark.fault("campaign with a name that the bridge does not know")
def test_a_declined_campaign_is_noted_once_with_the_worker_and_the_reason(room: Room) -> None:
    room.join(b"a")
    room.offer(0, 1)
    beat = encode(Heartbeat(declined=((1, "'gap' is not known."), (2, "never sent"))))
    for _ in range(2):
        room.sessions.handle(b"a", beat)
    said = "Worker a can run no episode of the campaign: 'gap' is not known."
    assert room.sessions.declined == {1: said}
    # Of campaign 2 it was sent nothing: it is told to forget it, and nobody else hears of that.
    dropped = [m.campaign for _, m in room.sent if isinstance(m, Drop)]
    assert dropped == [2, 2]
    room.sessions.declined.clear()
    room.sessions.drop_campaign(1)
    room.sessions.handle(b"a", beat)
    assert room.sessions.declined == {}
