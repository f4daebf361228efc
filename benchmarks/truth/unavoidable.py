"""Figures: which collisions of a loaded truck were unavoidable by its own brakes.

The scenario is `cut_in` with a truck whose brakes do 3.2 m/s², and, to compare, the default truck
with the paper's 7.0 m/s².
"""

from collections import Counter
from collections.abc import Iterator

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool, make_setup
from benchmarks.figures import Figure
from benchmarks.learning_figures import of_seeds
from benchmarks.samples import COMMAND, count_share
from benchmarks.searches import context, count_steps
from benchmarks.truth.undisturbed import DURATIONS, Drive, drive

from eigenfail import plugins
from eigenfail.settings import read_settings
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import ConflictClass, assess
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_workers.engine import Engine
from eigenfail_workers.scenarios.cut_in import CutInParameters

LOADED = {"peak_braking_mps2": 3.2}
"""A loaded truck brakes with 3 to 4 m/s²."""

METHODS = ("held", "cma", "difs", "ast")
SEEDS, EPISODES, DRAWN, PARTS = 5, 1000, 2000, 8


def find(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The undisturbed drive, Monte Carlo, and the share of each method's collisions."""
    calm = [one.collided for one in play_undisturbed(pool, seed)]
    yield "unavoidable.undisturbed.collisions", count_share(calm)
    specs = [make_spec("monte_carlo", DRAWN // PARTS, seed + part) for part in range(PARTS)]
    white = sum(pool.each(count_classes, specs), Counter[str]())
    note = f"seeds {seed} to {seed + PARTS - 1}"
    drawn = Figure(value=float(white.total()), unit="episodes", n=DRAWN, note=note, command=COMMAND)
    yield "unavoidable.mc2000.collisions", drawn
    for name, brakes in {"share": LOADED, "paper_brakes": {}}.items():
        for method in METHODS:
            specs = [make_spec(method, EPISODES, seed + i, brakes) for i in range(SEEDS)]
            found = pool.each(count_classes, specs)
            shares = [find_share(each) for each in found]
            collisions = ", ".join(str(each.total()) for each in found)
            figure = of_seeds(shares, "share", EPISODES, f"; of {collisions} collisions")
            yield f"unavoidable.{name}.{method}", figure


def find_share(classes: Counter[str]) -> float | None:
    """The share of unavoidable collisions; None without a collision."""
    return classes[ConflictClass.UNAVOIDABLE] / classes.total() if classes else None


def make_spec(
    method: str, episodes: int, seed: int, brakes: dict[str, float] = LOADED
) -> CampaignSpec:
    """A campaign of a method with its default settings."""
    return CampaignSpec(
        name="unavoidable",
        method=method,
        episodes=episodes,
        seed=seed,
        scenario="cut_in",
        scenario_parameters=brakes,
    )


def count_classes(spec: CampaignSpec) -> Counter[str]:
    """Count the collisions of a campaign by their class."""
    method = plugins.load(plugins.METHODS, spec.method)
    settings = read_settings(method.Settings, spec.settings, "settings")
    learner = method(context(spec, count_steps(spec), None), settings)
    results = run_in_process(Rounds(learner, spec.seed, spec.episodes), Engine(spec.setup()))
    classes = (assess(one.outcome, one.measures).conflict for one in results if one.is_failure)
    return Counter(str(each) for each in classes)


def play_undisturbed(pool: EpisodePool, seed: int) -> list[Drive]:
    """Runs without noise at points drawn uniformly within the bounds of the scenario."""
    schema = msgspec.json.schema(CutInParameters)["$defs"]["CutInParameters"]["properties"]
    ends = {name: (field["minimum"], field["maximum"]) for name, field in schema.items()}
    random = np.random.default_rng(seed)
    setups = []
    for _ in range(DRAWN):
        point = {name: random.uniform(*ends[name]) for name in ends if name not in DURATIONS}
        setups.append(msgspec.json.encode(make_setup("cut_in", "rulebook", **point | LOADED)))
    return pool.each(drive, setups)
