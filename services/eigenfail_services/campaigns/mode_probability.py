"""The probability of each mode, where the campaign's method can tell it; else none."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import nan, sqrt
from typing import Any, NamedTuple

from msgspec.structs import replace

from eigenfail import plugins
from eigenfail.contracts import Store
from eigenfail.errors import NoisePruned
from eigenfail.settings import read_settings
from eigenfail.values import (
    FINAL_STATES,
    AnalysisResult,
    Campaign,
    EpisodeResult,
    Estimate,
    Outcome,
)
from eigenfail.values.records import EpisodeRow
from eigenfail_services.campaigns.materials import learner_context
from eigenfail_services.methods.subset.modes import by_mode
from eigenfail_services.methods.subset.settings import SubsetMethodSettings
from eigenfail_services.methods.subset.waves import Dialogue
from eigenfail_services.statistics import importance, independent_runs
from eigenfail_services.statistics.importance import WeightedFailures
from eigenfail_services.statistics.intervals import rate

PAGE = 1_000

COUNTING = "Monte Carlo"
SAME_FAILURES = (
    "The modes were found in the failures that are counted: which failures belong together is not"
    " in the interval."
)

UNDERWAY = (
    "Its campaign had not ended when the failures were read. Analyse it again once it has ended."
)

Told = Sequence[Estimate | None]


def with_probabilities(
    store: Store, campaigns: Sequence[Campaign], result: AnalysisResult
) -> AnalysisResult:
    """The result, its modes with their probabilities.

    None are told of modes that are not distinct, nor of several campaigns together: their episodes
    are drawn from different proposals. Of a campaign that had not ended it is said why there is
    none: episodes go on to land, and their failures have no mode.

    Args:
        store: where the episodes are.
        campaigns: those of the result, as they stood before their failures were read.
        result: what was found in their failures.
    """
    (first, *others) = campaigns
    teller = TELLERS.get(first.spec.method)
    if others or teller is None or not teller.can(first) or not result.distinct:
        return result
    told = told_by(teller, store, first, result)
    modes = zip(result.modes, told, strict=True)
    return replace(result, modes=tuple(replace(mode, probability=one) for mode, one in modes))


def told_by(teller: "Teller", store: Store, campaign: Campaign, result: AnalysisResult) -> Told:
    """What the campaign's method tells of each mode."""
    modes = len(result.modes)
    if campaign.state not in FINAL_STATES:
        return [Estimate(by=teller.by, episodes=0, problem=UNDERWAY)] * modes
    mode_of = dict(zip(result.episodes, result.labels, strict=True))
    try:
        return teller.tell(store, campaign, mode_of, modes)
    except NoisePruned as error:
        return [Estimate(by=teller.by, episodes=0, problem=str(error))] * modes


def by_levels(store: Store, campaign: Campaign, mode_of: Mapping[int, int], modes: int) -> Told:
    """By the last level of the simulations of `subset`."""
    settings = read_settings(SubsetMethodSettings, campaign.spec.settings, "settings")
    context = learner_context(campaign, store)
    each = settings.within(context.episodes)
    runs = range(settings.runs)
    dialogues = [Dialogue(context.horizon, each, (context.seed, run)) for run in runs]
    robustness = [robustness_m(row) for row in rows(store, campaign.id)]
    return by_mode(dialogues, robustness, mode_of, modes) or [None] * modes


def robustness_m(row: EpisodeRow) -> float:
    """0 on a collision, not a number where the episode could not be run. [m]"""
    if row.outcome is Outcome.COLLISION:
        return 0.0
    ran = row.outcome is not Outcome.FAILED and row.robustness_m is not None
    return float(row.robustness_m or 0.0) if ran else nan


def rows(store: Store, campaign: int) -> Iterator[EpisodeRow]:
    """The episodes of a campaign in index order."""
    page = store.episodes.page(campaign, PAGE)
    yield from page.items
    while page.next is not None:
        page = store.episodes.page(campaign, PAGE, page.next)
        yield from page.items


def by_weights(store: Store, campaign: Campaign, mode_of: Mapping[int, int], modes: int) -> Told:
    """By the weights of `cem`: its learner goes through the campaign again, round by round."""
    context = learner_context(campaign, store)
    method = plugins.load(plugins.METHODS, campaign.spec.method)
    settings = read_settings(method.Settings, campaign.spec.settings, "settings")
    learner = method(context, settings)
    sums, seen = [WeightedFailures()] * modes, 0
    for results in rounds(store, campaign, learner):
        if seen >= context.episodes // 2:
            sums = [
                learner.weigh(one, alone(results, mode_of, mode)) for mode, one in enumerate(sums)
            ]
        learner.observe(results)
        seen += len(results)
    return [learner.tell(one, context.horizon) for one in sums]


def rounds(store: Store, campaign: Campaign, learner: Any) -> Iterator[list[EpisodeResult]]:
    """The rounds that have ended whole, in order; the learner observes each before the next."""
    first, budget = 0, campaign.spec.episodes
    while first < budget:
        last = first + len(learner.propose(budget - first).sources)
        results = store.episodes.finished(campaign.id, range(first, last))
        if len(results) < last - first:
            return
        yield results
        first = last


def alone(
    results: Sequence[EpisodeResult], mode_of: Mapping[int, int], mode: int
) -> list[EpisodeResult]:
    """The results as they would be if failures of other modes were none."""
    return [
        replace(result, outcome=Outcome.SAFE)
        if result.is_failure and mode_of.get(result.index) != mode
        else result
        for result in results
    ]


def by_known_proposal(
    store: Store, campaign: Campaign, mode_of: Mapping[int, int], modes: int
) -> Told:
    """By the weights of `evaluate`: one learner for each mode, to whom other failures are none.

    Nothing is learnt from results, so that each proposes what was proposed.
    """
    context = learner_context(campaign, store)
    method = plugins.load(plugins.METHODS, campaign.spec.method)
    settings = read_settings(method.Settings, campaign.spec.settings, "settings")
    first, *others = learners = [method(context, settings) for _ in range(modes)]
    for results in rounds(store, campaign, first):
        for learner in others:
            learner.propose(len(results))
        for mode, learner in enumerate(learners):
            learner.observe(alone(results, mode_of, mode))
    return [learner.estimate() for learner in learners]


def by_counts(_store: Store, campaign: Campaign, mode_of: Mapping[int, int], modes: int) -> Told:
    """By counting, where all noise is drawn from p(x): failures of the mode ÷ episodes."""
    counted = Counter(mode_of.values())
    return [share(counted[mode], campaign.counts.completed) for mode in range(modes)]


def share(failures: int, episodes: int) -> Estimate:
    """The estimate that k of n make."""
    found = rate(failures, episodes)
    return Estimate(
        by=COUNTING,
        episodes=episodes,
        probability=found.value,
        cv=sqrt((1.0 - found.value) / failures) if failures else None,
        interval=found.interval,
        note=SAME_FAILURES,
    )


def always(_campaign: Campaign) -> bool:
    """A method that tells of every campaign."""
    return True


def tells_itself(campaign: Campaign) -> bool:
    """A method that tells of a mode where it tells of failures at all."""
    return campaign.estimate is not None


class Teller(NamedTuple):
    """How a method tells a probability, by name and in deed, and of which campaigns."""

    by: str
    tell: Callable[[Store, Campaign, Mapping[int, int], int], Told]
    can: Callable[[Campaign], bool] = always


TELLERS = {
    "cem": Teller(importance.BY, by_weights),
    "evaluate": Teller(importance.BY, by_known_proposal, tells_itself),
    "monte_carlo": Teller(COUNTING, by_counts),
    "subset": Teller(independent_runs.BY, by_levels),
}
