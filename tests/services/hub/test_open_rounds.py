"""Which episodes of open rounds are asked for, and which of their results count."""

from typing import Any

import msgspec
import numpy as np
import pytest
from accepted import accept_spec
from store_checks.examples import name_channels, result_of

from eigenfail.values import episode
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.learning import STATE, Round
from eigenfail.values.records import Delivery, Verdict
from eigenfail.wire.messages import PROTOCOL, Hello
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.open_rounds import MAX_REFUSALS, OpenRounds
from eigenfail_services.store.codec import find_noise_form
from eigenfail_services.store.store import open_store

TASKS = tuple(episode.EpisodeTask(index, index, episode.PriorSource()) for index in range(4))
ROUNDS = Round(0, TASKS[:2]), Round(1, TASKS[2:])


class Opened:
    """The open rounds of one campaign, beside a store and a worker."""

    def __init__(self, *, observes: bool = True, **fields: Any) -> None:
        spec = CampaignSpec(name="t", method="monte_carlo", episodes=4, **fields)
        self.store, self.leases = open_store("memory://"), Leases()
        self.campaign = self.store.campaigns.create(accept_spec(spec)).id
        self.leases.open_session(b"w", Hello(PROTOCOL, "w", 256), 0.0)
        form = find_noise_form(spec)
        self.rounds = OpenRounds(self.campaign, form, self.store, self.leases, observes=observes)

    def leased(self) -> list[int]:
        return sorted(task.index for each in self.leases.assign() for task in each.tasks)

    def commit(self, *results: episode.EpisodeResult) -> list[Verdict]:
        deliveries = [Delivery(result, "w") for result in results]
        return self.store.episodes.commit(self.campaign, deliveries)

    def deliver(self, result: episode.EpisodeResult) -> None:
        (verdict,) = self.commit(result)
        self.leases.complete(self.campaign, result.index, 0.1)
        self.rounds.take_verdict(result, verdict)


@pytest.fixture
def opened() -> Opened:
    return Opened()


def result(index: int, kind: str = "input") -> episode.EpisodeResult:
    return episode.unrunnable(TASKS[index], episode.EpisodeFault(kind, "test"))


def test_what_has_a_result_is_not_asked_for(opened: Opened) -> None:
    opened.commit(result(0), result(3))
    opened.rounds.open(ROUNDS)
    assert opened.leased() == [1, 2]
    assert opened.rounds.collector.count_pending() == 2


@pytest.mark.parametrize(("observes", "rows"), [(True, 3), (False, 0)])
def test_a_learner_that_uses_no_results_gets_them_without_arrays(observes: bool, rows: int) -> None:
    opened, steps = Opened(observes=observes), np.ones((3, 2), np.float32)
    arrays = {
        "noise": NoiseTrajectory(steps, steps),
        "states": np.ones((3, len(STATE)), np.float32),
        "importance": np.ones(3, np.float32),
    }
    stored, delivered = (msgspec.structs.replace(result(n), steps=3, **arrays) for n in (0, 1))
    opened.commit(stored)
    opened.rounds.open(ROUNDS[:1])
    opened.deliver(delivered)
    observed = opened.rounds.collector.pop_complete() or ()
    assert [(each.index, each.steps) for each in observed] == [(0, 3), (1, 3)]
    for each in observed:
        found = each.noise.z, each.noise.sigma, each.states, each.importance
        assert [0 if array is None else len(array) for array in found] == [rows] * 4
    assert len(opened.store.episodes.get(opened.campaign, 1).noise.z) == 3


@pytest.mark.parametrize("channels", [1, 3, 5])
@pytest.mark.parametrize("observes", [True, False])
def test_noise_without_a_step_has_the_channels_of_the_campaign(
    channels: int, observes: bool
) -> None:
    opened = Opened(observes=observes, **name_channels(channels))
    opened.commit(result(0))
    opened.rounds.open(ROUNDS[:1])
    opened.deliver(result(1))
    for each in opened.rounds.collector.pop_complete() or pytest.fail("The round is not complete."):
        assert each.noise.z.shape == each.noise.sigma.shape == (0, channels)


def test_a_result_with_noise_of_other_channels_is_asked_for_again() -> None:
    opened = Opened(**name_channels(3))
    opened.rounds.open(ROUNDS[:1])
    assert opened.leased() == [0, 1]
    opened.deliver(result_of(2))
    assert opened.leased() == [0]


def test_of_two_results_the_one_that_is_kept_counts(opened: Opened) -> None:
    opened.rounds.open(ROUNDS[:1])
    opened.commit(result(0))
    opened.deliver(result(0, "solver"))
    opened.deliver(result(1))
    assert opened.rounds.collector.pop_complete() is None
    assert [opened.rounds.load_kept_results() for _ in range(2)] == [1, 0]
    assert [
        each.fault and each.fault.kind for each in opened.rounds.collector.pop_complete() or ()
    ] == ["input"] * 2


def test_what_is_refused_is_asked_for_again_but_not_for_ever(opened: Opened) -> None:
    opened.rounds.open(ROUNDS[:1])
    misfit = msgspec.structs.replace(result(0), steps=-1)
    assert opened.leased() == [0, 1]
    for _ in range(MAX_REFUSALS - 1):
        opened.deliver(misfit)
        assert (opened.leased(), opened.rounds.problem) == ([0], "")
    opened.deliver(misfit)
    assert opened.leased() == []
    assert f"episode 0 was refused {MAX_REFUSALS} times" in opened.rounds.problem
