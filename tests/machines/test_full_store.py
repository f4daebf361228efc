"""While results cannot be kept no new work is handed out; when they can, it goes on by itself."""

import pytest
from benchmarks.faults.fake_services import fake_learners, quiet
from hub_room import Room, leased

from eigenfail.errors import StoreUnwritable
from eigenfail.testing.examples import result
from eigenfail.wire.messages import (
    PROTOCOL,
    Ack,
    Hello,
    Message,
    Results,
)

EPISODES = 12


class FullRoom(Room):
    """One of whose store a verb may fail, because the disk is full."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, part: str, verb: str) -> None:
        super().__init__(monkeypatch, EPISODES)
        self.full = False
        whole = getattr(getattr(self.store, part), verb)

        def may_be_full(*words, **more):
            if self.full:
                raise StoreUnwritable("The disk is full.")
            return whole(*words, **more)

        monkeypatch.setattr(getattr(self.store, part), verb, may_be_full)


def acked(said: list[Message]) -> list[int]:
    return [index for one in said if isinstance(one, Ack) for index in one.indices]


@pytest.fixture
def enter(monkeypatch: pytest.MonkeyPatch):
    """Makes a room in which one verb of the store may fail."""
    with quiet(), fake_learners():
        yield lambda part, verb: FullRoom(monkeypatch, part, verb)


@pytest.mark.fault("disk full")
def test_leasing_pauses_while_results_cannot_be_kept(enter) -> None:
    room = enter("episodes", "commit")
    room.say()
    first = leased(room.say(Hello(PROTOCOL, "w", 2)))
    room.full = True
    second = leased(room.say(Results(room.campaign, tuple(map(result, first)))))
    assert second  # nobody knows yet
    room.say()
    brought = [*first, *second]
    said = room.say(Results(room.campaign, tuple(map(result, second))))
    for _ in range(3):  # it is tried again each second, and between two tries nothing is leased
        assert (acked(said), leased(said)) == ([], [])
        room.now_s -= 0.9
        said = room.say()
    room.full = False
    said = [*room.say(), *room.say()]
    assert sorted(acked(said)) == sorted(brought)
    assert leased(said)
    assert room.store.campaigns.get(room.campaign).counts.completed == len(brought)


@pytest.mark.fault("disk full")
def test_leasing_pauses_while_a_learner_cannot_be_kept(enter) -> None:
    room = enter("checkpoints", "save")
    room.full = True
    room.say()
    assert leased(room.say(Hello(PROTOCOL, "w", 2))) == []
    room.full = False
    # The first turn finds that the store is there again, and the next one leases.
    assert leased([*room.say(), *room.say()])
