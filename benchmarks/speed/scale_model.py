"""Episodes per second of a service with many workers: a simulated queueing network.

Pure: costs in, a rate out. Workers run one episode at a time, and take the next one as soon as they
are through. A result waits for the hub, and then for the group that it is committed with. A round
that is whole goes to the learner, which proposes the next as far as its method looks ahead.

`limits` are the bounds that no schedule can exceed (operational analysis: Denning and Buzen 1978,
Computing Surveys 10:3); the simulation says what is left of them once everybody waits for others.
"""

from collections.abc import Callable
from math import inf

import msgspec
from benchmarks.speed.scale_parts import GROUP, TURN, Costs, Method, WorkerPool
from benchmarks.speed.scale_simulation import Play

SATURATED = 0.95
"""Who works for so much of the time holds up all the others."""

ROUNDS = "rounds"
"""The bottleneck where nobody works all the time: they wait for each other, from round to round."""


class Prediction(msgspec.Struct, frozen=True):
    """A rate, and who stands in the way of a higher one.

    Attributes:
        use: how much of the time each part is at work.
    """

    episodes_per_s: float
    bottleneck: str
    use: dict[str, float]


def limits(method: Method, pool: WorkerPool, costs: Costs) -> dict[str, float]:
    """What each part could do if it never waited for another. [episodes/s]"""
    free = max(1e-9, 1.0 - pool.workers * costs.heartbeat_s)
    largest_group = GROUP - 1 + TURN  # A turn's results are added to a group that is not full yet.
    hub_s = (
        costs.result_s + costs.commit_s / largest_group + method.checkpoint_s / method.round_size
    )
    turn_s = pool.episode_s + costs.result_s + costs.commit_s + method.round_s
    return {
        "workers": divide(pool.workers, pool.episode_s),
        "hub": divide(free, hub_s),
        "learner": divide(method.round_size, method.round_s),
        ROUNDS: divide((method.lookahead + 1) * method.round_size, turn_s),
        "network": divide(costs.wire_bytes_per_s, costs.wire_bytes),
        "disk": divide(costs.disk_bytes_per_s, costs.disk_bytes),
    }


def divide(amount: float, by: float) -> float:
    """A rate; without end where nothing is asked."""
    return amount / by if by > 0.0 else inf


def predict(
    method: Method,
    pool: WorkerPool,
    costs: Costs,
    rounds: int,
    draw: Callable[[], float] | None = None,
) -> Prediction:
    """Play so many rounds, and more than half of them for the figures.

    A rate from rounds that are not endless may lie above a bound; it is then the bound.

    Args:
        draw: an episode's time [s]; by default all take `pool.episode_s`.
    """
    play = Play(method, pool, costs, draw or (lambda: pool.episode_s))
    play.run(rounds)
    bounds = limits(method, pool, costs)
    rate = min(play.rate, *bounds.values())
    heartbeats = min(1.0, pool.workers * costs.heartbeat_s)
    # The play stretches the hub's other work by what the heartbeats take meanwhile.
    hub_share = play.hub_share * (1.0 - heartbeats) + heartbeats
    use = {
        "workers": rate / bounds["workers"],
        "hub": min(1.0, max(hub_share, rate / bounds["hub"])),
        "learner": rate / bounds["learner"],
        "network": rate / bounds["network"],
        "disk": rate / bounds["disk"],
    }
    busiest = max(use, key=lambda part: use[part])
    return Prediction(rate, busiest if use[busiest] >= SATURATED else ROUNDS, use)
