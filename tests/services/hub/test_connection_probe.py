"""Whose connection is closed: what a ROUTER tells, and what becomes of those whom it tells of."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest
import zmq

from eigenfail.values.episode import EpisodeTask, PriorSource
from eigenfail.wire.messages import PROTOCOL, Heartbeat, Hello, encode
from eigenfail_services.hub import worker_sessions as module
from eigenfail_services.hub.commits import MAX_DEATHS
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.transport import (
    GRACE_S,
    PROBE_INTERVAL_S,
    QUIET_HEARTBEATS,
    bind,
    is_connected,
    send,
)
from eigenfail_services.hub.worker_sessions import HEARTBEAT_S, SILENCE_LIMIT_S, WorkerSessions

TICK_S = 0.05
SOON_S = QUIET_HEARTBEATS * HEARTBEAT_S + GRACE_S + 2 * PROBE_INTERVAL_S + TICK_S
PRIOR = PriorSource()
PEER = """
import sys, time, zmq
dealer = zmq.Context().socket(zmq.DEALER)
dealer.connect(sys.argv[1])
dealer.send(b"here")
time.sleep(600)
"""


class Table:
    """Worker sessions whose clock and whose workers' connections are played."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.now_s = 1_000.0
        patch.setattr(module.time, "monotonic", lambda: self.now_s)
        self.closed: set[bytes] = set()
        self.leases = Leases()
        known = lambda worker: worker not in self.closed  # noqa: E731
        self.sessions = WorkerSessions(lambda *_: None, self.leases, None, is_connected=known)  # type: ignore[arg-type]

    def join(self, worker: bytes, life: str) -> None:
        self.sessions.handle(worker, encode(Hello(PROTOCOL, life, 64, life=life)))

    def runs_one(self, worker: bytes) -> None:
        self.leases.offer(1, (EpisodeTask(0, 0, PRIOR), EpisodeTask(1, 1, PRIOR)))
        self.leases.assign()
        self.sessions.handle(worker, encode(Heartbeat(1, 0, ((1, 0), (1, 1)))))

    def goes_by(self, seconds: float, *heard: bytes) -> None:
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            self.now_s += TICK_S
            for worker in heard:
                self.sessions.handle(worker, encode(Heartbeat()))
            self.sessions.expire_silent()

    def held_by(self, worker: bytes) -> set[tuple[int, int]]:
        self.leases.assign()
        return set(self.leases.sessions[worker].held)


@pytest.fixture
def table(monkeypatch: pytest.MonkeyPatch) -> Table:
    return Table(monkeypatch)


BOTH = {(1, 0), (1, 1)}


@pytest.mark.fault("SIGKILL of a worker")
def test_who_was_killed_is_given_up_soon_and_counted_when_it_stays_away(table: Table) -> None:
    table.join(b"a", "one")
    table.runs_one(b"a")
    table.closed.add(b"a")
    table.goes_by(SOON_S)
    assert table.leases.sessions == {}
    table.join(b"b", "two")
    assert table.held_by(b"b") == BOTH
    assert table.leases.list_interrupted() == []
    table.goes_by(SILENCE_LIMIT_S, b"b")
    assert [task.index for _, task in table.leases.list_interrupted()] == [0]
    table.leases.clear_interrupted(1, 0)
    assert table.held_by(b"b") == BOTH
    assert table.leases.list_interrupted() == []


@pytest.mark.fault("SIGKILL of a worker")
def test_a_death_of_what_has_a_result_by_then_is_not_counted(table: Table) -> None:
    table.join(b"a", "one")
    table.runs_one(b"a")
    table.closed.add(b"a")
    table.goes_by(SOON_S)
    table.leases.record_result(1, 0, 1.0)
    table.goes_by(SILENCE_LIMIT_S)
    assert table.leases.list_interrupted() == []


@pytest.mark.fault("worker connection cut")
@pytest.mark.parametrize("away_s", [0.5, SOON_S, SILENCE_LIMIT_S - 1.0])
def test_who_comes_back_by_another_line_has_died_of_nothing(table: Table, away_s: float) -> None:
    table.join(b"a", "one")
    table.runs_one(b"a")
    table.closed.add(b"a")
    table.goes_by(away_s)
    table.join(b"again", "one")
    assert table.leases.sessions.keys() == {b"again"}
    table.goes_by(2 * SILENCE_LIMIT_S, b"again")
    assert table.leases.list_interrupted() == []
    assert table.held_by(b"again") == BOTH


def test_who_keeps_its_connection_has_all_the_time_that_there_is(table: Table) -> None:
    table.join(b"a", "one")
    table.goes_by(SILENCE_LIMIT_S - 2 * TICK_S)
    assert table.leases.sessions.keys() == {b"a"}
    table.goes_by(4 * TICK_S)
    assert table.leases.sessions == {}


def test_nobody_who_is_heard_is_asked(table: Table) -> None:
    table.join(b"a", "one")
    table.closed.add(b"a")
    table.goes_by(3 * SILENCE_LIMIT_S, b"a")
    assert table.leases.sessions.keys() == {b"a"}


@pytest.fixture
def router() -> Iterator["zmq.Socket[bytes]"]:
    bound = bind("tcp://127.0.0.1:*")
    yield bound
    bound.close(linger=0)


@pytest.fixture
def peer(router) -> Iterator[Callable[[], tuple[subprocess.Popen, bytes]]]:
    started: list[subprocess.Popen] = []

    def start() -> tuple[subprocess.Popen, bytes]:
        address = router.getsockopt_string(zmq.LAST_ENDPOINT)
        started.append(subprocess.Popen([sys.executable, "-c", PEER, address]))
        connection, _ = router.recv_multipart()
        return started[-1], connection

    yield start
    for process in started:
        process.kill()
        process.wait()


def until(condition: Callable[[], bool], router: "zmq.Socket[bytes]") -> None:
    for _ in range(1_000):
        if condition():
            return
        router.poll(10)
    raise AssertionError("it did not come to that")


@pytest.mark.fault("SIGKILL of a worker")
@pytest.mark.service
def test_a_router_knows_whose_process_was_killed_and_not_whose_is_stopped(router, peer) -> None:
    (killed, to_killed), (stopped, to_stopped) = peer(), peer()
    assert is_connected(router, to_killed)
    os.kill(stopped.pid, signal.SIGSTOP)
    killed.kill()
    until(lambda: not is_connected(router, to_killed), router)
    assert is_connected(router, to_stopped)
    assert not is_connected(router, b"nobody")
    send(router, to_killed, Heartbeat())  # nobody is there to get it, and nothing happens
    assert is_connected(router, to_stopped)


@pytest.mark.service
def test_a_full_line_is_not_taken_for_a_closed_one(router, peer) -> None:
    stopped, connection = peer()
    os.kill(stopped.pid, signal.SIGSTOP)
    with suppress(zmq.Again):
        while True:
            router.send_multipart([connection, bytes(100)], zmq.NOBLOCK)
    assert is_connected(router, connection)
    stopped.kill()
    until(lambda: not is_connected(router, connection), router)


@pytest.mark.fault("episode that kills its worker")
def test_an_episode_takes_four_workers_at_most(table: Table) -> None:
    table.leases.offer(1, (EpisodeTask(0, 0, PRIOR),))
    died = counted = 0
    while counted < MAX_DEATHS:
        worker = b"%d" % died
        table.join(worker, worker.decode())
        if table.held_by(worker):
            table.sessions.handle(worker, encode(Heartbeat(1, 0, ((1, 0),))))
            table.closed.add(worker)
            died += 1
            table.goes_by(SOON_S)
        else:
            table.goes_by(TICK_S, worker)
        for _, task in table.leases.list_interrupted():
            counted += 1
            if counted < MAX_DEATHS:
                table.leases.clear_interrupted(1, task.index)
    assert died <= MAX_DEATHS + 1


@pytest.mark.parametrize("back", ["one", "two"])
def test_if_one_of_the_two_comes_back_it_goes_on(table: Table, back: str) -> None:
    both_are_missed(table)
    table.join(b"c", "three")
    assert table.held_by(b"c") == {(1, 1)}
    table.join(b"again", back)
    assert table.held_by(b"again") == {(1, 0)}


def test_two_that_are_overdue_at_once_count_as_two(table: Table) -> None:
    both_are_missed(table)
    counted = []
    for _ in range(3):
        table.leases.expire_disconnected(table.now_s + SILENCE_LIMIT_S)
        counted += table.leases.list_interrupted()
        table.leases.clear_interrupted(1, 0)
    assert len(counted) == 2


def test_what_is_proposed_anew_later_is_not_withheld_for_ever(table: Table) -> None:
    both_are_missed(table)
    table.join(b"c", "three")
    table.leases.unqueue_campaign(1)
    table.goes_by(2 * SILENCE_LIMIT_S, b"c")
    table.leases.offer(1, (EpisodeTask(0, 0, PRIOR), EpisodeTask(1, 1, PRIOR)))
    assert table.held_by(b"c") == BOTH


def both_are_missed(table: Table) -> None:
    """Two workers, one after the other, with the first episode."""
    for worker, life in ((b"a", "one"), (b"b", "two")):
        table.join(worker, life)
        table.runs_one(worker)
        table.closed.add(worker)
        table.goes_by(SOON_S)


@pytest.mark.fault("SIGSTOP of the services")
def test_a_hub_that_stood_still_counts_no_death_of_who_could_not_come_back(table: Table) -> None:
    table.join(b"a", "one")
    table.runs_one(b"a")
    table.closed.add(b"a")
    table.goes_by(SOON_S)
    table.now_s += 2 * SILENCE_LIMIT_S
    table.sessions.expire_silent()
    assert table.leases.list_interrupted() == []
