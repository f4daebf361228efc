"""Figures: searches under other errors of perception than those of a position."""

from collections.abc import Iterator
from itertools import product
from math import isfinite, sqrt
from statistics import NormalDist, fmean

import msgspec
import numpy as np
from benchmarks.episode_loop import tasks
from benchmarks.episode_pool import EpisodePool, horizon, make_setup
from benchmarks.figures import Figure
from benchmarks.learning_figures import of_seeds
from benchmarks.samples import COMMAND, count_share
from benchmarks.searches import Found, search
from benchmarks.truth.intervals import Plan, estimate, judge
from benchmarks.truth.known_problems import Noise, Problem
from benchmarks.truth.mode_agreement import count_modes

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.estimates import Estimate
from eigenfail.values.shapes import Markov
from eigenfail.worlds import list_channels, resolve_disturbance
from eigenfail_services.methods.subset import SubsetMethod
from eigenfail_workers.engine import Engine

EPISODES, SEEDS = 400, 3
SCENARIOS = ("cut_in", "merge_in")

POSITION = (Channel("longitudinal"), Channel("lateral"))
SETS: dict[str, tuple[Channel, ...]] = {
    "position": POSITION,
    "every": (Channel("every.longitudinal"), Channel("every.lateral")),
    "missed": (*POSITION, Channel("missed", shape=Markov(0.02, 5.0))),
    "ghost": (*POSITION, Channel("ghost", shape=Markov(0.01, 5.0))),
    "motion": (*POSITION, Channel("heading"), Channel("speed"), Channel("ego.speed")),
    "far": (*POSITION, Channel("missed", shape=Markov(0.005, 5.0, 0.0005))),
    "delay": (*POSITION, Channel("delay")),
    "occlusion": POSITION,
    "joint": POSITION,
}
"""Channels by the name of their set in figures.

That of `occlusion` is searched with it, and that of `joint` with two parameters of the scenario.
"""

JOINT_PARAMETERS = {
    "cut_in": {
        "distance_m": {"normal": [58.0, 3.0], "within": [53.0, 63.0]},
        "ego_speed_mps": {"normal": [24.0, 0.5], "within": [23.0, 25.0]},
    },
    "merge_in": {
        "behind_m": {"normal": [19.5, 2.0], "within": [13.5, 25.5]},
        "ego_speed_mps": {"normal": [20.7, 0.3], "within": [19.7, 21.7]},
    },
}
"""Parameters by their scenario. Medians are the values of the default scenario, where z = 0."""

OF_SEVERAL = {"every", "occlusion"}
"""Sets that are as `position` where there is one vehicle, as in `cut_in`."""

METHODS = ("monte_carlo", "held", "cem", "cma", "ast")

FIRST_SETS: dict[int, tuple[Channel, ...]] = {
    1: SETS["missed"][2:],
    2: POSITION,
    5: (*POSITION, Channel("speed"), SETS["ghost"][2], SETS["missed"][2]),
}
"""Channels by their number: an event alone, none, and two."""

BUDGETS = {"subset": 300, "mixture": 500, "splitting": 1_600, "ast": 70}
SETTINGS: dict[str, dict[str, object]] = {
    "splitting": {"runs": 5},
    "ensemble": {"method": "cem", "members": 2},
}
SEARCHING = (*METHODS, "ensemble", "subset", "mixture", "splitting")


def find(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Failures, log p and severity of each method with each set, in each scenario."""
    places = list_places()
    specs = [make_spec(*place, seed + n) for place in places for n in range(SEEDS)]
    founds = pool.each(search, specs)
    for number, place in enumerate(places):
        scenario, channels, method = place
        own = founds[number * SEEDS : (number + 1) * SEEDS]
        yield from describe(f"channels.{scenario}.{channels}.{method}", own)


def list_places() -> list[tuple[str, str, str]]:
    """Return scenario, set of channels and method of each figure."""
    alike = {("cut_in", name) for name in OF_SEVERAL}
    return [each for each in product(SCENARIOS, SETS, METHODS) if each[:2] not in alike]


def make_spec(scenario: str, channels: str, method: str, seed: int) -> CampaignSpec:
    """Return a campaign with the defaults of its method; `ast` is one training, which may end."""
    spec = CampaignSpec(
        name=f"{method} with {channels}",
        method=method,
        settings={"patience": None, "converged_share": 1.0} if method == "ast" else {},
        episodes=EPISODES,
        seed=seed,
        scenario=scenario,
        scenario_parameters=JOINT_PARAMETERS[scenario] if channels == "joint" else {},
        disturbance=make_model(scenario, channels),
    )
    return msgspec.structs.replace(spec, disturbance=resolve_disturbance(spec))


def make_model(scenario: str, channels: str) -> DisturbanceModel:
    """Return the disturbance model of a set of channels."""
    drawn = JOINT_PARAMETERS[scenario] if channels == "joint" else {}
    parameters = tuple(Channel(f"scenario.{name}") for name in drawn)
    return DisturbanceModel(
        channels=(*SETS[channels], *parameters), occlusion=channels == "occlusion"
    )


def describe(place: str, founds: list[Found]) -> Iterator[tuple[str, Figure]]:
    """Yield what three campaigns of one kind found."""
    failures = [len(one.crashes) for one in founds]
    more = f"; {EPISODES} episodes each"
    yield f"{place}.failures", of_seeds(failures, "episodes", EPISODES, more)
    modes = [count_distinct_modes(one) for one in founds]
    yield f"{place}.modes", of_seeds(modes, "modes", EPISODES, more)
    crashes = [crash for one in founds for crash in one.crashes]
    if not crashes:
        return
    steps = sum(len(crash.z) for crash in crashes)
    likely = sum(crash.log_probability for crash in crashes) / steps
    severity = fmean(crash.severity for crash in crashes)
    for name, value, unit in (
        ("log_p_per_step", likely, "nats"),
        ("mean_severity", severity, "m²/s²"),
    ):
        note = f"of all failures of {SEEDS} seeds"
        figure = Figure(value=value, unit=unit, n=len(crashes), note=note, command=COMMAND)
        yield f"{place}.{name}", figure


def count_distinct_modes(found: Found) -> int:
    """Return the number of distinct modes of all failures of a campaign."""
    courses = [crash.course for crash in found.crashes if crash.course is not None]
    noise = [crash.z for crash in found.crashes]
    return count_modes(noise, courses, horizon(found.spec.scenario))


def find_equal_digests(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Whether the two channels of the position, named, give the episodes of a campaign without."""
    del pool
    same = []
    for scenario, planner in product(SCENARIOS, ("rulebook", "idm")):
        plain = make_setup(scenario, planner)
        named = msgspec.structs.replace(plain, disturbance=DisturbanceModel(channels=POSITION))
        runs = [Engine(each).run(tasks(0, 100, seed)) for each in (plain, named)]
        same += [one.digest() == other.digest() for one, other in zip(*runs, strict=True)]
    yield "channels.white_digest_equal", count_share(same, "episodes of Monte Carlo")


def find_conformance(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The share of methods × numbers of channels whose campaign ran as it should."""
    places = [*product(SEARCHING, FIRST_SETS)]
    passed = pool.each(runs_to_its_end, *zip(*places, strict=True), [seed] * len(places))
    note = f"{len(SEARCHING)} methods with 1, 2 and 5 channels, events among them, on cut_in"
    yield "channels.conformance", count_share(passed, note)


def runs_to_its_end(method: str, channels: int, seed: int) -> bool:
    """Whether a campaign ends with none of its episodes errored, and a column for each channel.

    Methods that estimate a probability may end before their budget is spent.
    """
    spec = CampaignSpec(
        name=method,
        method=method,
        settings=SETTINGS.get(method, {}),
        episodes=BUDGETS.get(method, 60),
        seed=seed,
        planner="idm",
        disturbance=DisturbanceModel(channels=FIRST_SETS[channels]),
    )
    spec = msgspec.structs.replace(spec, disturbance=resolve_disturbance(spec))
    found = search(spec)
    wide = all(crash.z.shape[1] == channels == len(list_channels(spec)) for crash in found.crashes)
    return wide and len(found.crashed) > 0 and all(map(isfinite, found.robustness_m))


JOINT_EPISODES, JOINT_SEEDS = 1_000, 5


def find_joint_gain(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """How much likelier the likeliest failure is where scenario and noise are searched together."""
    seeds = [seed + n for n in range(JOINT_SEEDS)]
    specs = [make_joint_spec(each, joint) for each in seeds for joint in (False, True)]
    found = [find_likeliest(one) for one in pool.each(search, specs)]
    gains = [
        None if None in pair else pair[1] - pair[0]
        for pair in zip(found[::2], found[1::2], strict=True)
    ]
    note = (
        f"; cma on cut_in, {JOINT_EPISODES} episodes each; -1/2 of the sum of z² of the likeliest "
        "failure, with two parameters of the scenario among z less without"
    )
    yield "joint.log_p_gain", of_seeds(gains, "nats", JOINT_SEEDS, note)


def make_joint_spec(seed: int, joint: bool) -> CampaignSpec:
    """Return a campaign on noise alone, or on scenario and noise."""
    spec = CampaignSpec(
        name="joint" if joint else "noise alone",
        method="cma",
        episodes=JOINT_EPISODES,
        seed=seed,
        scenario_parameters=JOINT_PARAMETERS["cut_in"] if joint else {},
        disturbance=make_model("cut_in", "joint" if joint else "position"),
    )
    return msgspec.structs.replace(spec, disturbance=resolve_disturbance(spec))


def find_likeliest(found: Found) -> float | None:
    """Return -1/2 of the sum of z² of the likeliest failure, each parameter counted once."""
    totals = []
    for crash in found.crashes:
        z = crash.z.astype(np.float64)
        z[1:, len(POSITION) :] = 0.0
        totals.append(-0.5 * float(np.sum(z**2)))
    return max(totals, default=None)


JOINT_STEPS, JOINT_CALLS, JOINT_CAMPAIGNS = 20, 2_000, 100


def joint_half_space(probability: float) -> Problem:
    """A half space of the noise of 20 steps and one value that is drawn once, half of each."""
    border = -NormalDist().inv_cdf(probability)

    def robustness(noise: Noise) -> Noise:
        over_time = noise[..., 0].sum(axis=-1) / sqrt(JOINT_STEPS)
        return border - (over_time + noise[..., 0, 1]) / sqrt(2.0)

    return Problem(f"joint half space {probability:.0e}", JOINT_STEPS, probability, robustness)


def find_joint_cover(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """How often intervals hold the probability over what is drawn once and at each step."""
    held = []
    for probability in (1e-3, 1e-4):
        problem = joint_half_space(probability)
        seeds = range(seed, seed + JOINT_CAMPAIGNS)
        found = pool.each(estimate_joint, [probability] * JOINT_CAMPAIGNS, seeds)
        held.append(judge(found, problem.probability).held)
    note = (
        f"the smaller share of two half spaces, 1e-3 and 1e-4, with {JOINT_CAMPAIGNS} campaigns of "
        f"subset each, {JOINT_CALLS} episodes"
    )
    value = Figure(value=min(held), unit="share", n=JOINT_CAMPAIGNS, note=note, command=COMMAND)
    yield "joint.interval_cover", value


def estimate_joint(probability: float, seed: int) -> Estimate:
    """Return what a campaign of subset simulation prints."""
    problem = joint_half_space(probability)
    return estimate(Plan(SubsetMethod, JOINT_CALLS, {}, (problem,)), problem, seed)
