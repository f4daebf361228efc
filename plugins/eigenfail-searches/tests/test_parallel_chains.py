"""Chains in parallel: groups take turns, and their episodes stay the same."""

import msgspec
import numpy as np
import pytest
from parallel_rounds import CORRIDOR, describe, make_rounds, play, run

from eigenfail.errors import InvalidValue
from eigenfail.testing.learner import ToyEngine
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_searches.chains.method import ChainSettings, FailureChains, read_state
from eigenfail_services.campaigns.rounds import read_checkpoint
from eigenfail_services.campaigns.validation import check_spec, find_pace
from eigenfail_services.methods import archive

MOVED = {"campaign": 1, "chains": 30}


@pytest.mark.parametrize("workers", [1, 7, 40])
def test_chains_have_the_same_episodes_for_any_workers(workers) -> None:
    random = np.random.default_rng(workers)
    drawn = play(make_rounds(FailureChains, 20, 600, **MOVED), workers, random.exponential)
    assert drawn.episodes == run(make_rounds(FailureChains, 20, 600, **MOVED))


def test_chains_do_not_wait_for_each_other() -> None:
    narrow = play(make_rounds(FailureChains, None, 600, **MOVED), 20)
    wide = play(make_rounds(FailureChains, 20, 600, **MOVED), 20)
    assert wide.episodes != narrow.episodes
    assert narrow.busy < 0.85
    assert wide.busy > 0.93


@pytest.mark.parametrize("before", [0, 1, 2, 40, 60, 65, 100])
def test_chains_go_on_from_a_checkpoint_with_rounds_open(before) -> None:
    whole = run(make_rounds(FailureChains, 20, 600, **MOVED))
    first, seen = make_rounds(FailureChains, 20, 600, **MOVED), []
    engine = ToyEngine(CORRIDOR)
    for _ in range(before):
        if opened := first.open():
            results = list(engine.run(opened[0].tasks))
            seen += map(describe, results)
            first.complete(results)
    opened = first.open()
    other = make_rounds(FailureChains, 20, 600, **MOVED)
    other.restore(first.checkpoint())
    assert [one.number for one in other.open()] == [one.number for one in opened]
    assert other.checkpoint() == first.checkpoint()
    assert seen + run(other) == whole


def test_chains_of_earlier_releases_go_on_with_the_move_that_was_open() -> None:
    """Their states do not count it."""
    whole = run(make_rounds(FailureChains, None, **MOVED))
    first, engine = make_rounds(FailureChains, None, **MOVED), ToyEngine(CORRIDOR)
    for _ in range(3):
        first.complete(list(engine.run(first.open()[0].tasks)))
    first.open()
    checkpoint = msgspec.msgpack.decode(first.checkpoint())
    facts, arrays = archive.read("chains", checkpoint["learner"], dict)
    assert facts.pop("opened") == 1
    assert facts.pop("ahead") == 0
    checkpoint["learner"] = archive.write("chains", facts, arrays)
    other = make_rounds(FailureChains, None, **MOVED)
    other.restore(msgspec.msgpack.encode(checkpoint))
    assert run(other) == whole[90:]


def test_samples_begin_at_the_same_episode_in_groups() -> None:
    rounds = make_rounds(FailureChains, 20, 600, **MOVED)
    settings = ChainSettings(**MOVED)
    done, engine = 0, ToyEngine(CORRIDOR)
    while opened := rounds.open():
        done += len(opened[0].tasks)
        rounds.complete(list(engine.run(opened[0].tasks)))
        facts, _ = read_state(read_checkpoint(rounds.checkpoint()).learner)
        assert facts.tried == max(done - settings.first_sample(600), 0)
    _, trace = read_state(read_checkpoint(rounds.checkpoint()).learner)
    assert trace.shape[:2] == ((600 - settings.first_sample(600)) // 30, 30)


def test_more_workers_than_there_are_chains_are_refused() -> None:
    spec = CampaignSpec(
        name="wide",
        method="chains",
        episodes=20_000,
        planner="idm",
        simulator="point_mass",
        settings=MOVED,
        parallel=30,
    )
    assert find_pace(check_spec(spec)).width == 30
    with pytest.raises(InvalidValue, match=r"no more than 30 chains .* Set it to 30 or"):
        check_spec(msgspec.structs.replace(spec, parallel=31))
