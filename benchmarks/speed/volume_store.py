"""A million episodes with all that is kept of them, brought in by the store's own commits."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing

import msgspec
import numpy as np

from eigenfail.values.arrays import Floats
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery
from eigenfail.values.scene import Scene
from eigenfail_services.campaigns.validation import check_spec
from eigenfail_services.store.store import Store, open_store

CAMPAIGNS = 5
LARGEST_SHARE = 2
"""One episode in so many is in the first campaign; the others have equal parts of the rest."""

STEPS = 100
GROUP = 256
"""Results in one commit, as the hub groups them when they come fast."""

FAILURES = 0.02
SCENE_EVERY = 50
MADE = 4_096
"""Results that are made one by one; the others are copies of these under their own numbers."""

PER_GROUP_OF_SPEED = 100
"""Commits over which the rate is taken, to see whether it falls as the database grows."""


class Filled(msgspec.Struct, frozen=True):
    """What the filling took.

    Attributes:
        commits_s: time in commits, without the making of results.
        rates: episodes per second of commits, over parts of equal size, in order.
    """

    commits_s: float
    rates: tuple[float, ...]


def sizes_of(total: int) -> list[int]:
    """Episodes of each campaign."""
    first = total // LARGEST_SHARE
    each = (total - first) // (CAMPAIGNS - 1)
    return [total - each * (CAMPAIGNS - 1), *[each] * (CAMPAIGNS - 1)]


def fill(address: str, total: int) -> Filled:
    """Fill an empty database; all campaigns are done afterwards."""
    made, times = results(), list[tuple[int, float]]()
    with closing(open_store(address)) as store:
        for number, size in enumerate(sizes_of(total)):
            times += filled(store, number, size, made)
    return Filled(sum(took for _, took in times), tuple(rates(times)))


def filled(
    store: Store, number: int, size: int, made: Sequence[EpisodeResult]
) -> Iterator[tuple[int, float]]:
    """One campaign from its beginning to its end: how many were committed, and how long it took."""
    spec = CampaignSpec(name=f"volume {number}", method="monte_carlo", episodes=size, seed=number)
    campaign = store.campaigns.create(check_spec(spec)).id
    store.campaigns.move(campaign, CampaignState.RUNNING)
    for first in range(0, size, GROUP):
        group = [delivery(made, index) for index in range(first, min(size, first + GROUP))]
        yield len(group), seconds(lambda group=group: store.episodes.commit(campaign, group))
    store.campaigns.move(campaign, CampaignState.DONE)


def delivery(made: Sequence[EpisodeResult], index: int) -> Delivery:
    """An episode, as a worker brings it."""
    copied = msgspec.structs.replace(made[index % len(made)], index=index, seed=index)
    return Delivery(copied, f"worker-{index // GROUP % 8}")


def seconds(work: Callable[[], object]) -> float:
    """How long it takes."""
    before = time.perf_counter()
    work()
    return time.perf_counter() - before


def rates(times: Sequence[tuple[int, float]]) -> Iterator[float]:
    """Episodes per second over parts of equal size."""
    for first in range(0, len(times), PER_GROUP_OF_SPEED):
        part = times[first : first + PER_GROUP_OF_SPEED]
        yield sum(count for count, _ in part) / sum(took for _, took in part)


def results() -> list[EpisodeResult]:
    """What episodes look like."""
    generator = np.random.default_rng(0)
    return [made(generator, index) for index in range(MADE)]


def made(generator: np.random.Generator, index: int) -> EpisodeResult:
    """One result; failures and a sample of the others have a scene."""
    crashed = bool(generator.random() < FAILURES)
    z, sigma = numbers(generator, STEPS, 2), 1.0 + np.abs(numbers(generator, STEPS, 2))
    return EpisodeResult(
        index=index,
        seed=index,
        outcome=Outcome.COLLISION if crashed else Outcome.SAFE,
        steps=STEPS,
        noise=NoiseTrajectory(z, sigma),
        source="prior",
        measures=crash(generator) if crashed else drive(generator),
        scene=scene(generator) if crashed or index % SCENE_EVERY == 0 else None,
        wall_s=float(generator.gamma(8.0, 0.002)),
    )


def numbers(generator: np.random.Generator, *shape: int) -> Floats:
    """Noise that nothing compresses."""
    return generator.standard_normal(shape).astype(np.float32)


def scene(generator: np.random.Generator) -> Scene:
    """The full course of an episode with two vehicles."""
    return Scene(
        dt_s=0.1,
        vehicles=numbers(generator, STEPS + 1, 2, 4),
        sizes=numbers(generator, 2, 2),
        perceived=numbers(generator, STEPS, 2),
        controls=numbers(generator, STEPS, 2),
    )


def crash(generator: np.random.Generator) -> Measures:
    """What is measured over an episode with a collision."""
    collided_s = float(generator.uniform(4.0, 9.0))
    return Measures(
        robustness_m=0.0,
        severity=float(generator.gamma(9.0, 12.0)),
        min_ttc_s=float(generator.uniform(0.1, 0.8)),
        max_drac_mps2=float(generator.uniform(5.0, 9.0)),
        ttc_violated_s=collided_s - 1.5,
        drac_violated_s=collided_s - 0.3,
        drac_at_warning_mps2=float(generator.uniform(3.0, 9.0)),
        collided_s=collided_s,
    )


def drive(generator: np.random.Generator) -> Measures:
    """What is measured over an episode without one."""
    return Measures(
        robustness_m=float(generator.gamma(4.0, 1.6)),
        min_ttc_s=float(generator.uniform(1.0, 6.0)),
        max_drac_mps2=float(generator.uniform(0.3, 2.0)),
        max_jerk_mps3=4.0,
        hard_brakings=0,
        clipped_steps=0,
    )
