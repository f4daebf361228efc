"""Checkpoints that are not what was saved: noticed, dropped, and told."""

import numpy as np
import pytest
from sqlalchemy import update
from store_checks.examples import running

from eigenfail.errors import ProtocolError
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds
from eigenfail_services.methods.cem import CemSettings, CrossEntropyMethod
from eigenfail_services.store.checkpoints import hash_state
from eigenfail_services.store.schema import checkpoints
from eigenfail_services.store.store import Store

BEFORE, LAST = b"the one before", b"the last one"


def spoil(store: Store, campaign: int, kept: bytes, **changes) -> None:
    """Change what is kept of a checkpoint behind the store's back."""
    mine = (checkpoints.c.campaign == campaign) & (checkpoints.c.state == kept)
    with store.database.writing() as connection:
        assert connection.execute(update(checkpoints).where(mine).values(**changes)).rowcount == 1


def saved(store: Store, *states: bytes) -> int:
    campaign = running(store).id
    for state in states:
        store.checkpoints.save(campaign, state)
    return campaign


def told(store: Store, campaign: int) -> list[str]:
    events = store.events.latest(100, campaign)
    return [event.message for event in events if event.kind == "checkpoint.damaged"]


def flipped(state: bytes, place: int) -> bytes:
    return state[:place] + bytes([state[place] ^ 1]) + state[place + 1 :]


@pytest.mark.fault("damaged checkpoint")
def test_the_hash_is_over_every_byte_of_learner_and_open_rounds() -> None:
    context = LearnerContext(0, 20, 3, np.zeros((0, 3, 2), np.float32))
    rounds = Rounds(CrossEntropyMethod(context, CemSettings(batch=10)), 5, 20)
    assert rounds.open()
    state = rounds.checkpoint()
    kept = hash_state(state)
    for place in range(len(state)):
        assert hash_state(flipped(state, place)) != kept
        assert hash_state(state[:place]) != kept


@pytest.mark.fault("damaged checkpoint")
@pytest.mark.parametrize("damage", [flipped, lambda state, place: state[:place]])
def test_a_damaged_one_falls_back_to_the_one_before(store: Store, damage) -> None:
    campaign = saved(store, b"long ago", BEFORE)
    for place in (0, 5, len(LAST) - 1):
        store.checkpoints.save(campaign, LAST)
        before = told(store, campaign)
        spoil(store, campaign, LAST, state=damage(LAST, place))
        assert store.checkpoints.load(campaign) == BEFORE
        assert told(store, campaign) == before  # whoever only looks changes nothing
        assert store.checkpoints.recover(campaign) == BEFORE
        message, *earlier = told(store, campaign)
        assert earlier == before
        assert f"last checkpoint of campaign {campaign} is damaged" in message
        assert "same episodes" in message


def test_a_damaged_hash_is_as_good_as_a_damaged_state(store: Store) -> None:
    campaign = saved(store, BEFORE, LAST)
    spoil(store, campaign, LAST, sha256=hash_state(BEFORE))
    assert store.checkpoints.recover(campaign) == BEFORE


def test_what_was_dropped_is_told_once_and_makes_room_for_the_next(store: Store) -> None:
    campaign = saved(store, BEFORE, LAST)
    spoil(store, campaign, LAST, state=b"bent")
    for _ in range(2):
        assert store.checkpoints.recover(campaign) == BEFORE
    assert len(told(store, campaign)) == 1
    store.checkpoints.save(campaign, LAST)
    spoil(store, campaign, LAST, state=b"bent again")
    assert store.checkpoints.recover(campaign) == BEFORE
    assert len(told(store, campaign)) == 2


@pytest.mark.parametrize("states", [(LAST,), (BEFORE, LAST)])
def test_without_one_that_is_whole_there_is_a_remedy(store: Store, states) -> None:
    campaign = saved(store, *states)
    for state in states:
        spoil(store, campaign, state, state=state + b"!")
    for ask in (store.checkpoints.load, store.checkpoints.recover):
        with pytest.raises(
            ProtocolError, match=r"SHA-256 does not match.*Launch the campaign again"
        ):
            ask(campaign)
    assert told(store, campaign) == []


def test_two_are_kept(sql_store: Store) -> None:
    campaign = saved(sql_store, *(bytes([number]) for number in range(5)))
    with sql_store.database.reading() as connection:
        rows = connection.execute(checkpoints.select().order_by(checkpoints.c.number)).all()
    assert [(row.campaign, row.state) for row in rows] == [(campaign, b"\x03"), (campaign, b"\x04")]
