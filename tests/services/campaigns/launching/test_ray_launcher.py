"""A Ray that dies, in played time: when it is tried again, what is said, who is asked for."""

import errno
from collections import deque

import pytest

from eigenfail.errors import ClusterUnavailable
from eigenfail.hosting.service import Span
from eigenfail_services.campaigns import ray_launcher
from eigenfail_services.campaigns.ray_launcher import LONGEST_PAUSE_S, RayLauncher
from eigenfail_services.campaigns.ray_link import ClusterLost, ClusterStatus, StartRay
from eigenfail_services.hub.metrics import Work, WorkerDemand

STATUS = "The process of Ray's driver ended with status 1."


class PlayedLink:
    """A Ray process that says what it is told to, and ends when it is told to."""

    lives: list["PlayedLink"]

    def __init__(self, begin: StartRay) -> None:
        self.begin, self.names = begin, ()
        self.words: deque[object] = deque([ClusterStatus(machines=1)])
        self.problem = ""
        self.killed = False
        self.lives.append(self)

    def want(self, names: tuple[str, ...]) -> None:
        self.names = names

    def hear(self):
        while self.words:
            yield self.words.popleft()

    def trouble(self) -> str:
        return self.problem

    def kill(self) -> None:
        self.killed = True

    stop = kill


@pytest.fixture
def lives(monkeypatch) -> list[PlayedLink]:
    lives: list[PlayedLink] = []
    monkeypatch.setattr(
        ray_launcher.ray_link, "RayLink", type("Link", (PlayedLink,), {"lives": lives})
    )
    return lives


def started(clock, span: Span, cluster: str | None = None) -> RayLauncher:
    launcher = RayLauncher(span, cluster, clock=clock)
    launcher.start("tcp://127.0.0.1:1")
    return launcher


def kinds(launcher: RayLauncher, table) -> list[str]:
    return [notice.kind for notice in launcher.poll(table)]


def test_a_ray_that_is_lost_is_replaced_after_ever_longer_pauses(lives, clock, table) -> None:
    launcher, pauses = started(clock, Span(2, 2)), []
    for _ in range(8):
        lives[-1].problem = STATUS
        assert kinds(launcher, table) == ["ray.lost"]
        lost_s = clock.now_s
        while lives[-1].problem != "":
            clock.now_s += 0.25
            assert kinds(launcher, table) == []
        pauses.append(clock.now_s - lost_s)
        assert kinds(launcher, table) == ["ray.back"]
    assert pauses == [1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 30.0]
    assert all(life.killed for life in lives[:-1])
    assert {life.names for life in lives} == {lives[0].names}
    assert len(lives[0].names) == 2

    clock.now_s += LONGEST_PAUSE_S
    lives[-1].problem = STATUS
    kinds(launcher, table)
    clock.now_s += 1.0
    kinds(launcher, table)
    assert lives[-1].problem == ""


def test_a_cluster_that_stays_away_is_said_once(lives, clock, table) -> None:
    launcher = started(clock, Span(1, 1), "head:6379")
    said = []
    for _ in range(400):
        if len(lives) < 5:
            lives[-1].words = deque([ClusterLost("Ray cannot be used: nobody listens.")])
        clock.now_s += 0.25
        said += launcher.poll(table)
    assert [notice.kind for notice in said] == ["ray.lost", "ray.back"]
    assert said[0].message == (
        "Ray is lost. Ray cannot be used: nobody listens. The services reconnect to it. "
        "What its workers ran runs again."
    )
    assert len(lives) == 5


def test_a_cluster_that_is_not_there_at_the_start_is_refused(monkeypatch, lives, clock) -> None:
    monkeypatch.setattr(
        ray_launcher.ray_link.RayLink, "hear", lambda _: iter([ClusterLost("Nobody.", "Start it.")])
    )
    with pytest.raises(ClusterUnavailable, match=r"Nobody\. Start it\."):
        started(clock, Span(1, 1))


def test_whoever_gives_up_waiting_for_ray_leaves_nothing_behind(monkeypatch, lives, clock) -> None:
    monkeypatch.setattr(ray_launcher.ray_link.RayLink, "hear", lambda _: iter(()))
    looks = iter([False, False, True])
    launcher = RayLauncher(Span(1, 1), clock=clock)
    launcher.start("tcp://127.0.0.1:1", given_up=lambda: next(looks))
    assert [life.killed for life in lives] == [True]
    launcher.stop()


def test_no_room_for_the_process_of_ray_is_said_with_what_to_do(monkeypatch, clock) -> None:
    def full(_begin: StartRay) -> None:
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(ray_launcher.ray_link, "RayLink", full)
    with pytest.raises(ClusterUnavailable, match="cannot be started: Resource temporarily") as told:
        started(clock, Span(1, 1))
    assert "ulimit -u" in told.value.remedy


def test_who_is_struck_out_is_to_leave_the_hub_until_ray_has_it_no_more(
    lives, clock, table
) -> None:
    launcher = started(clock, Span(0, 2, 10.0))

    table.demand = WorkerDemand(Work(100, 100.0))
    clock.pass_by(3.0, launcher, table)
    names = lives[0].names
    assert len(names) == 2
    lives[0].words.append(ClusterStatus(machines=1, placed=names))
    here = frozenset(names)
    table.demand = WorkerDemand(Work(), present=here, idle=here)
    clock.pass_by(11.0, launcher, table)
    assert (lives[0].names, table.leaving) == ((), here)
    lives[0].words.append(ClusterStatus(machines=1, placed=names[:1]))
    clock.pass_by(0.5, launcher, table)
    assert table.leaving == {names[0]}


def test_work_that_no_worker_may_be_asked_for_is_said_once(lives, clock, table) -> None:
    launcher = started(clock, Span(0, 0))
    assert launcher.poll(table) == ()
    table.demand = WorkerDemand(Work(7, 1.0))
    (notice,) = launcher.poll(table)
    assert notice.message.startswith("Episodes wait, and no worker may be started")
    assert launcher.poll(table) == ()
