"""When a learner that is lost may begin again, for how long it is waited, and what it may say."""

from math import inf, nan

import msgspec
import numpy as np
import pytest

from eigenfail.values.episode import EpisodeTask, PolicySource, PriorSource, TrajectorySource
from eigenfail.values.estimates import Estimate, Interval
from eigenfail.values.learning import Layer, Policy, Round
from eigenfail.wire.messages import Diverged, Proposed, Trouble
from eigenfail_services.hub import learner_link
from eigenfail_services.hub.metrics import Timeout

DIED, HUNG = learner_link.describe_exit(-9), learner_link.describe_timeout(60.0)
DIVERGED = learner_link.LearnerFailure(
    learner_link.FailureKind.DIVERGED, "It diverged.", "Lower learning_rate."
)


def ended_with(*losses: learner_link.LearnerFailure) -> str:
    """What the last one of some losses in a row ends a campaign with."""
    counted = learner_link.LearnerRestarts()
    for loss in losses[:-1]:
        assert counted.explain_end(loss) == ""
        counted.add(loss)
    return counted.explain_end(losses[-1])


def test_the_next_life_waits_longer_with_each_loss_and_not_at_all_after_a_round() -> None:
    restarts, pauses_s = learner_link.LearnerRestarts(), []
    for _ in range(4):
        pauses_s.append(restarts.pause_s)
        restarts.add(DIED)
    assert pauses_s == [0.0, 1.0, 5.0, 5.0]
    restarts.reset()
    assert restarts.pause_s == 0.0


@pytest.mark.parametrize(
    ("losses", "times"),
    [
        ((DIED, DIED, DIED), 3),
        ((DIVERGED, DIVERGED), 2),
        ((HUNG, HUNG), 2),
        ((DIVERGED, DIED, HUNG), 3),
        ((DIVERGED, DIED, DIVERGED), 3),
    ],
)
def test_so_many_losses_in_a_row_end_a_campaign_with_the_last_ones_remedy(losses, times) -> None:
    told = ended_with(*losses)
    assert told.startswith(losses[-1].problem)
    assert f"failed {times} times in a row" in told
    assert told.endswith(losses[-1].remedy)


def test_a_round_learnt_in_between_makes_the_next_loss_the_first_again() -> None:
    restarts = learner_link.LearnerRestarts()
    for _ in range(10):
        assert restarts.explain_end(DIVERGED) == ""
        restarts.add(DIVERGED)
        restarts.reset()


def test_a_timeout_counts_the_time_that_somebody_looked_on() -> None:
    now_s = [0.0]
    timeout = Timeout(3.0, lambda: now_s[0])
    for _ in range(3):
        now_s[0] += 1.0
        assert not timeout.has_expired()
    now_s[0] += 0.5
    assert timeout.has_expired()
    timeout.restart()
    assert not timeout.has_expired()


@pytest.mark.fault("SIGSTOP of the services")
def test_who_stood_still_does_not_hold_that_against_others() -> None:
    now_s = [0.0]
    timeout = Timeout(3.0, lambda: now_s[0])
    for _ in range(3):
        now_s[0] += 86_400.0
        assert not timeout.has_expired()
    now_s[0] += 0.1
    assert timeout.has_expired()


def layer(value: float = 0.5) -> Layer:
    return Layer(np.full((2, 3), value, np.float32), np.zeros(2, np.float32))


def proposed(policy: Policy | None = None, z: float = 0.0, **told) -> Proposed:
    """A round of each kind of source."""
    noise = TrajectorySource(np.full((4, 2), z, np.float32))
    sources = (PriorSource(), PolicySource(7), noise)
    tasks = tuple(EpisodeTask(index, 0, source) for index, source in enumerate(sources))
    whole = policy or Policy(7, (layer(),), layer(), layer(), 3.0, 1)
    return Proposed((Round(0, tasks, whole),), b"", **told)


ESTIMATE = Estimate(by="a toy", episodes=3, probability=0.5, interval=Interval(0.1, 0.9))


def test_what_holds_numbers_alone_passes_and_so_does_all_else() -> None:
    for message in (proposed(), proposed(estimate=ESTIMATE), Proposed((), b""), Trouble("It is.")):
        assert learner_link.check_numbers(message) is message


@pytest.mark.fault("NaN or infinity in a learner")
@pytest.mark.parametrize(
    ("message", "what"),
    [
        (proposed(Policy(7, (layer(nan),), layer(), layer(), 3.0, 1)), "Policy 7"),
        (proposed(Policy(7, (), layer(-inf), layer(), 3.0, 1)), "Policy 7"),
        (proposed(Policy(7, (), layer(), layer(nan), 3.0, 1)), "Policy 7"),
        (proposed(Policy(7, (), layer(), layer(), inf, 1)), "Policy 7"),
        (proposed(z=nan), "episode 2"),
        (proposed(estimate=msgspec.structs.replace(ESTIMATE, probability=nan)), "estimate"),
        (proposed(estimate=msgspec.structs.replace(ESTIMATE, cv=inf)), "estimate"),
        (proposed(estimate=Estimate(by="", episodes=3, interval=Interval(0.0, nan))), "estimate"),
    ],
)
def test_what_holds_another_is_of_a_learner_that_diverged(message, what) -> None:
    told = learner_link.check_numbers(message)
    assert isinstance(told, Diverged)
    assert what in told.problem
    assert "NaN or infinite" in told.problem
    assert "learning rate" in told.remedy
