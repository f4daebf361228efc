"""When a learner that is lost may begin again, for how long it is waited, and what it may say."""

from math import inf, nan

import msgspec
import numpy as np
import pytest

from eigenfail.values import (
    EpisodeTask,
    Estimate,
    Interval,
    Layer,
    Policy,
    PolicySource,
    PriorSource,
    Round,
    TrajectorySource,
)
from eigenfail.wire.messages import Diverged, Proposed, Trouble
from eigenfail_services.hub.losses import Kind, Loss, Losses, died, hung
from eigenfail_services.hub.patience import Patience
from eigenfail_services.hub.soundness import sound

DIED, HUNG = died(-9), hung(60.0)
DIVERGED = Loss(Kind.DIVERGED, "It diverged.", "Lower learning_rate.")


def ended_with(*losses: Loss) -> str:
    """What the last one of some losses in a row ends a campaign with."""
    counted = Losses()
    for loss in losses[:-1]:
        assert counted.end_with(loss) == ""
        counted.add(loss)
    return counted.end_with(losses[-1])


def test_the_next_life_waits_longer_with_each_loss_and_not_at_all_after_a_round() -> None:
    losses, pauses_s = Losses(), []
    for _ in range(4):
        pauses_s.append(losses.pause_s)
        losses.add(DIED)
    assert pauses_s == [0.0, 1.0, 5.0, 5.0]
    losses.forget()
    assert losses.pause_s == 0.0


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
    assert f"lost {times} times in a row" in told
    assert told.endswith(losses[-1].remedy)


def test_a_round_learnt_in_between_makes_the_next_loss_the_first_again() -> None:
    losses = Losses()
    for _ in range(10):
        assert losses.end_with(DIVERGED) == ""
        losses.add(DIVERGED)
        losses.forget()


def test_patience_counts_the_time_that_somebody_looked_on() -> None:
    now_s = [0.0]
    patience = Patience(3.0, lambda: now_s[0])
    for _ in range(3):
        now_s[0] += 1.0
        assert not patience.is_over()
    now_s[0] += 0.5
    assert patience.is_over()
    patience.renew()
    assert not patience.is_over()


def test_who_stood_still_does_not_hold_that_against_others() -> None:
    now_s = [0.0]
    patience = Patience(3.0, lambda: now_s[0])
    for _ in range(3):
        now_s[0] += 86_400.0
        assert not patience.is_over()
    now_s[0] += 0.1
    assert patience.is_over()


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
        assert sound(message) is message


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
    told = sound(message)
    assert isinstance(told, Diverged)
    assert what in told.problem
    assert "NaN or infinite" in told.problem
    assert "learning rate" in told.remedy
