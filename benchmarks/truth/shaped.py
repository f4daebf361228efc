"""Figures: `rulebook` on cut_in under noise with a shape, and without, at three distances."""

from collections.abc import Iterator, Mapping, Sequence
from statistics import fmean

import numpy as np
from benchmarks.episode_pool import EpisodePool, EpisodeRecord, horizon, make_setup
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND, count_share, mean, share
from benchmarks.truth.shapes import Array, draw_held_noise, shuffles, square_wave, square_waves

from eigenfail import plugins

PLACE = "cut_in.rulebook"
RUNS, SHUFFLES = 300, 100
SHAPED = ("held3", "held2", "square3")
ENUMERATED = ("square3", "wave2")
"""Fixed trajectories, all of which are run: no samples, so that their figures have no interval."""
DISTANCES_M = {"": 0.0, "_minus_5m": -5.0, "_plus_5m": 5.0}


def shaped(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Rates and mean severities of each kind of noise, and of what has a shape together."""
    cut_in = plugins.load(plugins.SCENARIOS, "cut_in")
    kinds = noises(horizon("cut_in"), seed)
    for place, offset_m in DISTANCES_M.items():
        distance_m = cut_in.Parameters().distance_m + offset_m
        setup = make_setup("cut_in", "rulebook", distance_m=distance_m)
        played = {kind: pool.inject(setup, z) for kind, z in kinds.items()}
        yield from rates(played, place)
        if not place:
            yield from severities(played)


def noises(steps: int, seed: int) -> dict[str, Array]:
    """The trajectories of each kind, shape (n, steps, 2); the same ones at every distance."""
    rng = np.random.default_rng(seed)
    wave = square_wave(steps, sigma=2.0, half_period=20)
    return {
        "held3": draw_held_noise(rng, RUNS, steps, sigma=3.0, hold=5),
        "held2": draw_held_noise(rng, RUNS, steps, sigma=2.0, hold=5),
        "white3": draw_held_noise(rng, RUNS, steps, sigma=3.0, hold=1),
        "white2": draw_held_noise(rng, RUNS, steps, sigma=2.0, hold=1),
        "square3": square_waves(steps, sigma=3.0),
        "wave2": wave[None],
        "wave2_shuffled": shuffles(rng, wave, SHUFFLES),
    }


def rates(
    played: Mapping[str, Sequence[EpisodeRecord]], place: str
) -> Iterator[tuple[str, Figure]]:
    """The share of crashes of each kind."""
    for kind, runs in played.items():
        count = count_share if kind in ENUMERATED else share
        yield f"{PLACE}.{kind}.rate{place}", count([one.is_failure for one in runs])


def severities(played: Mapping[str, Sequence[EpisodeRecord]]) -> Iterator[tuple[str, Figure]]:
    """The mean severity of the crashes of each kind that has any."""
    for kind, runs in played.items():
        if found := crashes(runs):
            average = average_severity if kind in ENUMERATED else mean
            yield f"{PLACE}.{kind}.mean_severity", average(found, "m²/s²")
    together = [severity for kind in SHAPED for severity in crashes(played[kind])]
    note = f"all crashes of {', '.join(SHAPED)} at the default distance, by how many were run"
    yield "cut_in.shaped.mean_severity", average_severity(together, "m²/s²", note)
    run = sum(len(played[kind]) for kind in SHAPED)
    note = "of the same crashes; n: how many were run"
    count = Figure(value=len(together), unit="crashes", n=run, note=note, command=COMMAND)
    yield "cut_in.shaped.crashes", count


def average_severity(severities: Sequence[float], unit: str, note: str = "") -> Figure:
    """The mean severity of crashes that are no sample: without interval."""
    value = fmean(severities) if severities else None
    return Figure(value=value, unit=unit, n=len(severities), note=note, command=COMMAND)


def crashes(runs: Sequence[EpisodeRecord]) -> list[float]:
    """The severities of those that crashed."""
    return [one.measures.severity for one in runs if one.measures.severity is not None]
