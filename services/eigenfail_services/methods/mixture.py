"""Mixture sampling: importance sampling from normals around every failure region that was found."""

from typing import Annotated

import msgspec

from eigenfail.contracts import MethodTraits
from eigenfail.errors import InvalidValue
from eigenfail.values import Estimate, LearnerContext
from eigenfail_services.methods.wave_learner import WaveLearner
from eigenfail_services.statistics.intervals import log_normal
from eigenfail_services.statistics.mixture_sampling import (
    FEWEST_FAILURES,
    MixtureResult,
    MixtureSampling,
    estimate_tail_index,
)

BY = "mixture sampling"

FEWEST_EPISODES = 500
"""Below this the chains are too few and too short for any of the known problems."""

FEWEST_EFFECTIVE = 25.0
"""Effective failures below which nothing is printed."""

LARGEST_TAIL_INDEX = 0.7
"""Of the weights (Vehtari et al. 2024, JMLR 25 (72)): beyond it their mean converges too slowly."""

MOST_UNCOVERED = 0.05
"""Share of the chains' ends that the last mixture may leave uncovered."""

BLIND = "It does not include failures that noise of up to four sigma did not meet."

TAKE_SUBSET = "Take method subset"


class MixtureSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `mixture`."""

    components: Annotated[
        int, msgspec.Meta(ge=1, le=20, description="normals around failure regions at most")
    ] = 8
    round_size: Annotated[
        int, msgspec.Meta(ge=1, le=100_000, description="episodes in a round at most")
    ] = 10_000

    def check_budget(self, episodes: int) -> None:
        """Raise InvalidValue if the budget is too small."""
        if episodes < FEWEST_EPISODES:
            raise InvalidValue(
                "episodes",
                f"{episodes} are too few to find the failure regions and to draw from them; the "
                f"least is {FEWEST_EPISODES}.",
                "Give more episodes: with 2,000 the estimate is good in up to ten dimensions.",
            )


class MixtureMethod(WaveLearner[MixtureSampling]):
    """Finds failure regions with wider noise, fits a mixture to them, and draws from it.

    Raises:
        InvalidValue: the budget is too small.
    """

    Settings = MixtureSettings
    traits = MethodTraits(chart_mark=11, references={})
    kind = "mixture"

    def __init__(self, context: LearnerContext, settings: MixtureSettings) -> None:
        settings.check_budget(context.episodes)
        self._settings = settings
        super().__init__(context, settings.round_size)

    def _make_simulation(self) -> MixtureSampling:
        context = self._context
        return MixtureSampling(
            context.horizon, context.episodes, self._settings.components, (context.seed,)
        )

    def estimate(self) -> Estimate | None:
        """Return the failure probability over the last draws; before the end, why there is none."""
        simulation, result = self._driver.simulation, self._driver.simulation.result
        episodes = simulation.episodes_run
        if not self._driver.is_done:
            unfinished = "The budget ended early." if self._is_spent else "Not known yet."
            problem = f"{unfinished} The estimate rests on the last draws."
            return _refuse(episodes, problem) if episodes else None
        if result is None:
            return _refuse(
                episodes,
                f"Wider noise, up to four sigma, met {simulation.wide_failures} failures, and it "
                f"takes {FEWEST_FAILURES}. {TAKE_SUBSET}, or give it more episodes.",
            )
        return judge_result(result, episodes)


def judge_result(result: MixtureResult, episodes: int) -> Estimate:
    """Return the estimate, or the reason why its number is not to be trusted."""
    if not len(result.weights):
        return _refuse(episodes, f"None of the last draws failed. {TAKE_SUBSET}.")
    effective = result.effective
    if effective < FEWEST_EFFECTIVE:
        return _refuse(
            episodes,
            f"{len(result.weights)} failures are worth {effective:.1f} by their weights, and it "
            f"takes {FEWEST_EFFECTIVE:.0f}: no mixture of normals comes close to these failures. "
            f"{TAKE_SUBSET}, or give it more episodes.",
        )
    index = estimate_tail_index(result.weights)
    if index > LARGEST_TAIL_INDEX:
        return _refuse(
            episodes,
            f"The largest weights are too unequal (tail index {index:.2f}, at most "
            f"{LARGEST_TAIL_INDEX}): rare heavy ones are probably missing. {TAKE_SUBSET}, or give "
            "it more episodes.",
        )
    if result.uncovered > MOST_UNCOVERED:
        return _refuse(
            episodes,
            f"{result.uncovered:.0%} of the failures that were kept from the fit lie where the "
            "mixture hardly draws: it has lost a failure region, or the noise has too many values "
            f"for so few failures. {TAKE_SUBSET}, or give it more episodes.",
        )
    return Estimate(
        by=BY,
        episodes=episodes,
        probability=result.probability,
        cv=result.cv,
        interval=log_normal(result.probability, result.cv, result.effective_for_variance),
        effective=effective,
        note=BLIND,
    )


def _refuse(episodes: int, problem: str) -> Estimate:
    return Estimate(by=BY, episodes=episodes, problem=problem)
