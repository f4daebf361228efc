"""Events about campaigns that no connected worker can run."""

import pytest

from eigenfail.errors import StoreUnavailable
from eigenfail_services.hub import worker_table
from eigenfail_services.hub.worker_table import (
    GRACE_PERIOD_S,
    WORKERS_LACKING,
    WORKERS_MET,
    UnrunnableCampaigns,
)
from eigenfail_services.store.store import open_store


class Play:
    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.now_s = 100.0
        patch.setattr(worker_table.time, "monotonic", lambda: self.now_s)
        self.store, self.found, self.has_bridge = open_store("memory://"), set[int](), False
        self.unrunnable = UnrunnableCampaigns(
            self.store.events, lambda: self.found, lambda: self.has_bridge
        )

    def goes_by(self, seconds: float, *running: int) -> None:
        self.unrunnable.update(running)
        self.now_s += seconds
        self.unrunnable.update(running)

    def said(self) -> list[tuple[str, int | None]]:
        return [(event.kind, event.campaign) for event in reversed(self.store.events.latest(99))]


@pytest.fixture
def play(monkeypatch: pytest.MonkeyPatch) -> Play:
    return Play(monkeypatch)


def test_it_is_said_once_when_it_has_lasted_and_once_when_it_is_over(play: Play) -> None:
    play.found = {7}
    play.goes_by(GRACE_PERIOD_S - 0.1, 7, 8)
    assert play.said() == []
    for _ in range(3):
        play.goes_by(GRACE_PERIOD_S, 7, 8)
    assert play.said() == [(WORKERS_LACKING, 7)]
    assert "--bridge tcp://" in play.store.events.latest(1)[0].message
    play.found, play.has_bridge = set(), True
    play.goes_by(GRACE_PERIOD_S, 7, 8)
    assert play.said() == [(WORKERS_LACKING, 7), (WORKERS_MET, 7)]


def test_that_nothing_waits_for_a_while_is_not_taken_for_a_bridge(play: Play) -> None:
    play.found = {7}
    play.goes_by(GRACE_PERIOD_S, 7)
    play.found = set()  # the last of a round was given up, and the next round is not there yet
    play.goes_by(GRACE_PERIOD_S, 7)
    play.found = {7}
    play.goes_by(GRACE_PERIOD_S, 7)
    assert play.said() == [(WORKERS_LACKING, 7)]


def test_what_passes_by_itself_is_not_said(play: Play) -> None:
    for _ in range(3):
        play.found = {7}
        play.goes_by(GRACE_PERIOD_S / 2, 7)
        play.found = set()
        play.goes_by(GRACE_PERIOD_S / 2, 7)
    assert play.said() == []


def test_nothing_is_said_of_a_campaign_that_rests(play: Play) -> None:
    play.found = {7}
    play.goes_by(GRACE_PERIOD_S, 7)
    play.found = set()
    play.goes_by(GRACE_PERIOD_S)
    assert play.said() == [(WORKERS_LACKING, 7)]


def test_what_could_not_be_written_down_is_said_later(play: Play) -> None:
    def away(*_: object) -> None:
        raise StoreUnavailable("The disk is full.")

    play.found = {7}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(play.store.events, "append", away)
        with pytest.raises(StoreUnavailable):
            play.goes_by(GRACE_PERIOD_S, 7)
    play.goes_by(0.0, 7)
    assert play.said() == [(WORKERS_LACKING, 7)]
