"""Campaigns of methods, each whole in one process, with nothing of the service around them.

Their episodes are those of the service's campaigns: rounds, seeds and learners are the product's.
"""

from collections.abc import Sequence
from functools import cache
from hashlib import sha256
from math import nan
from typing import Any, NamedTuple

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.truth.known_problems import Problem

from eigenfail import plugins
from eigenfail.contracts import EpisodeEngine, Learner
from eigenfail.settings import read_settings
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign import EpisodeForm
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, learner_seed
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext, Predecessor
from eigenfail.values.records import (
    ConflictClass,
    FailureCourse,
    assess,
    make_failure_course,
)
from eigenfail.worlds import list_channels, world_of
from eigenfail_services.campaigns.references import stack_noise
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_workers.engine import Engine
from eigenfail_workers.functions import FunctionEngine

FRESH = 1000
"""Added to a seed: what was learnt is evaluated on draws that training never saw."""

EARLIER = 1
"""The id that a campaign which is evaluated goes by."""


class Crash(NamedTuple):
    """A failure: its noise z, shape (steps, channels), its likelihood and its severity.

    `prior` is what log p would be on average on the same steps, for noise from p(x) itself. The
    course is None where episodes are calls of a function, the cause where the scenario has no true
    labels. The conflict is its class.
    """

    z: Floats
    log_probability: float
    prior: float
    severity: float
    course: FailureCourse | None = None
    cause: str | None = None
    conflict: ConflictClass | None = None


class Found(NamedTuple):
    """What came of a campaign, and what its learner knew in the end.

    `mean_square_z` and `log_p_per_step` are over all steps of all episodes, failures or not.
    """

    spec: CampaignSpec
    crashed: tuple[bool, ...]
    crashes: tuple[Crash, ...]
    robustness_m: tuple[float, ...]
    mean_square_z: float
    log_p_per_step: float
    trained_episodes: int | None
    state: bytes
    digest: str
    estimate: Estimate | None = None


def search(spec: CampaignSpec, earlier: Found | None = None, noise: Sequence[Floats] = ()) -> Found:
    """Run a campaign; one of `evaluate` uses what an earlier one has learnt, some inject noise."""
    given = context(spec, count_steps(spec), earlier, noise)
    # An engine of its own: policies of earlier campaigns would be in the way of its first ones.
    return run(spec, given, Engine(spec.setup()))


def count_steps(spec: CampaignSpec) -> int:
    """The number of steps of a campaign's episodes."""
    return world_of(spec.simulator).find_form(spec).steps


def search_function(spec: CampaignSpec, problem: Problem) -> Found:
    """Run a campaign whose episodes are calls of a function of the noise."""
    function = FunctionEngine(problem.robustness, problem.steps)
    return run(spec, context(spec, problem.steps, None), function)


def run(spec: CampaignSpec, given: LearnerContext, episodes: EpisodeEngine) -> Found:
    """Run a campaign in an engine, from what its learner is given."""
    method = plugins.load(plugins.METHODS, spec.method)
    settings = read_settings(method.Settings, spec.settings, "settings")
    learner: Learner = method(given, settings)
    rounds = Rounds(learner, spec.seed, spec.episodes)
    results = list(run_in_process(rounds, episodes))
    z = np.concatenate([result.noise.z for result in results])
    return Found(
        spec=spec,
        crashed=tuple(result.is_failure for result in results),
        crashes=tuple(crash(result) for result in results if result.is_failure),
        robustness_m=tuple(one.measures.robustness_m if one.measures else nan for one in results),
        mean_square_z=float(np.mean(z.astype(np.float64) ** 2)),
        log_p_per_step=sum(one.noise.log_probability for one in results) / len(z),
        trained_episodes=getattr(learner, "trained_episodes", None),
        state=learner.state(),
        digest=sha256("".join(result.digest() for result in results).encode()).hexdigest(),
        estimate=rounds.estimate(),
    )


def side_by_side(pool: EpisodePool, specs: list[CampaignSpec]) -> list[Found]:
    """Run campaigns, as many at a time as there are cores."""
    return pool.each(search, specs)


def evaluations(
    pool: EpisodePool, learnt: list[Found], episodes: int, **parameters: Any
) -> list[Found]:
    """Evaluate what campaigns have learnt, in the scenario with these parameters."""
    return pool.each(search, list_evaluations(learnt, episodes, **parameters), learnt)


def list_evaluations(learnt: list[Found], episodes: int, **parameters: Any) -> list[CampaignSpec]:
    """The campaigns that evaluate what others have learnt; parameters as for `evaluations`."""
    return [
        msgspec.structs.replace(
            found.spec,
            method="evaluate",
            seed=found.spec.seed + FRESH,
            settings={"campaign": EARLIER},
            episodes=episodes,
            scenario_parameters=parameters or found.spec.scenario_parameters,
        )
        for found in learnt
    ]


def changed(found: Found, **settings: Any) -> Found:
    """The same knowledge for a learner with some settings changed, such as its sampler."""
    spec = msgspec.structs.replace(found.spec, settings=found.spec.settings | settings)
    return found._replace(spec=spec)


def context(
    spec: CampaignSpec, steps: int, earlier: Found | None, noise: Sequence[Floats] = ()
) -> LearnerContext:
    """What the service would give the learner, for episodes of some steps at most."""
    return LearnerContext(
        seed=learner_seed(spec.seed),
        episodes=spec.episodes,
        horizon=steps,
        trajectories=stack_noise(noise, EpisodeForm(steps, channels=list_channels(spec))),
        predecessors=() if earlier is None else (predecessor(earlier),),
        parallel=spec.parallel,
    )


def predecessor(earlier: Found) -> Predecessor:
    """The learner of a campaign, for one that uses it."""
    spec = earlier.spec
    return Predecessor(
        campaign=EARLIER,
        method=spec.method,
        settings=spec.settings,
        seed=learner_seed(spec.seed),
        episodes=spec.episodes,
        horizon=count_steps(spec),
        state=earlier.state,
    )


@cache
def engine(setup: bytes) -> Engine:
    """An engine for a setup in JSON; each process keeps its own."""
    return Engine(msgspec.json.decode(setup, type=EpisodeSetup))


def crash(result: EpisodeResult) -> Crash:
    """What is kept of a failure."""
    severity: Any = result.measures and result.measures.severity
    scene, noise = result.scene, result.noise
    return Crash(
        noise.z,
        noise.log_probability,
        prior(noise),
        float(severity or 0.0),
        scene and make_failure_course(result.index, scene.dt_s, scene.vehicles, scene.sizes),
        result.measures and result.measures.cause,
        assess(result.outcome, result.measures).conflict,
    )


def prior(noise: NoiseTrajectory) -> float:
    """The mean of log p under p(x) over the steps of a noise trajectory: each z² is 1."""
    z = noise.z.astype(np.float64)
    return noise.log_probability + float(np.sum(0.5 * z**2 - 0.5))
