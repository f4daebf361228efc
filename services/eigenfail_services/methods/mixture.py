"""Mixture sampling: importance sampling from normals around every known failure region."""

from math import inf, log10
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.contracts import MethodTraits
from eigenfail.errors import InvalidValue
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext
from eigenfail_services.methods import RoundSize
from eigenfail_services.methods.batch_learner import BatchLearner, check_values
from eigenfail_services.statistics import mixture_sampling, pooled_estimate
from eigenfail_services.statistics.intervals import log_normal
from eigenfail_services.statistics.subset_simulation import PlainDraws, SubsetSimulation

BY = "mixture sampling"

FEWEST_EPISODES = 500
"""Below this the chains are too few and too short for any of the known problems."""

LARGEST_TAIL_INDEX = 0.7
"""Of the weights of many draws (Vehtari et al. 2024, JMLR 25 (72)): beyond it their mean converges
too slowly. With n draws the limit is 1 − 1 / log10(n), if that is less."""

MOST_VALUES = 1_000
"""Values of noise of an episode: the time of a fit grows with the cube of their number."""

MOST_UNCOVERED = 0.05
"""Share of the chains' ends that the last mixture may leave uncovered."""

BLIND = "It does not include failures that noise of up to four sigma did not meet."

TAKE_SUBSET = "Take method subset"


class MixtureSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `mixture`."""

    components: Annotated[
        int, Meta(ge=1, le=20, description="normals around failure regions at most")
    ] = 8
    round_size: RoundSize = 10_000

    def check_budget(self, episodes: int) -> None:
        """Raise InvalidValue if the budget is too small."""
        if episodes < FEWEST_EPISODES:
            raise InvalidValue(
                "episodes",
                f"{episodes} are too few to find the failure regions and to draw from them; the "
                f"least is {FEWEST_EPISODES}.",
                "Give more episodes: 2,000 are enough for most problems with up to ten values.",
            )


class MixtureMethod(BatchLearner[mixture_sampling.MixtureSampling]):
    """Finds failure regions with wider noise, fits a mixture to them, and draws from the mixture.

    Raises:
        InvalidValue: the budget is too small, or the noise has too many values.
    """

    Settings = MixtureSettings
    traits = MethodTraits(bounds_probability=True, chart_mark=11, references={})
    kind = "mixture"

    def __init__(self, context: LearnerContext, settings: MixtureSettings) -> None:
        settings.check_budget(context.episodes)
        check_values(self.kind, MOST_VALUES, context, f"{TAKE_SUBSET}.")
        self._settings = settings
        super().__init__(context, settings.round_size)

    def _make_simulation(self) -> mixture_sampling.MixtureSampling:
        context = self._context
        return mixture_sampling.MixtureSampling(
            (context.horizon, context.channels),
            context.episodes,
            self._settings.components,
            (context.seed,),
        )

    def estimate(self) -> Estimate | None:
        """Return the failure probability from the last draws; before the end, why it is missing."""
        simulation, result = self._driver.simulation, self._driver.simulation.result
        episodes = simulation.episodes_run
        if not self._driver.is_done:
            problem = "Not known before the last draws are completed, on which it rests alone."
            return _refuse(episodes, problem) if episodes else None
        # No mixture was fitted, and another method had the rest of the budget.
        if result is None:
            return _hand_on(simulation)
        return judge_result(result, episodes, self._context.channels * self._context.horizon)


def judge_result(result: mixture_sampling.MixtureResult, episodes: int, values: int) -> Estimate:
    """Return the estimate, or the reason why its number cannot be trusted.

    Args:
        result: result of the last draws.
        episodes: number of episodes that ran.
        values: number of noise values of an episode.
    """
    if result.errored == result.draws:
        return _refuse(episodes, "All of the last draws errored: correct what raised.")
    # Without a failure the estimate would be 0, with an interval of no width.
    if not len(result.weights):
        return _refuse(episodes, f"None of the last draws failed. {TAKE_SUBSET}.")
    effective = result.effective
    needed = mixture_sampling.count_needed(values)
    if effective < needed:
        return _refuse(
            episodes,
            f"The {len(result.weights)} failures carry the information of {effective:.1f} "
            f"independent ones, and {needed} are needed: the fitted normals do not "
            f"match the failures well. {TAKE_SUBSET}, or give it more episodes.",
        )
    tail = mixture_sampling.fit_tail(result.weights)
    index = tail.shape if tail else inf
    limit = min(1.0 - 1.0 / log10(result.draws), LARGEST_TAIL_INDEX)
    if index > limit:
        return _refuse(
            episodes,
            f"The largest weights are too unequal (tail index {index:.2f}, at most {limit:.2f}): "
            f"rare heavy ones are probably missing. {TAKE_SUBSET}, or give it more episodes.",
        )
    if result.uncovered > MOST_UNCOVERED:
        return _refuse(
            episodes,
            f"{result.uncovered:.0%} of the failures that were kept from the fit lie where the "
            "mixture hardly draws: it has lost a failure region, or the noise has too many values "
            f"for so few failures. {TAKE_SUBSET}, or give it more episodes.",
        )
    cv = result.cv
    return Estimate(
        by=BY,
        episodes=episodes,
        probability=result.probability,
        cv=cv,
        interval=log_normal(result.probability, cv, result.effective_for_variance),
        effective=effective,
        note=BLIND,
    )


def _hand_on(simulation: mixture_sampling.MixtureSampling) -> Estimate:
    """Return the estimate of the method that used the rest of the budget, with the reason."""
    refused = _refuse(simulation.episodes_run, _explain_early_end(simulation))
    successor = simulation.successor
    # Draws from p(x) need no model: their share of failures stands whatever went wrong before.
    if isinstance(successor, PlainDraws) and successor.counts:
        return pooled_estimate.estimate_from_draws(refused, successor.counts)
    if not isinstance(successor, SubsetSimulation):
        return refused
    told = pooled_estimate.estimate_ended(successor)
    why = f"Mixture sampling gave no number. {refused.problem}"
    return msgspec.structs.replace(
        told,
        episodes=refused.episodes + told.episodes,
        problem=f"{why} {told.problem}" if told.problem else "",
        note=f"{told.note} {why}" if told.note else "",
    )


def _explain_early_end(simulation: mixture_sampling.MixtureSampling) -> str:
    """Return why no mixture was fitted."""
    if not simulation.episodes_run:
        return pooled_estimate.ALL_ERRORED
    if not simulation.are_failures_rare:
        return (
            f"Failures are not rare in its first {simulation.episodes_run} episodes: take method "
            "monte_carlo."
        )
    if simulation.promised is not None:
        needed = mixture_sampling.count_needed(simulation.size)
        return (
            f"Its trials promise the information of {simulation.promised:.1f} independent "
            f"failures, and {needed} are needed: the fitted normals do not match the failures well."
        )
    return (
        f"Noise of one to four sigma met {simulation.found_failures} failures in its first "
        f"{simulation.episodes_run} episodes, and {mixture_sampling.FEWEST_FAILURES} are needed."
    )


def _refuse(episodes: int, problem: str) -> Estimate:
    return Estimate(by=BY, episodes=episodes, problem=problem)
