"""A learner's estimate leaves its process with the rounds and the checkpoint it belongs to."""

from math import sqrt

import numpy as np

from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeFault, EpisodeResult, Outcome, unrunnable
from eigenfail.values.learning import LearnerContext
from eigenfail.values.measures import Measures
from eigenfail.wire.messages import Start, encode, read_learner_message
from eigenfail_services.hub.learner_process import create_rounds, make_proposal


def start(method, checkpoint=None, **settings):
    context = LearnerContext(6, 400, 4, np.zeros((0, 4, 2), np.float32))
    return Start(method, settings, context, 5, checkpoint)


def result(task):
    """Fails where the noise sums to more than 1 sigma."""
    z = task.source.z
    robustness = max(1.0 - float(z.sum()) / sqrt(z.size), 0.0)
    return EpisodeResult(
        index=task.index,
        seed=task.seed,
        outcome=Outcome.SAFE if robustness else Outcome.COLLISION,
        steps=len(z),
        noise=NoiseTrajectory(z, np.ones_like(z)),
        source=task.source_kind,
        measures=Measures(robustness),
    )


def told(rounds):
    """What the hub hears."""
    return read_learner_message(encode(make_proposal(rounds)))


def test_what_a_learner_knows_travels_with_what_it_proposes() -> None:
    rounds = create_rounds(start("subset", samples=100))
    first = told(rounds)
    assert first.estimate is None
    last = first
    while last.rounds:
        rounds.complete([result(task) for task in last.rounds[0].tasks])
        last = told(rounds)
    assert last.estimate == rounds.estimate()
    assert last.estimate.interval.low < 0.1587 < last.estimate.interval.high


def test_a_restored_learner_tells_what_it_told() -> None:
    rounds = create_rounds(start("cem", batch=100))
    for _ in range(3):
        rounds.complete([result(task) for task in told(rounds).rounds[0].tasks])
    last = told(rounds)
    again = told(create_rounds(start("cem", last.checkpoint, batch=100)))
    assert last.estimate is not None
    assert again.estimate == last.estimate


def test_a_learner_that_tells_nothing_is_none_the_worse() -> None:
    rounds = create_rounds(start("monte_carlo"))
    fault = EpisodeFault("simulator", "test")
    rounds.complete([unrunnable(task, fault) for task in told(rounds).rounds[0].tasks])
    assert told(rounds).estimate is None
