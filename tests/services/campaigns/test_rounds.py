"""Rounds: seeds, budget, lookahead, order, and going on from a checkpoint."""

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail.errors import LearnerFailed, ProtocolError
from eigenfail.testing.learner import Corridor, ToyEngine
from eigenfail.values.episode import PolicySource, PriorSource, episode_seed
from eigenfail.values.learning import STATE, Layer, Policy, Proposal
from eigenfail_services.campaigns.rounds import Rounds, run_in_process

ENGINE = ToyEngine(Corridor(steps=5))


class Scripted:
    """Proposes rounds of given sizes and remembers what it was shown."""

    def __init__(self, sizes, lookahead=1):
        self.sizes = list(sizes)
        self.lookahead = lookahead
        self.observed = []
        self.proposed = 0

    def propose(self, n):
        size = self.sizes[self.proposed] if self.proposed < len(self.sizes) else 0
        self.proposed += 1
        return Proposal((PriorSource(),) * min(n, size))

    def observe(self, results):
        self.observed.append([result.index for result in results])

    def state(self):
        return msgspec.json.encode([self.proposed, self.observed])

    def restore(self, state):
        self.proposed, self.observed = msgspec.json.decode(state)


class Adversary(Scripted):
    """Sends its policy with the first proposal alone."""

    def propose(self, n):
        layer = Layer(np.zeros((2, len(STATE)), np.float32), np.zeros(2, np.float32))
        policy = Policy(4, (), layer, layer, 3.0, 5) if self.proposed == 0 else None
        plain = super().propose(n)
        return Proposal((PolicySource(4),) * len(plain.sources), policy)


def run(round_):
    if round_.policy:
        ENGINE.add_policy(round_.policy)
    return list(ENGINE.run(round_.tasks))


SIZES = st.lists(st.integers(1, 4), min_size=1, max_size=8)


@settings(deadline=None, max_examples=60)
@given(SIZES, st.integers(0, 3), st.integers(1, 25), st.randoms(use_true_random=False))
def test_rounds_are_observed_whole_in_order_and_once(sizes, lookahead, budget, random):
    learner = Scripted(sizes, lookahead)
    rounds = Rounds(learner, campaign_seed=9, budget=budget)
    while opened := rounds.open():
        assert len(opened) <= lookahead + 1
        results = run(opened[0])
        random.shuffle(results)
        rounds.complete(results)
    seen = [index for observed in learner.observed for index in observed]
    assert seen == list(range(min(budget, sum(sizes))))
    assert all(
        len(observed) <= size for observed, size in zip(learner.observed, sizes, strict=False)
    )
    assert rounds.stopped_because


@settings(deadline=None, max_examples=40)
@given(SIZES, st.integers(0, 3), st.integers(0, 8))
def test_a_restored_campaign_goes_on_with_the_same_rounds(sizes, lookahead, completed):
    rounds = Rounds(Scripted(sizes, lookahead), campaign_seed=9, budget=20)
    for _ in range(completed):
        if opened := rounds.open():
            rounds.complete(run(opened[0]))
    rounds.open()
    other = Rounds(Scripted(sizes, lookahead), campaign_seed=9, budget=20)
    other.restore(rounds.checkpoint())
    assert other.checkpoint() == rounds.checkpoint()
    assert course(other) == course(rounds)


def course(rounds):
    said = []
    while opened := rounds.open():
        said.append([(r.number, r.tasks[0].index, r.tasks[-1].seed, len(r.tasks)) for r in opened])
        rounds.complete(run(opened[0]))
    return said


def test_an_episode_has_the_seed_of_its_index_in_the_campaign():
    rounds = Rounds(Scripted([2, 3]), campaign_seed=5, budget=10)
    tasks = [task for round_ in rounds.open() for task in round_.tasks]
    assert [(t.index, t.seed) for t in tasks] == [(i, episode_seed(5, i)) for i in range(5)]


def test_opening_twice_proposes_once():
    rounds = Rounds(Scripted([2, 2, 2], lookahead=1), campaign_seed=0, budget=10)
    assert [r.number for r in rounds.open()] == [r.number for r in rounds.open()] == [0, 1]


def test_every_round_of_policy_sources_carries_its_policy_even_after_a_restart():
    rounds = Rounds(Adversary([2, 2, 2], lookahead=1), campaign_seed=0, budget=10)
    first, second = rounds.open()
    assert first.policy is second.policy is not None
    rounds.complete(run(first))
    other = Rounds(Adversary([2, 2, 2], lookahead=1), campaign_seed=0, budget=10)
    other.restore(rounds.checkpoint())
    assert [r.policy.version for r in other.open()] == [4, 4]
    assert len(list(run_in_process(other, ToyEngine(Corridor(steps=5))))) == 4


@pytest.mark.parametrize("wrong", ["none", "half", "second", "twice"])
def test_anything_but_the_whole_oldest_round_is_refused_and_not_observed(wrong):
    learner = Scripted([2, 2], lookahead=1)
    rounds = Rounds(learner, campaign_seed=0, budget=4)
    first, second = map(run, rounds.open())
    given = {"none": [], "half": first[:1], "second": second, "twice": [first[0], first[0]]}
    with pytest.raises(ProtocolError, match="oldest open round"):
        rounds.complete(given[wrong])
    assert learner.observed == []
    rounds.complete(first)
    assert learner.observed == [[0, 1]]


def test_nothing_can_be_completed_when_nothing_is_open():
    with pytest.raises(ProtocolError):
        Rounds(Scripted([]), campaign_seed=0, budget=4).complete([])


@pytest.mark.fault(
    "method that proposes too many episodes",
    group="plug-ins",
    outcome="The campaign ends as dead, with the reason.",
)
def test_a_learner_that_proposes_too_much_is_stopped():
    class Greedy(Scripted):
        def propose(self, n):
            return Proposal((PriorSource(),) * (n + 1))

    with pytest.raises(LearnerFailed, match="4 episodes where 3 were left"):
        Rounds(Greedy([]), campaign_seed=0, budget=3).open()


@pytest.mark.parametrize("data", [b"", b"\xc1", b"\x80", b"no checkpoint"])
def test_garbage_is_no_checkpoint(data):
    with pytest.raises(ProtocolError):
        Rounds(Scripted([1]), campaign_seed=0, budget=3).restore(data)


def test_a_checkpoint_of_another_campaign_or_format_is_refused():
    checkpoint = Rounds(Scripted([1]), campaign_seed=0, budget=3).checkpoint()
    with pytest.raises(ProtocolError, match="seed 0 and 3 episodes"):
        Rounds(Scripted([1]), campaign_seed=1, budget=3).restore(checkpoint)
    later = {**msgspec.msgpack.decode(checkpoint), "format": 99}
    with pytest.raises(ProtocolError, match="format 99"):
        Rounds(Scripted([1]), campaign_seed=0, budget=3).restore(msgspec.msgpack.encode(later))
