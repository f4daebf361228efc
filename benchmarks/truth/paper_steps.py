"""Figures: cut-in with the paper's number of steps, with all noise and with three quarters of it.

The campaign is `examples/paper_steps.toml`. Noise that is not learnt is drawn from p(x), held for a
second (`held`), or uniform within the amplitude of `ast` and held for a second.
"""

from collections.abc import Iterator, Sequence
from statistics import fmean, median

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import ROOT, Figure
from benchmarks.learning_figures import failure_rate, of_seeds
from benchmarks.samples import COMMAND, share
from benchmarks.searches import Found, count_steps, list_evaluations, search
from benchmarks.truth.shapes import draw_held_noise

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, TrajectorySource

EXAMPLE = ROOT / "examples" / "paper_steps.toml"

SCALES = {"all": 1.0, "less": 0.75}
WHITE, HELD, UNIFORM = {"all": 3500, "less": 1500}, 1500, 500
PART = 250
"""Episodes of one campaign without learning. These campaigns run side by side."""

SEEDS, EVALUATED = 5, 100


def find_steps(_pool: EpisodePool, _seed: int) -> Iterator[tuple[str, Figure]]:
    """The number of steps of an episode."""
    steps = count_steps(read_example())
    yield "paper.steps", Figure(value=steps, unit="steps", n=1, command=COMMAND)


def find_figures(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Noise without learning at both scales, and what `ast` finds with less noise."""
    spec = msgspec.structs.replace(read_example(), seed=seed)
    steps = count_steps(spec)
    for name, scale in SCALES.items():
        yield from describe_noise(pool, name, scale_noise(spec, scale), steps)
    yield from describe_ast(pool, spec)


def read_example() -> CampaignSpec:
    """The campaign of the example."""
    return msgspec.toml.decode(EXAMPLE.read_bytes(), type=CampaignSpec)


def scale_noise(spec: CampaignSpec, scale: float) -> CampaignSpec:
    """The campaign with another share of the sensor's noise."""
    disturbance = msgspec.structs.replace(spec.disturbance, scale=scale)
    return msgspec.structs.replace(spec, disturbance=disturbance)


def describe_noise(
    pool: EpisodePool, name: str, spec: CampaignSpec, steps: int
) -> Iterator[tuple[str, Figure]]:
    """How often noise without learning fails, and how likely the failures are."""
    place = f"paper_steps.{name}"
    undisturbed = TrajectorySource(np.zeros((0, 2), np.float32))
    (calm,) = pool.play(spec.setup(), [EpisodeTask(0, 0, undisturbed)])
    least_m = calm.measures.robustness_m
    yield f"{place}.undisturbed_m", Figure(value=least_m, unit="m", n=1, command=COMMAND)
    white = play_parts(pool, spec, "monte_carlo", WHITE[name])
    yield f"{place}.white.failure_rate", share([one for part in white for one in part.crashed])
    log_p = fmean(part.log_p_per_step for part in white) * steps
    n = sum(len(part.crashed) for part in white)
    yield f"{place}.white.log_p", Figure(value=log_p, unit="nat", n=n, command=COMMAND)
    held = play_parts(pool, spec, "held", HELD, hold=spec.settings["hold"])
    yield f"{place}.held.failure_rate", share([one for part in held for one in part.crashed])
    yield from describe_failures(f"{place}.held", held)
    noise = draw_held_noise(
        np.random.default_rng(spec.seed),
        UNIFORM,
        steps,
        sigma=spec.settings["amplitude"],
        hold=spec.settings["hold"],
    )
    records = pool.inject(spec.setup(), noise)
    yield f"{place}.uniform.failure_rate", share([one.is_failure for one in records])


def play_parts(
    pool: EpisodePool, spec: CampaignSpec, method: str, episodes: int, **settings: int
) -> list[Found]:
    """Campaigns of a method that does not learn, each with a seed of its own."""
    specs = [
        msgspec.structs.replace(
            spec, method=method, settings=settings, episodes=PART, seed=spec.seed + part
        )
        for part in range(episodes // PART)
    ]
    return pool.each(search, specs)


def describe_failures(place: str, runs: Sequence[Found]) -> Iterator[tuple[str, Figure]]:
    """Log p and severity of all failures of some campaigns; nothing without a failure."""
    crashes = [crash for one in runs for crash in one.crashes]
    for name, unit, values in (
        ("log_p", "nat", [crash.log_probability for crash in crashes]),
        ("severity", "m²/s²", [crash.severity for crash in crashes]),
    ):
        if values:
            yield (
                f"{place}.{name}",
                Figure(
                    value=median(values),
                    unit=unit,
                    n=len(values),
                    spread=(min(values), max(values)),
                    command=COMMAND,
                ),
            )


def describe_ast(pool: EpisodePool, spec: CampaignSpec) -> Iterator[tuple[str, Figure]]:
    """What the example finds from each of some seeds, in training and without more of it."""
    specs = [msgspec.structs.replace(spec, seed=spec.seed + i) for i in range(SEEDS)]
    trained = pool.each(search, specs)
    evaluated = pool.each(search, list_evaluations(trained, EVALUATED), trained)
    for name, runs in (("train", trained), ("evaluation", evaluated)):
        place, n = f"paper_steps.ast.{name}", len(runs[0].crashed)
        shares = [failure_rate(one) for one in runs]
        yield f"{place}.failure_rate", of_seeds(shares, "share", n)
        log_p = [
            fmean(crash.log_probability for crash in one.crashes) if one.crashes else None
            for one in runs
        ]
        yield f"{place}.log_p", of_seeds(log_p, "nat", n)
