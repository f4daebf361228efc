"""The probability of each mode, if the campaign's method estimates it."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import nan, sqrt
from typing import Any, NamedTuple

from msgspec.structs import replace

from eigenfail.contracts import ModeProbability
from eigenfail.errors import NoisePruned
from eigenfail.methods import traits_of
from eigenfail.presentation.rates import explain_design
from eigenfail.settings import read_settings
from eigenfail.values.analysis import AnalysisResult
from eigenfail.values.campaign import FINAL_STATES, Campaign
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.estimates import Estimate, Rate
from eigenfail.values.records import EpisodeRow
from eigenfail_services.analysis.sampling_design import SamplingDesign
from eigenfail_services.campaigns.references import learner_context
from eigenfail_services.campaigns.summary import count_unresolved
from eigenfail_services.methods import subset
from eigenfail_services.resolution import resolve_method
from eigenfail_services.statistics import importance, pooled_estimate
from eigenfail_services.statistics.importance import WeightedFailures
from eigenfail_services.store.store import Store

COUNTING = "Monte Carlo"
SAME_FAILURES = (
    "The modes were found in the failures that are counted: which failures belong together is not"
    " in the interval."
)

UNDERWAY = (
    "Its campaign had not ended when the failures were read. Analyse it again once it has ended."
)

ModeEstimates = Sequence[Estimate | None]


def add_probabilities(
    store: Store, campaigns: Sequence[Campaign], result: AnalysisResult
) -> AnalysisResult:
    """Return the result with the probabilities of its modes.

    Modes that are not distinct get no probability. Modes of several campaigns get none either:
    their episodes are drawn from different proposals. If a campaign had not ended, the result
    states why it lacks probabilities: further failures arrive, which do not belong to a mode.

    Args:
        store: store with the episodes.
        campaigns: the campaigns of the result, read before their failures.
        result: the analysis of their failures.
    """
    (first, *others) = campaigns
    teller = ESTIMATORS.get(traits_of(first.spec.method).mode_probability)
    if others or teller is None or not result.distinct:
        return result
    if teller.needs_estimate and first.estimate is None:
        return result
    probabilities = _estimate_modes(teller, store, first, result)
    modes = zip(result.modes, probabilities, strict=True)
    return replace(result, modes=tuple(replace(mode, probability=one) for mode, one in modes))


def _estimate_modes(
    teller: "ModeEstimator", store: Store, campaign: Campaign, result: AnalysisResult
) -> ModeEstimates:
    modes = len(result.modes)
    if campaign.state not in FINAL_STATES:
        return [Estimate(by=teller.by, episodes=0, problem=UNDERWAY)] * modes
    mode_of = dict(zip(result.episodes, result.labels, strict=True))
    # A rate by counting has errored episodes in its interval already.
    errored = 0 if teller.by == COUNTING else campaign.counts.errored
    try:
        found = teller.estimate(store, campaign, mode_of, modes)
        return [each and each.bound_below(errored) for each in found]
    except NoisePruned as error:
        return [Estimate(by=teller.by, episodes=0, problem=str(error))] * modes


def estimate_by_levels(
    store: Store, campaign: Campaign, mode_of: Mapping[int, int], modes: int
) -> ModeEstimates:
    """Estimate each mode by the last level of a subset simulation."""
    settings = read_settings(subset.SubsetMethodSettings, campaign.spec.settings, "settings")
    simulation = subset.start_simulation(learner_context(campaign, store), settings)
    robustness = [_read_robustness_m(row) for row in store.episodes.iterate(campaign.id)]
    return subset.estimate_modes(simulation, robustness, mode_of, modes) or [None] * modes


def _read_robustness_m(row: EpisodeRow) -> float:
    """Return the robustness; 0 for a failure, NaN if the episode errored or has none. [m]"""
    if row.outcome.is_failure:
        return 0.0
    ran = row.outcome is not Outcome.ERRORED and row.robustness_m is not None
    return float(row.robustness_m or 0.0) if ran else nan


def estimate_by_weights(
    store: Store, campaign: Campaign, mode_of: Mapping[int, int], modes: int
) -> ModeEstimates:
    """Estimate each mode by importance weights; the learner goes through all rounds again."""
    context = learner_context(campaign, store)
    method = resolve_method(campaign.spec.method, campaign.spec.settings)
    learner = method.description.plugin(context, method.settings)
    sums, seen = [WeightedFailures()] * modes, 0
    for results in _list_rounds(store, campaign, learner):
        # The method estimates from the second half of its budget alone, and its modes from the same
        # episodes.
        if seen >= context.episodes // 2:
            sums = [
                learner.weigh(one, _keep_mode(results, mode_of, mode))
                for mode, one in enumerate(sums)
            ]
        learner.observe(results)
        seen += len(results)
    return [learner.estimate_from_sums(one, context.horizon) for one in sums]


def _list_rounds(store: Store, campaign: Campaign, learner: Any) -> Iterator[list[EpisodeResult]]:
    """Return the completed rounds in order; the learner has to observe each before the next."""
    first, budget = 0, campaign.spec.episodes
    while first < budget:
        last = first + len(learner.propose(budget - first).sources)
        results = store.episodes.finished(campaign.id, range(first, last))
        # A learner observes whole rounds alone, and the last round of a campaign may be incomplete.
        if len(results) < last - first:
            return
        yield results
        first = last


def _keep_mode(
    results: Sequence[EpisodeResult], mode_of: Mapping[int, int], mode: int
) -> list[EpisodeResult]:
    """Return the results with the failures of other modes as safe episodes."""
    return [
        replace(result, outcome=Outcome.SAFE)
        if result.is_failure and mode_of.get(result.index) != mode
        else result
        for result in results
    ]


def estimate_by_known_proposal(
    store: Store, campaign: Campaign, mode_of: Mapping[int, int], modes: int
) -> ModeEstimates:
    """Estimate each mode by its own learner, which takes all other failures as safe.

    The method learns nothing from results, so each learner repeats the campaign's proposals.
    """
    context = learner_context(campaign, store)
    method = resolve_method(campaign.spec.method, campaign.spec.settings)
    make, settings = method.description.plugin, method.settings
    first, *others = learners = [make(context, settings) for _ in range(modes)]
    for results in _list_rounds(store, campaign, first):
        for learner in others:
            learner.propose(len(results))
        for mode, learner in enumerate(learners):
            learner.observe(_keep_mode(results, mode_of, mode))
    return [learner.estimate() for learner in learners]


def _estimate_by_counts(
    store: Store, campaign: Campaign, mode_of: Mapping[int, int], modes: int
) -> ModeEstimates:
    counted, counts = Counter(mode_of.values()), campaign.counts
    design = SamplingDesign.of([campaign.spec])
    # An errored or unresolved episode may hide a failure of any mode.
    unresolved = min(count_unresolved(store, campaign), counts.completed - counts.failures)
    found = (counted[mode] for mode in range(modes))
    return [
        estimate_share(design.make_rate(k, counts.completed, counts.errored, unresolved))
        for k in found
    ]


def estimate_share(found: Rate) -> Estimate:
    """Return the estimate from a number of failures among episodes that were drawn from p(x)."""
    return Estimate(
        by=COUNTING,
        episodes=found.n,
        probability=found.value,
        cv=sqrt((1.0 - found.share) / found.k) if found.k else None,
        interval=found.interval,
        note=f"{SAME_FAILURES} {explain_design(found)}".rstrip(),
    )


class ModeEstimator(NamedTuple):
    """A way to estimate the probability of each mode, and its name.

    Attributes:
        needs_estimate: whether the campaign itself must have an estimate.
    """

    by: str
    estimate: Callable[[Store, Campaign, Mapping[int, int], int], ModeEstimates]
    needs_estimate: bool = False


ESTIMATORS: Mapping[ModeProbability, ModeEstimator] = {
    ModeProbability.COUNTS: ModeEstimator(COUNTING, _estimate_by_counts),
    ModeProbability.KNOWN_PROPOSAL: ModeEstimator(
        importance.BY, estimate_by_known_proposal, needs_estimate=True
    ),
    ModeProbability.LEVELS: ModeEstimator(pooled_estimate.SUBSET_SIMULATION, estimate_by_levels),
    ModeProbability.WEIGHTS: ModeEstimator(importance.BY, estimate_by_weights),
}
