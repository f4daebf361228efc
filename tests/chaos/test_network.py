"""Bad lines between workers and the hub: the same episodes as over a good one, bit for bit.

Beats and the limit of silence are ten and five times shorter than in use, so that faults that last
longer than the limit take seconds.
"""

import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import deadlines
import numpy as np
import pytest
import reader
from forwarder import Carriage, Forwarder
from inprocess import PATIENCE_S, Service, worker_at
from msgspec.structs import replace
from proxy import Line, Proxy, Way

from eigenfail.values.episode import (
    EpisodeFault,
    EpisodeResult,
    EpisodeTask,
    PriorSource,
    unrunnable,
)
from eigenfail.values.scene import Scene
from eigenfail.wire.messages import (
    MAX_FRAME_BYTES,
    PROTOCOL,
    Ack,
    Goodbye,
    Heartbeat,
    Hello,
    HubMessage,
    Refusal,
    Results,
)
from eigenfail_services.hub import worker_sessions
from eigenfail_services.hub.keys import HubKeys, KeyFolder
from eigenfail_workers.worker.hub_connection import HubConnection

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]

SEED = 20261122
WORKERS = 2
CREW = [f"w{number}" for number in range(WORKERS)]
BEAT_S = 0.1
LIMIT_S = 2.0
AST = {
    "method": "ast",
    "planner": "idm",
    "simulator": "point_mass",
    "episodes": 24,
    "settings": {"round_size": 6, "gradient_steps": 1},
}

LINES = {
    "cut": Line(cut=0.02),
    "mute": Line(mute=0.05, mute_s=LIMIT_S / 4),
    "slow": Line(delay_s=0.01, bytes_per_s=200_000),
}
BEFALLS = {"cut": {"cut"}, "mute": {"mute"}, "slow": set()}
"""What must have happened by then, or the test shows nothing."""

CARRIAGES = (
    Carriage(lost=0.02, doubled=0.02, late=0.02, late_s=0.5),
    Carriage(lost=0.2, doubled=0.2, late=0.2, late_s=0.5),
)
KINDS = len(("lost", "doubled", "late"))


@pytest.fixture(scope="module")
def quick() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(worker_sessions, "HEARTBEAT_S", BEAT_S)
        patch.setattr(worker_sessions, "SILENCE_LIMIT_S", LIMIT_S)
        yield


@pytest.fixture(scope="module")
def service(quick: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with closing(Service(tmp_path_factory.mktemp("service"))) as running:
        yield running


@pytest.fixture(scope="module")
def calm(service: Service) -> str:
    """The digest of the campaign that nothing disturbs."""
    with worker_at(service.hub.address, "calm"):
        return service.run(**AST)


@pytest.fixture(scope="module")
def crew_line(service: Service, calm: str) -> Iterator[Proxy]:
    """The line of two workers, which are the same in all tests that change nothing but the line."""
    with closing(Proxy(service.hub.address, SEED)) as line, ExitStack() as stack:
        for name in CREW:
            stack.enter_context(worker_at(line.address, name))
        yield line


def await_crew(service: Service) -> None:
    """Wait until the crew is in, and nobody else.

    A line that is severed while the crew is on its way in leaves hellos that the hub has yet to
    read: members who are gone would come in later.
    """
    service.until(lambda: sorted(service.hub.workers()) == CREW, "the crew is not alone")


@pytest.fixture
def proxy(service: Service, crew_line: Proxy) -> Iterator[Proxy]:
    """The line of the crew, which is good to begin with; all is well in the end."""
    await_crew(service)
    crew_line.befell.clear()
    yield crew_line
    crew_line.line = Line()
    assert reader.read(service.url).complaints == ()


@pytest.fixture
def alone(service: Service, crew_line: Proxy) -> Iterator[None]:
    """Keeps the crew out, so that the test's own workers do all that is done."""
    await_crew(service)
    with crew_line.severed():
        service.crew(0)
        yield
    assert reader.read(service.url).complaints == ()


@pytest.mark.fault("worker connection cut")
@pytest.mark.fault(
    "worker connection slow or delayed",
    group="messages",
    outcome="The worker stays connected; the campaign keeps its digest.",
)
@pytest.mark.parametrize("kind", LINES)
def test_a_bad_line_changes_no_episode(service, calm, proxy, kind) -> None:
    proxy.line = LINES[kind]
    campaign = service.begin(**AST)
    service.until(lambda: BEFALLS[kind] <= set(+proxy.befell), "the line is too good")
    assert service.finish(campaign) == calm


@pytest.mark.fault(
    "worker connection silent in one direction",
    group="messages",
    outcome="The same as an unavailable connection; the campaign keeps its digest.",
)
@pytest.mark.parametrize("way", Way)
def test_one_direction_may_be_silent_for_longer_than_the_limit(service, calm, proxy, way) -> None:
    campaign = begun(service)
    with proxy.muted(way):
        service.crew(0)
    assert service.finish(campaign) == calm


def begun(service: Service) -> int:
    """A campaign with results, and others to come."""
    campaign = service.begin(**AST)
    service.until(lambda: service.get(campaign).counts.completed > 0, "nothing is brought")
    return campaign


@pytest.mark.fault(
    "worker connection unavailable",
    group="messages",
    outcome="After 10 s its episodes go to others; the worker returns when the connection "
    "does, and brings its results.",
)
def test_a_line_that_is_gone_for_longer_than_the_limit(service, calm, proxy) -> None:
    campaign = begun(service)
    with proxy.severed():
        service.crew(0)
    assert service.finish(campaign) == calm


@pytest.fixture
def forwarder(service: Service) -> Iterator[Forwarder]:
    with closing(Forwarder(service.hub.address, SEED)) as carrier:
        yield carrier


@pytest.mark.fault(
    "messages lost, duplicated, delayed or reordered",
    group="messages",
    outcome="They are sent or leased again; one in five of each kind changes no episode.",
)
def test_lost_doubled_and_late_messages_change_no_episode(service, calm, alone, forwarder) -> None:
    with ExitStack() as stack:
        for number in range(WORKERS):
            stack.enter_context(worker_at(forwarder.address, f"f{number}"))
        service.crew(WORKERS)
        for carriage in CARRIAGES:
            forwarder.befell.clear()
            forwarder.carriage = carriage
            campaign = service.begin(**AST)
            service.until(lambda: len(+forwarder.befell) == KINDS, "the carrier is too good")
            assert service.finish(campaign) == calm
        forwarder.carriage = Carriage()


@pytest.mark.fault(
    "two workers with one name",
    group="messages",
    outcome="Both work: the hub tells workers apart by process and connection.",
)
def test_two_workers_with_one_name_both_work(service, calm, alone) -> None:
    with worker_at(service.hub.address, "same"), worker_at(service.hub.address, "same"):
        service.crew(2)
        assert service.hub.workers() == ["same", "same"]
        assert service.run(**AST) == calm


@pytest.mark.fault(
    "dead worker connection that stays open",
    group="messages",
    outcome="After 20 unanswered heartbeats the worker connects again, as behind a firewall "
    "that dropped the connection from its table.",
)
def test_a_line_that_is_dead_and_does_not_end_is_made_anew(service, calm, proxy) -> None:
    campaign = begun(service)
    proxy.lose()
    assert service.finish(campaign) == calm


@pytest.mark.fault(
    "bytes altered in transit",
    group="messages",
    outcome="With [keys](security.md#keys-of-workers) they are detected, and the connection "
    "is made again. Without keys only TCP's checksum protects, and an altered number "
    "may be stored.",
)
def test_bent_bytes_behind_a_key_cost_a_connection_and_nothing_else(quick, calm, tmp_path) -> None:
    folder, file = KeyFolder(tmp_path / "keys"), tmp_path / "worker.key"
    folder.create("w", file)
    with ExitStack() as stack:
        service = stack.enter_context(closing(Service(tmp_path, HubKeys(folder))))
        proxy = stack.enter_context(closing(Proxy(service.hub.address, SEED)))
        for name in ("w0", "w1"):
            stack.enter_context(worker_at(proxy.address, name, "--key-file", str(file)))
        service.crew(WORKERS)
        proxy.line = Line(bent=0.02)
        campaign = service.begin(**AST)
        service.until(lambda: proxy.befell["bent"] > 2, "the line is too good")
        proxy.line = Line()
        assert service.finish(campaign) == calm
        assert reader.read(service.url).complaints == ()


GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x01NULL" + bytes(48)
READY = b"\x04\x1b\x05READY\x0bSocket-Type\x00\x00\x00\x06DEALER"
"""How a ZeroMQ peer without a key begins (ZMTP 3.1)."""

LARGEST = MAX_FRAME_BYTES.to_bytes(8)
TOO_LARGE = (MAX_FRAME_BYTES + 1).to_bytes(8)
LONG_FRAME = b"\x02"

KNOCKS = 1_000
MORE_HANDLES = 20
"""What the database and a learner may open meanwhile."""


def knock(service: Service, *said: bytes) -> socket.socket:
    """A connection to the hub that says something to it, in plain bytes."""
    port = int(service.hub.address.rsplit(":", 1)[1])
    peer = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
    peer.sendall(b"".join(said))
    return peer


def is_closed(peer: socket.socket) -> bool:
    """Whether the other side ends the connection, whatever it says before."""
    try:
        while peer.recv(1024):
            pass
    except ConnectionError:
        pass
    return True


@pytest.mark.fault(
    "message above the size limit",
    group="messages",
    outcome="ZeroMQ closes its connection, and no other.",
)
def test_a_frame_that_is_too_large_costs_its_connection_alone(service, calm, proxy) -> None:
    campaign = begun(service)
    with (
        knock(service, GREETING, READY, LONG_FRAME, LARGEST) as allowed,
        knock(service, GREETING, READY, LONG_FRAME, TOO_LARGE) as refused,
    ):
        assert is_closed(refused)
        allowed.sendall(b"x")
    assert service.finish(campaign) == calm
    service.crew(WORKERS)


HALF_SENT = 20
HUGE = (255 * 2**20).to_bytes(8)
MOST_GROWN_BYTES = 64 * 2**20


@pytest.mark.fault(
    "half-sent frames of 255 MB from strangers",
    group="messages",
    outcome="Their connections are closed as the length is named; at most 1 MiB is waited for.",
)
def test_half_sent_frames_take_little_memory(service) -> None:
    before = resident_bytes()
    with ExitStack() as stack:
        for length in (HUGE, LARGEST):
            for _ in range(HALF_SENT):
                peer = knock(service, GREETING, READY, LONG_FRAME, length)
                stack.enter_context(closing(peer))
                with suppress(ConnectionError):
                    peer.sendall(bytes(MAX_FRAME_BYTES - 1))
                if length == HUGE:
                    assert is_closed(peer)
        assert resident_bytes() - before < MOST_GROWN_BYTES
    assert service.hub.is_alive()


def resident_bytes() -> int:
    """Memory of this process, and of the hub in it, that is in use."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


@pytest.mark.fault(
    "thousand connections that open and close",
    group="messages",
    outcome="The hub keeps nothing of them.",
)
def test_a_thousand_who_connect_and_go_leave_nothing_behind(service, calm, proxy) -> None:
    before = handles()
    campaign = begun(service)
    for number in range(KNOCKS):
        knock(service, GREETING[: number % len(GREETING)]).close()
    assert service.finish(campaign) == calm
    service.until(lambda: handles() < before + MORE_HANDLES, "handles are kept")
    service.crew(WORKERS)


def handles() -> int:
    """Files and sockets that this process, and the hub in it, has open."""
    return len(list(Path("/proc/self/fd").iterdir()))


NARROW_BYTES_PER_S = 20_000
"""Twenty times 8 kbit/s, with beats that are ten times shorter: a policy takes 5 s, and a worker
gives up its line after 2 s without a word."""

NARROW_AST = AST | {"episodes": 12, "settings": {"round_size": 6, "hidden": (150, 150)}}
"""Whose policies take 98 kB."""


@pytest.mark.fault(
    "line of 8 kbit/s",
    group="messages",
    outcome="Policies and results arrive in pieces, each a sign of life; same digests.",
)
def test_a_line_that_takes_long_over_one_policy_changes_no_episode(service, proxy) -> None:
    calm = service.run(**NARROW_AST)
    came = len(proxy._connections)
    proxy.line = Line(bytes_per_s=NARROW_BYTES_PER_S)
    assert service.run(**NARROW_AST) == calm
    assert len(proxy._connections) == came, "the line was given up"


@pytest.fixture
def narrow(service: Service) -> Iterator[Proxy]:
    with closing(Proxy(service.hub.address, SEED)) as line:
        yield line


@pytest.mark.fault("line of 8 kbit/s")
def test_a_worker_that_takes_long_to_bring_one_result_is_not_given_up(
    service, alone, narrow
) -> None:
    scene = Scene(0.1, *(np.zeros((n, 2, 4), np.float32) for n in (3_001, 1, 3_000, 3_000)))
    long = replace(brought_by(0), scene=scene)
    link = HubConnection(narrow.address)
    link.send(Hello(PROTOCOL, "narrow", 0, life="narrow"))
    service.crew(1)
    narrow.line = Line(bytes_per_s=NARROW_BYTES_PER_S)
    link.send(Results(10**6, (long,)))
    answers: list[HubMessage] = []

    def is_acknowledged() -> bool:
        link.send(Heartbeat())
        time.sleep(BEAT_S)
        assert service.hub.workers() == ["narrow"]
        answers.extend(link.receive())
        return any(isinstance(each, Ack) and each.indices for each in answers)

    began_s = time.monotonic()
    with closing(link):
        service.until(is_acknowledged, "the result does not arrive")
        link.send(Goodbye())
    assert time.monotonic() - began_s > 2 * LIMIT_S
    assert not any(isinstance(answer, Refusal) for answer in answers)


def brought_by(index: int) -> EpisodeResult:
    return unrunnable(EpisodeTask(index, 0, PriorSource()), EpisodeFault("input", "test"))
