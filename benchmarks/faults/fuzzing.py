"""Bent messages by the hundred thousand: at the hub, the worker, an engine, and over sockets.

`python -m benchmarks.faults.fuzzing --messages 1000000` says what escaped, and how memory grew.
"""

import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from threading import Thread
from typing import Annotated, NamedTuple

import typer
import zmq
from benchmarks.episode_pool import EpisodePool
from benchmarks.faults import fuzzing_bridge
from benchmarks.faults.fake_services import (
    LAYER,
    FakeSocket,
    context_of,
    fake_hub,
    fake_learners,
    quiet,
)
from benchmarks.faults.fake_worker import FakeWorker
from benchmarks.faults.invalid_messages import FOREIGN, words
from benchmarks.figures import Figure
from benchmarks.truth.undisturbed import number

from eigenfail.bridges import BridgeOffer, OfferedPlanner, OfferedScenario
from eigenfail.testing.examples import collision, floats, make_errored_result, result, spec
from eigenfail.values.episode import (
    EpisodeTask,
    Outcome,
    PolicySource,
    PriorSource,
    TrajectorySource,
)
from eigenfail.values.learning import Policy
from eigenfail.wire import messages as m
from eigenfail.wire.messages import Assembler, Holding, fingerprint_task
from eigenfail_services.campaigns.validation import check_spec
from eigenfail_services.hub.runs import RunSpec
from eigenfail_services.hub.server import Hub
from eigenfail_services.store.store import open_store

SEED = 20261122
MESSAGES = 100_000
OVER_SOCKETS = 3_000
EPISODES = 64
CAMPAIGNS = (1, 2, 3)
CONNECTIONS = tuple(f"c{n}".encode() for n in range(8))
TURN = 50
"""Messages that are waiting when a turn begins."""

SETTLED = 0.3
"""Part of the messages after which memory is expected to be flat."""

PATIENCE_S = 20.0
MOST_TURNS = 2_000

SETUP = spec(episodes=EPISODES).setup()
TASKS = (
    EpisodeTask(0, 100, PriorSource()),
    EpisodeTask(1, 101, PolicySource(1)),
    EpisodeTask(2, 102, TrajectorySource(floats(2, 5, 2))),
)
HOLDINGS = (
    Holding(1, 0, fingerprint_task(SETUP, TASKS[0])),
    Holding(2, 1),
    Holding(9, 99, b"another"),
)
LONG = m.encode(m.Results(2, (collision(1),)))
OFFER = BridgeOffer(
    "b",
    "1",
    (OfferedScenario("road", 0.1, 50, ("gap_m", "wet")),),
    (OfferedPlanner("driver", ("headway_s",)),),
    ("missed", "every.speed"),
    ("gap_m",),
)
WHOLE = m.encode(m.Ack(1, (0, 1)))
TO_HUB: tuple[m.Message, ...] = (
    m.Hello(m.PROTOCOL, "w", 8, "host", 7),
    m.Hello(m.PROTOCOL, "w", 8, "host", 7, "life", 1, HOLDINGS),
    m.Heartbeat(1, 2),
    m.Heartbeat(1, 2, ((1, 2), (2, 0))),
    m.Heartbeat(),
    m.Results(1, (result(0), make_errored_result(2))),
    m.Results(2, (collision(1),)),
    m.BridgeReport(None),
    m.BridgeReport(OFFER),
    m.Goodbye("stopped"),
    m.Piece(1, 0, len(LONG), LONG[:40]),
    m.Piece(1, 40, len(LONG), LONG[40:]),
    m.Piece(2, 0, 2**26, LONG),
)
TO_WORKER: tuple[m.Message, ...] = (
    m.Welcome(1.0),
    m.Refusal("The hub does not know this connection: say hello."),
    m.Setup(1, SETUP),
    m.PolicyUpdate(1, Policy(1, (LAYER,), LAYER, LAYER, 3.0, 1)),
    m.Lease(1, TASKS),
    m.Lease(2, TASKS[:1]),
    m.Ack(1, (0, 1)),
    m.Drop(1),
    m.Piece(1, 0, len(WHOLE), WHOLE[:8]),
    m.Piece(1, 8, len(WHOLE), WHOLE[8:]),
    m.Piece(2, 0, 2**26, WHOLE),
)
LAST = 77
"""A campaign that nobody has spoken of before."""

LAST_WORDS = tuple(
    m.encode(said) for said in (m.Welcome(1.0), m.Setup(LAST, SETUP), m.Lease(LAST, (TASKS[0],)))
)


class Fuzzed(NamedTuple):
    """What came of it.

    Attributes:
        messages: how many were said.
        escapes: the exceptions that left the loop, as text.
        grown_bytes: of resident memory, since the first third of the messages.
        answered: whether a true message was answered afterwards.
    """

    messages: int
    escapes: tuple[str, ...]
    grown_bytes: int
    answered: bool


def resident_bytes() -> int:
    """Memory of this process that is in use."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


def turns(inbox: Iterator[object], n: int, into: FakeSocket, turn: Callable[[], None]) -> Fuzzed:
    """Let messages come in, some at a time; each turn is to bear them."""
    escapes: list[str] = []
    before = 0
    for said in range(0, n, TURN):
        before = before if said > SETTLED * n else resident_bytes()
        into.inbox.extend(next(inbox) for _ in range(min(TURN, n - said)))
        while into.inbox:
            try:
                turn()
            except Exception as error:  # noqa: BLE001 - it is what is looked for
                escapes.append(f"{type(error).__name__}: {error}")
    return Fuzzed(n, tuple(escapes), resident_bytes() - before, answered=False)


def at_the_hub(n: int = MESSAGES, seed: int = SEED) -> Fuzzed:
    """A hub that runs campaigns, and n messages from eight connections."""
    store = open_store("memory://")
    with quiet(), fake_learners():
        hub, router = fake_hub(store)
        for _ in CAMPAIGNS:
            launch(hub, store.campaigns.create(check_spec(spec(episodes=EPISODES))).id)

        def turn() -> None:
            hub.turn()
            router.outbox.clear()
            while not hub.finished_runs.empty():
                if (
                    ended := hub.finished_runs.get()
                ).problem:  # a bent result was refused three times
                    launch(hub, ended.campaign)

        fuzzed = turns(parts(n, seed), n, router, turn)
        router.inbox.append([b"new", m.encode(m.Hello(m.PROTOCOL, "new", 8))])
        hub.turn()
        kinds = {type(m.read_hub_message(data)) for to, data in router.outbox if to == b"new"}
        return fuzzed._replace(answered=kinds >= {m.Welcome})


def launch(hub: Hub, campaign: int) -> None:
    """Let the hub run a campaign."""
    hub.launch(RunSpec(campaign, SETUP, "monte_carlo", {}, 0, context_of(EPISODES)))


def parts(n: int, seed: int) -> Iterator[list[bytes]]:
    """Whole messages as a ROUTER gives them: mostly one frame behind the sender, not always."""
    random = Random(seed)
    for data in words(TO_HUB, seed, n):
        before = random.choices((0, 1, 3_000), (97, 2, 1))[0]
        yield [random.choice(CONNECTIONS), *[b""] * before, *[data] * (random.random() < 0.99)]


def at_the_worker(n: int = MESSAGES, seed: int = SEED) -> Fuzzed:
    """A worker that runs what it can, and n messages from its hub."""
    with quiet():
        worker = FakeWorker()

        def turn() -> None:
            worker.turn()
            worker.work()
            worker.dealer.inbox.extendleft(acks(worker.dealer))

        fuzzed = turns(words(TO_WORKER, seed, n), n, worker.dealer, turn)
        return fuzzed._replace(answered=runs_on(worker))


def acks(dealer: FakeSocket) -> Iterator[bytes]:
    """What a hub says to the results that came."""
    assembler = Assembler()
    while dealer.outbox:
        said = join_pieces(assembler, dealer.outbox.popleft())
        if isinstance(said, m.Results):
            yield m.encode(m.Ack(said.campaign, tuple(one.index for one in said.results)))


def runs_on(worker: FakeWorker) -> bool:
    """Whether it still runs an episode that it is leased."""
    worker.dealer.inbox.extend(LAST_WORDS)
    assembler = Assembler()
    for _ in range(MOST_TURNS):
        worker.turn()
        worker.work()
        while worker.dealer.outbox:
            if is_last_result(join_pieces(assembler, worker.dealer.outbox.popleft())):
                return True
    return False


def join_pieces(assembler: Assembler, data: bytes) -> m.Message:
    """What a worker says, or the message that it completes with it."""
    said = m.read_worker_message(data)
    whole = assembler.add(said) if isinstance(said, m.Piece) else None
    return said if whole is None else m.read_worker_message(whole)


def is_last_result(said: m.Message) -> bool:
    """Whether it is what the last words ask for: an episode that was run."""
    if not isinstance(said, m.Results) or said.campaign != LAST:
        return False
    return said.results[0].outcome is Outcome.SAFE


def at_the_engine(n: int = MESSAGES, seed: int = SEED) -> Fuzzed:
    """An engine on a bridge, and n bent answers of the bridge."""
    before = resident_bytes()
    escapes, answered = fuzzing_bridge.at_the_engine(n, seed)
    return Fuzzed(n, escapes, resident_bytes() - before, answered)


def at_the_hub_s_socket(n: int = OVER_SOCKETS, seed: int = SEED) -> Fuzzed:
    """The same over ZeroMQ, and strangers that speak no ZeroMQ at all."""
    before = resident_bytes()
    with quiet():
        hub = Hub(open_store("memory://"), "tcp://127.0.0.1:*")
        hub.start()
        port = int(hub.address.rsplit(":", 1)[1])
        peers = [dealer(hub.address) for _ in CONNECTIONS]
        for number, frames in enumerate(parts(n, seed)):
            peers[number % len(peers)].send_multipart(frames[1:] or [b""])
            if number % TURN == 0:
                knock(port, FOREIGN[number // TURN % len(FOREIGN)])
        with dealer(hub.address) as last:
            last.send(m.encode(m.Hello(m.PROTOCOL, "last", 1)))
            answered = bool(last.poll(PATIENCE_S * 1_000)) and hub.is_alive()
        for peer in peers:
            peer.close(linger=0)
        escapes = () if hub.is_alive() else ("the hub's thread ended",)
        hub.stop()
    return Fuzzed(n, escapes, resident_bytes() - before, answered)


def dealer(address: str) -> "zmq.Socket[bytes]":
    """A worker's end."""
    made: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
    made.setsockopt(zmq.LINGER, 0)
    made.connect(address)
    return made


def knock(port: int, data: bytes) -> None:
    """Connect, say something, go."""
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as stranger:
        stranger.sendall(data)


def at_the_worker_s_socket(n: int = OVER_SOCKETS, seed: int = SEED) -> Fuzzed:
    """A worker's link, and a hub that says such things over ZeroMQ."""
    before = resident_bytes()
    with quiet(), zmq.Context.instance().socket(zmq.ROUTER) as router:
        router.setsockopt(zmq.LINGER, 0)
        port = router.bind_to_random_port("tcp://127.0.0.1")
        worker = FakeWorker(f"tcp://127.0.0.1:{port}")
        thread = Thread(target=worker.serve)
        thread.start()
        router.poll(PATIENCE_S * 1_000)
        connection = router.recv_multipart()[0]
        for data in words(TO_WORKER, seed, n):
            router.send_multipart([connection, data])
        answered = wait_for_last(router)
        escapes = () if thread.is_alive() else ("the worker's loop ended",)
        worker.shut_down()
        thread.join(PATIENCE_S)
    return Fuzzed(n, escapes, resident_bytes() - before, answered)


def wait_for_last(router: "zmq.Socket[bytes]") -> bool:
    """Whether the result that the last words ask for comes.

    They are said whenever the worker speaks: it may connect anew, or drop what it was told before.
    """
    until_s, assembler = time.monotonic() + PATIENCE_S, Assembler()
    while (left_s := until_s - time.monotonic()) > 0 and router.poll(left_s * 1_000):
        connection, *_, data = router.recv_multipart()
        if is_last_result(join_pieces(assembler, data)):
            return True
        for word in LAST_WORDS:
            router.send_multipart([connection, word])
    return False


PLACES: dict[str, tuple[Callable[[int, int], Fuzzed], int]] = {
    "the hub": (at_the_hub, MESSAGES),
    "the worker": (at_the_worker, MESSAGES),
    "the bridge's worker": (at_the_engine, MESSAGES),
    "the hub's socket": (at_the_hub_s_socket, OVER_SOCKETS),
    "the worker's socket": (at_the_worker_s_socket, OVER_SOCKETS),
}


def everywhere(n: int = MESSAGES, seed: int = SEED) -> dict[str, Fuzzed]:
    """What came of n messages at the hub, the worker and an engine, and of some over sockets."""
    return {
        place: fuzz(n if most == MESSAGES else most, seed) for place, (fuzz, most) in PLACES.items()
    }


def fuzzed(_crew: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Figures: how many messages were said, and how many exceptions left a loop."""
    found = everywhere(seed=seed).values()
    n = sum(one.messages for one in found)
    yield "fuzz.messages", number(n, "messages", n)
    yield "fuzz.escapes", number(sum(len(one.escapes) for one in found), "exceptions", n)


def main(
    messages: Annotated[int, typer.Option(min=1, help="To the hub, and to the worker.")] = MESSAGES,
    seed: Annotated[int, typer.Option(min=0, help="Of what is said.")] = SEED,
) -> None:
    """Say it all; exit code 1 if anything escaped or was not answered."""
    found = everywhere(messages, seed)
    for place, one in found.items():
        grown_mb = one.grown_bytes / 1e6
        print(
            f"{place:<20} {one.messages:>8} messages, {len(one.escapes)} escapes, "
            f"{grown_mb:+.1f} MB, {'answered' if one.answered else 'NOT ANSWERED'} afterwards"
        )
        for escape in sorted(set(one.escapes))[:10]:
            print(f"    {escape}")
    raise typer.Exit(any(one.escapes or not one.answered for one in found.values()))


if __name__ == "__main__":
    typer.run(main)
