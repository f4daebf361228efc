"""Figures: how often built-in planners violate requirements, and what searches find of them."""

from collections.abc import Iterator
from itertools import product
from statistics import NormalDist, fmean, stdev

import msgspec
from benchmarks.episode_loop import tasks
from benchmarks.episode_pool import EpisodePool, horizon
from benchmarks.figures import Figure
from benchmarks.learning_figures import of_seeds
from benchmarks.samples import COMMAND, count_share, mean, share
from benchmarks.searches import search
from benchmarks.truth.intervals import holds

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.requirements import (
    AnyRequirement,
    Formula,
    MeasureLimit,
    NoCollision,
    PreventableCollision,
    TimeHeadway,
    UncausedBraking,
)
from eigenfail.values.shapes import Markov
from eigenfail.worlds import resolve_disturbance
from eigenfail_services.statistics.batches import Array
from eigenfail_services.statistics.pooled_estimate import estimate_ended
from eigenfail_services.statistics.subset_simulation import SubsetSettings, simulate_subsets
from eigenfail_workers.engine import Engine

POSITION = (Channel("longitudinal"), Channel("lateral"))
SETS: dict[str, tuple[Channel, ...]] = {
    "position": POSITION,
    "ghost": (*POSITION, Channel("ghost", shape=Markov(0.01, 5.0))),
}
"""Channels by the name of their set in figures."""

KINDS: tuple[AnyRequirement, ...] = (
    NoCollision(),
    PreventableCollision(),
    TimeHeadway(),
    UncausedBraking(),
)
SCENARIOS = ("cut_in", "lead_brake", "merge_in")
PLANNERS = ("rulebook", "idm")
SAMPLE = 1_000

METHODS = ("monte_carlo", "held", "cem", "cma", "ast")
EPISODES, SEEDS = 400, 3


def find_rates(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The share of Monte Carlo episodes that violate each requirement."""
    places = [*product(SCENARIOS, PLANNERS, SETS)]
    found = pool.each(judge, *zip(*places, strict=True), [seed] * len(places))
    for (scenario, planner, channels), values in zip(places, found, strict=True):
        for place, kind in enumerate(KINDS):
            violated = [each[place] <= 0.0 for each in values]
            name = f"requirements.{scenario}.{planner}.{channels}.{kind.kind}.rate"
            yield name, share(violated, "Monte Carlo episodes; default settings of the requirement")


def judge(scenario: str, planner: str, channels: str, seed: int) -> list[tuple[float, ...]]:
    """Return the robustness of each requirement in each episode."""
    spec = make_spec("monte_carlo", scenario, channels, KINDS, seed, planner=planner)
    return [result.requirements for result in Engine(spec.setup()).run(tasks(0, SAMPLE, seed))]


def find_searches(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """What each method finds of hard braking without cause, with ghosts."""
    places = [*product(METHODS, range(SEEDS))]
    specs = [
        make_spec(method, "merge_in", "ghost", (UncausedBraking(),), seed + n)
        for method, n in places
    ]
    founds = pool.each(search, specs)
    for number, method in enumerate(METHODS):
        own = founds[number * SEEDS : (number + 1) * SEEDS]
        failures = [len(one.crashes) for one in own]
        figure = of_seeds(failures, "episodes", EPISODES, f"; {EPISODES} episodes each")
        yield f"requirements.merge_in.uncaused_braking.{method}.failures", figure


def make_spec(
    method: str,
    scenario: str,
    channels: str,
    requirements: tuple[AnyRequirement, ...],
    seed: int,
    **changes: object,
) -> CampaignSpec:
    """Return a campaign with the defaults of its method; `ast` is one search without restarts."""
    fields: dict[str, object] = {
        "name": f"{method} with {channels}",
        "method": method,
        "settings": {"patience": None} if method == "ast" else {},
        "episodes": EPISODES,
        "seed": seed,
        "scenario": scenario,
        "disturbance": DisturbanceModel(channels=SETS[channels]),
        "requirements": requirements,
    }
    spec = msgspec.convert(fields | changes, CampaignSpec)
    return msgspec.structs.replace(spec, disturbance=resolve_disturbance(spec))


LARGEST_SIGMA = 4.5
CALLS, RUNS, FUNCTION_RUNS = 2_000, 20, 300
"""What a probability in closed form is estimated from, and how often: by campaigns of the
requirement, and by the same noise in a function, which is cheap."""


def find_closed_form(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Subset simulation of a requirement on the error of one channel, which is white noise."""
    steps = horizon("lead_brake")
    truth = 1.0 - NormalDist().cdf(LARGEST_SIGMA) ** steps
    seeds = range(seed, seed + FUNCTION_RUNS)
    ratios = [one / truth for one in pool.each(estimate_excess, [steps] * len(seeds), seeds)]
    note = (
        f"mean of {len(seeds)} estimates, a refusal as 0, of {CALLS} episodes each, ÷ {truth:.3g}; "
        "the largest of the same noise in a function"
    )
    yield "requirements.closed_form.subset_over_truth", mean(ratios, "ratio", note)
    founds = pool.each(search, [make_excess_spec(seed + n) for n in range(RUNS)])
    told = [one.estimate for one in founds if one.estimate and one.estimate.probability]
    held = [holds(one, truth) for one in told]
    note = f"estimates by subset of {truth:.3g}, of {CALLS} episodes each"
    yield "requirements.closed_form.covered", count_share(held, note)


def estimate_excess(steps: int, seed: int) -> float:
    """Return what subset simulation says of the largest of so many values; 0 for no number."""
    settings = SubsetSettings()
    done = simulate_subsets(measure_margin, (steps, 1), CALLS, settings, seed)
    return estimate_ended(done).probability or 0.0


def measure_margin(z: Array) -> Array:
    """Return how far the largest value stays below the limit."""
    margins: Array = LARGEST_SIGMA - z[:, :, 0].max(axis=1)
    return margins


def make_excess_spec(seed: int) -> CampaignSpec:
    """Return a campaign that fails where the largest of independent errors exceeds some sigma."""
    limit = Formula(formula=f"always (error.longitudinal < {LARGEST_SIGMA})")
    model = DisturbanceModel(channels=(Channel("longitudinal", 1.0, 0.0),))
    fields = {"disturbance": model, "episodes": CALLS}
    return make_spec("subset", "lead_brake", "position", (limit,), seed, **fields)


CUT_IN_P_FAIL = 3.38e-5
"""By plain Monte Carlo, 5,825,000 episodes in two compiled ports (docs/world.md)."""

LED_CALLS, LED_RUNS = 10_000, 5
IMPORTANCES: dict[str, AnyRequirement | None] = {
    "distance": None,
    "drac": MeasureLimit(measure="max_drac_mps2", at_most=7.0),
    "ttc": MeasureLimit(measure="min_ttc_s", at_least=1.5),
}
"""What subset simulation follows; the first is the robustness of no collision."""


def find_importance(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """What subset simulation says of `cut_in`, led by different measures."""
    places = [*product(IMPORTANCES, range(LED_RUNS))]
    specs = [make_led_spec(name, seed + n) for name, n in places]
    founds = pool.each(search, specs)
    for number, name in enumerate(IMPORTANCES):
        own = founds[number * LED_RUNS : (number + 1) * LED_RUNS]
        told = [one.estimate.probability or 0.0 for one in own if one.estimate]
        note = f"estimates of {LED_CALLS} episodes each, ÷ {CUT_IN_P_FAIL:g}"
        ratios = [probability / CUT_IN_P_FAIL for probability in told]
        yield f"importance.cut_in.{name}.over_truth", mean(ratios, "ratio", note)
        spread = stdev(told) / fmean(told) if len(told) > 1 and fmean(told) else None
        yield (
            f"importance.cut_in.{name}.cv_between",
            Figure(value=spread, unit="ratio", n=len(told), note=note, command=COMMAND),
        )


def make_led_spec(name: str, seed: int) -> CampaignSpec:
    """Return a campaign of subset simulation that follows a measure."""
    importance = IMPORTANCES[name]
    led = {} if importance is None else {"importance": importance}
    return CampaignSpec(
        name=name,
        method="subset",
        episodes=LED_CALLS,
        seed=seed,
        requirements=(NoCollision(),),
        **led,
    )
