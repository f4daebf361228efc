"""Workers that are to leave: they get nothing more, finish what they hold, and go home once."""

import pytest

from eigenfail.values.episode import EpisodeTask, PriorSource
from eigenfail.wire.messages import PROTOCOL, Goodbye, Hello, Lease, encode
from eigenfail_services.hub import worker_sessions as module
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.metrics import Work, measure_demand
from eigenfail_services.hub.worker_sessions import GOODBYE_INTERVAL_S, Draining, WorkerSessions


class Table:
    """Sessions of workers, and what it sent."""

    def __init__(self, *names: str) -> None:
        self.sent: list[tuple[bytes, object]] = []
        self.leases, self.draining = Leases(), Draining()
        self.sessions = WorkerSessions(lambda w, m: self.sent.append((w, m)), self.leases, None)  # type: ignore[arg-type]
        for name in names:
            self.join(name)

    def join(self, name: str) -> None:
        self.sessions.handle(name.encode(), encode(Hello(PROTOCOL, name, 64)))

    def offer(self, *indices: int) -> dict[bytes, int]:
        """How many episodes went to whom."""
        self.leases.offer(1, tuple(EpisodeTask(i, 0, PriorSource()) for i in indices))
        return {each.worker: len(each.tasks) for each in self.leases.assign()}

    def goodbyes(self) -> list[bytes]:
        self.sessions.drain(self.draining)
        said = [worker for worker, message in self.sent if isinstance(message, Goodbye)]
        self.sent.clear()
        return said


@pytest.fixture
def now_s(monkeypatch) -> list[float]:
    now_s = [1_000.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now_s[0])
    return now_s


def test_who_holds_nothing_is_sent_home_at_once_and_once(now_s) -> None:
    table = Table("a", "b")
    table.draining.set_names({"a", "nobody"})
    assert [table.goodbyes(), table.goodbyes()] == [[b"a"], []]
    assert table.offer(*range(8)).keys() == {b"b"}
    assert not any(isinstance(message, Lease) for _, message in table.sent)


def test_who_holds_something_finishes_it_and_gets_nothing_more(now_s) -> None:
    table = Table("a")
    assert table.offer(0) == {b"a": 1}
    table.draining.set_names({"a"})
    assert table.goodbyes() == []
    assert table.offer(1) == {}
    table.leases.record_result(1, 0, 0.1)
    assert table.goodbyes() == [b"a"]


def test_a_goodbye_that_went_astray_is_said_again(now_s) -> None:
    table = Table("a")
    table.draining.set_names({"a"})
    assert table.goodbyes() == [b"a"]
    now_s[0] += GOODBYE_INTERVAL_S - 0.1
    assert table.goodbyes() == []
    now_s[0] += 0.2
    assert table.goodbyes() == [b"a"]


def test_who_comes_back_from_a_line_that_was_cut_is_sent_home_then(now_s) -> None:
    table = Table("a")
    table.draining.set_names({"a"})
    assert table.goodbyes() == [b"a"]
    table.leases.end_session(b"a")
    assert table.goodbyes() == []
    table.join("a")
    assert table.goodbyes() == [b"a"]
    assert table.offer(0) == {}


class Campaign:
    def __init__(self, episodes: int, worker_s: float) -> None:
        self._work = Work(episodes, worker_s)

    def work(self) -> Work:
        return self._work


def test_demand_adds_up_the_work_and_tells_who_holds_nothing() -> None:
    table = Table("a", "b")
    table.offer(0)
    sessions = [*table.leases.sessions.values()]
    found = measure_demand([Campaign(3, 1.5), Campaign(2, 8.0)], sessions)
    assert found.work == Work(5, 9.5)
    assert found.present == {"a", "b"}
    assert found.idle == {session.name for session in sessions if not session.held}
    assert len(found.idle) == 1
