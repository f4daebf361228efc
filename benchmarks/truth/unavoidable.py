"""Figures: which collisions of a loaded truck were unavoidable by its own brakes.

The scenario is `cut_in` with a truck whose brakes do 3.2 m/s², and, to compare, the default truck
with the paper's 7.0 m/s².
"""

from collections.abc import Iterator, Mapping

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool, make_setup
from benchmarks.figures import Figure
from benchmarks.learning_figures import count_failures, of_seeds
from benchmarks.samples import COMMAND, count_share
from benchmarks.searches import Found, search
from benchmarks.truth.undisturbed import FIXED, Drive, drive

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import ConflictClass
from eigenfail_workers.scenarios.cut_in import CutInParameters

LOADED = {"peak_braking_mps2": 3.2}
"""Own choice: a heavily loaded truck, or a wet road."""

METHODS = ("held", "cma", "ast")
SEEDS, EPISODES, DRAWN, PARTS = 5, 1000, 2000, 8


def find(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The undisturbed drive, Monte Carlo, and the share of each method's collisions."""
    calm = [one.collided for one in play_undisturbed(pool, seed)]
    yield "unavoidable.undisturbed.collisions", count_share(calm)
    specs = [make_spec("monte_carlo", DRAWN // PARTS, seed + part, LOADED) for part in range(PARTS)]
    collisions, n = count_failures(pool.each(search, specs))
    note = f"seeds {seed} to {seed + PARTS - 1}"
    drawn = Figure(value=float(collisions), unit="episodes", n=n, note=note, command=COMMAND)
    yield "unavoidable.mc2000.collisions", drawn
    for name, brakes in {"share": LOADED, "paper_brakes": {}}.items():
        for method in METHODS:
            specs = [make_spec(method, EPISODES, seed + i, brakes) for i in range(SEEDS)]
            found = pool.each(search, specs)
            each = ", ".join(str(len(one.crashes)) for one in found)
            shares = [find_share(one) for one in found]
            figure = of_seeds(shares, "share", EPISODES, f"; of {each} collisions")
            yield f"unavoidable.{name}.{method}", figure


def find_share(found: Found) -> float | None:
    """The share of unavoidable collisions; None without a collision."""
    hopeless = [crash.conflict is ConflictClass.UNAVOIDABLE for crash in found.crashes]
    return sum(hopeless) / len(hopeless) if hopeless else None


def make_spec(method: str, episodes: int, seed: int, brakes: Mapping[str, float]) -> CampaignSpec:
    """A campaign of a method with its default settings."""
    return CampaignSpec(
        name="unavoidable",
        method=method,
        episodes=episodes,
        seed=seed,
        scenario="cut_in",
        scenario_parameters=dict(brakes),
    )


def play_undisturbed(pool: EpisodePool, seed: int) -> list[Drive]:
    """Runs without noise at points drawn uniformly within the bounds of the scenario."""
    schema = msgspec.json.schema(CutInParameters)["$defs"]["CutInParameters"]["properties"]
    ends = {
        n: (field["minimum"], field["maximum"]) for n, field in schema.items() if n not in FIXED
    }
    random = np.random.default_rng(seed)
    points = [{name: random.uniform(*ends[name]) for name in ends} for _ in range(DRAWN)]
    setups = [make_setup("cut_in", "rulebook", **point | LOADED) for point in points]
    return pool.each(drive, map(msgspec.json.encode, setups))
