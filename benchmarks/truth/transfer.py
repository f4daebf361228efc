"""Figures: whether a policy of AST fails the planner elsewhere, from ten seeds: worst and median.

One policy is the best of those that `examples/transfer.toml` trains over a distribution of the
scenario. The others are trained at its defaults, by `RECIPES`. All are then used without learning,
over `JUDGED` and at `PLACES`, where the initial gap is always the scenario's default.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import log, pi
from types import MappingProxyType
from typing import Any, NamedTuple

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import ROOT, Figure
from benchmarks.learning_figures import each, of_seeds
from benchmarks.samples import COMMAND
from benchmarks.searches import Crash, evaluations, side_by_side

from eigenfail.values.campaign_spec import CampaignSpec

SEEDS, EPISODES, DRAWN = 10, 40, 100

OFFSET = 40_079
"""First seed of the policies less the seed of the claims: no policy of 20301201 to 20301210 was
looked at while the settings and the places were chosen."""

EXAMPLE = ROOT / "examples" / "transfer.toml"

PLACES: dict[str, tuple[float, ...]] = {
    "distance_m": (52.0, 55.0, 58.0, 61.0, 64.0),
    "actor_speed_mps": (12.0, 13.25, 14.0),
    "ego_speed_mps": (22.0, 23.0, 25.0),
}
"""One parameter differs from its default, by at most 6 m, 1.5 m/s and 2 m/s: as far as the
scenario's bounds allow, which are 12 m/s for the car and 25 m/s for the truck."""

LONG: Mapping[str, float] = MappingProxyType({"duration_s": 14.0})
"""Duration of the episodes that judge. By default they last 10 s: from the initial gap of 94 m the
slowest truck would reach the default car after 9.9 s, and only if it never braked. Draws with a
faster car need up to 11.75 s."""

JUDGED: Mapping[str, Any] = MappingProxyType(
    {
        "distance_m": {"uniform": [52.0, 64.0]},
        "actor_speed_mps": {"uniform": [12.0, 14.0]},
        "ego_speed_mps": {"uniform": [22.0, 25.0]},
    }
)
"""The range of the place "drawn". The example trains with shorter initial gaps too, and more
often with a slow truck: these are not judged."""


class Share(NamedTuple):
    """Episodes that failed, of those of a policy at one place."""

    failed: int
    episodes: int

    @property
    def value(self) -> float:
        """Failures ÷ episodes."""
        return self.failed / self.episodes


class Transfer(NamedTuple):
    """What one policy does: its share of failures at each place, and its failures."""

    shares: dict[str, Share]
    crashes: tuple[Crash, ...]

    def find_worst(self) -> str:
        """Return the place with the smallest share."""
        return min(self.shares, key=lambda place: self.shares[place].value)


def over_a_distribution(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The policy of `examples/transfer.toml`."""
    found = list_transfers(pool, read_example(), list_seeds(seed))
    yield from find_worst_places("ast.transfer", found, seed)
    yield from summarize("ast.transfer", found)


RECIPES: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {"default": {}, "alpha_600": {"alpha": 600.0}}
)
"""Settings of a policy that is trained at the scenario's defaults: a near miss costs twice as much
with the second one."""


def from_one_scenario(name: str, pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """A policy of one of the recipes, trained at the scenario's defaults."""
    settings = dict(RECIPES[name])
    spec = CampaignSpec(
        name="ast", method="ast", episodes=1000, scenario="cut_in", settings=settings
    )
    found = list_transfers(pool, spec, list_seeds(seed))
    yield from find_worst_places(f"ast.transfer_{name}", found, seed)
    yield from summarize(f"ast.one_scenario_{name}", found)


def find_worst_places(
    prefix: str, found: Sequence[Transfer], seed: int
) -> Iterator[tuple[str, Figure]]:
    """The share at the worst place of each policy: the smallest and the median of the seeds."""
    worst = [one.shares[one.find_worst()].value for one in found]
    median = of_seeds(worst, "share", EPISODES)
    places = ", ".join(one.find_worst() for one in found)
    note = (
        f"worst of the seeds {name_seeds(seed)}, at the worst of {len(found[0].shares)} places: "
        f"{', '.join(f'{value:.4g}' for value in worst)}; at {places}"
    )
    yield f"{prefix}_worst", msgspec.structs.replace(median, value=min(worst), note=note)
    yield f"{prefix}_median", median


def list_seeds(seed: int) -> range:
    """Return the seeds of the policies, given that of the claims."""
    return range(seed + OFFSET, seed + OFFSET + SEEDS)


def list_transfers(pool: EpisodePool, spec: CampaignSpec, seeds: range) -> list[Transfer]:
    """Train a policy from each seed, and evaluate it at all places."""
    specs = [msgspec.structs.replace(spec, seed=seed) for seed in seeds]
    trained = side_by_side(pool, specs)
    runs = {
        f"{name} {value:g}": evaluations(pool, trained, EPISODES, **{name: value, **LONG})
        for name, values in PLACES.items()
        for value in values
    }
    runs["drawn"] = evaluations(pool, trained, DRAWN, **JUDGED, **LONG)
    return [
        Transfer(
            shares={
                place: Share(sum(at[i].crashed), len(at[i].crashed)) for place, at in runs.items()
            },
            crashes=tuple(crash for at in runs.values() for crash in at[i].crashes),
        )
        for i in range(len(seeds))
    ]


def name_seeds(seed: int) -> str:
    """Return the first and the last seed of the policies, as "1 to 10"."""
    seeds = list_seeds(seed)
    return f"{seeds[0]} to {seeds[-1]}"


def read_example() -> CampaignSpec:
    """The campaign of the example."""
    return msgspec.toml.decode(EXAMPLE.read_bytes(), type=CampaignSpec)


def summarize(prefix: str, found: Sequence[Transfer]) -> Iterator[tuple[str, Figure]]:
    """The share at each place, smallest and median of the seeds; how likely the failures are."""
    for place in found[0].shares:
        shares = [one.shares[place] for one in found]
        values = [share.value for share in shares]
        name = place.replace("_mps", "").replace("_m", "").replace(" ", "_")
        n = sum(share.episodes for share in shares)
        yield (
            f"{prefix}.{name}",
            Figure(
                value=min(values),
                unit="share",
                n=n,
                spread=(min(values), max(values)),
                note=f"worst of the seeds; {each(values)}",
                command=COMMAND,
            ),
        )
    n = sum(len(one.crashes) for one in found)
    yield f"{prefix}.log_p_per_step", of_seeds([compute_log_p(one) for one in found], "nat", n)
    in_sigma = [compute_log_p_of_z(one) for one in found]
    yield f"{prefix}.log_p_z_per_step", of_seeds(in_sigma, "nat", n)


def compute_log_p(one: Transfer) -> float:
    """log p of the failures over all of their steps ÷ steps."""
    steps = sum(len(crash.z) for crash in one.crashes)
    return sum(crash.log_probability for crash in one.crashes) / steps


def compute_log_p_of_z(one: Transfer) -> float:
    """The same of z, standard normal under p: −2.838 for noise from p."""
    steps = sum(len(crash.z) for crash in one.crashes)
    squares = sum(float(np.square(crash.z, dtype=np.float64).sum()) for crash in one.crashes)
    return -0.5 * squares / steps - log(2.0 * pi)
