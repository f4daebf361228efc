"""The noise margin of a planner: the largest scale of the noise at which it passes.

A scale passes if no failure is found at it, or if its failure rate is at most a target with 95 %
confidence. The margin is found by bisection. Each step is a campaign, which is created once and
found again.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import StrEnum
from math import ceil, exp, lgamma, log, log1p, sqrt
from typing import Annotated, Protocol

import msgspec
from msgspec.structs import replace

from eigenfail.client import Client
from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.methods import traits_of
from eigenfail.presentation.figures import format_share, round_up
from eigenfail.suites import Suite, SuiteMember
from eigenfail.values import Campaign, CampaignSpec, CampaignState, Interval, Rate

LARGEST_SCALE = 10.0
FINEST = 1e-3

Scale = Annotated[float, msgspec.Meta(gt=0.0, le=LARGEST_SCALE)]


class ScaleRange(msgspec.Struct, frozen=True):
    """Range of scales to search.

    Attributes:
        low: smallest scale; it is always tried.
        high: largest scale; it is always tried.
        tolerance: the search ends when an unsafe scale is this close to a safe one.
    """

    low: Scale
    high: Scale
    tolerance: Annotated[float, msgspec.Meta(ge=FINEST, le=LARGEST_SCALE)]

    def __post_init__(self) -> None:
        """Raise InvalidValue for an empty range."""
        if not self.low < self.high:
            raise InvalidValue("low", f"{self.low:g} is not below the high end, {self.high:g}.")

    def holds(self, scale: float) -> bool:
        """Whether a scale is in the range, ends included."""
        return self.low <= scale <= self.high


class ScaleVerdict(StrEnum):
    """What the episodes of a scale show."""

    PASSED = "passed"
    UNDECIDED = "undecided"
    FAILING = "failing"


class Criterion(Protocol):
    """What makes a scale pass."""

    @property
    def failures(self) -> int | None:
        """Number of failures that decide a step, and end its campaign; None if no number does."""

    def judge(self, rate: Rate) -> ScaleVerdict:
        """Return what the failure rate of a scale shows."""

    def describe(self, step: "MarginStep") -> str:
        """Return what the step shows about its scale, as a clause."""


class NoFailure(msgspec.Struct, frozen=True):
    """A scale passes if the search finds no failure, which does not prove that there is none."""

    failures: int | None = 1

    def judge(self, rate: Rate) -> ScaleVerdict:
        """Return what the failure rate of a scale shows."""
        return ScaleVerdict.FAILING if rate.k else ScaleVerdict.PASSED

    def describe(self, step: "MarginStep") -> str:
        """Return what the step shows about its scale, as a clause."""
        if step.verdict is ScaleVerdict.FAILING:
            return f"a failure was found at {_times(step)} the specified noise"
        words = f"no failure was found in {_count_episodes(step)}"
        return f"{words} at {_times(step)} the specified noise"


class RateAtMost(msgspec.Struct, frozen=True):
    """A scale passes if its failure rate is at most a target, with 95 % confidence.

    Attributes:
        target: largest failure rate that is accepted.
        failures: the fewest failures that show a larger rate within the budget.
    """

    target: float
    failures: int | None

    def judge(self, rate: Rate) -> ScaleVerdict:
        """Return what the failure rate of a scale shows.

        Raises:
            InvalidValue: the episodes are not drawn from p(x), so that they bound no rate.
        """
        if rate.interval is None:
            raise InvalidValue(
                "target", "the method chooses its noise: its episodes bound no failure rate.", MC
            )
        if rate.interval.high <= self.target:
            return ScaleVerdict.PASSED
        return ScaleVerdict.FAILING if rate.interval.low > self.target else ScaleVerdict.UNDECIDED

    def describe(self, step: "MarginStep") -> str:
        """Return what the step shows about its scale, as a clause."""
        where, share = f"at {_times(step)} the specified noise", f"{100.0 * self.target:.4g} %"
        counted = f"{step.failures} of {_count_episodes(step)} failed"
        words = {
            ScaleVerdict.PASSED: f"with 95 % confidence at most {share} of the episodes fail",
            ScaleVerdict.FAILING: f"with 95 % confidence more than {share} of the episodes fail",
            ScaleVerdict.UNDECIDED: f"it is undecided whether at most {share} of the episodes fail",
        }
        return f"{words[step.verdict]} {where} ({counted})"


MC = "Use monte_carlo, or search without a target."
ONE_SIDED = 0.05
TAIL = 0.025


def choose_criterion(target: float | None, spec: CampaignSpec) -> Criterion:
    """Return the criterion of a target; without one, a scale passes if no failure is found.

    Raises:
        InvalidValue: the method chooses its noise, or the budget cannot show the target.
    """
    if target is None:
        return NoFailure()
    if not traits_of(spec.method).draws_from_prior:
        problem = f"'{spec.method}' chooses its noise: its episodes bound no failure rate."
        raise InvalidValue("target", problem, MC)
    fewest = ceil(log(ONE_SIDED) / log1p(-target))
    if spec.episodes < fewest:
        raise InvalidValue(
            "episodes",
            f"{spec.episodes} cannot show a failure rate of at most {target:g}.",
            f"Give {fewest} or more: without a failure they show it with 95 % confidence.",
        )
    return RateAtMost(target, find_fewest_failures(target, spec.episodes))


def find_fewest_failures(target: float, episodes: int) -> int | None:
    """Return the smallest k with P(k or more of n episodes fail) < 2.5 % at the target rate.

    It is the smallest k at which Clopper and Pearson's interval lies above the target. None where
    even n of n failures are likelier.
    """
    log_p, log_q, above = log(target), log1p(-target), 0.0
    # What lies twenty standard deviations above the mean has no weight.
    mean = episodes * target
    most = min(episodes, ceil(mean + 20.0 * sqrt(mean) + 40.0))
    for k in range(most, -1, -1):
        ways = lgamma(episodes + 1) - lgamma(k + 1) - lgamma(episodes - k + 1)
        above += exp(ways + k * log_p + (episodes - k) * log_q)
        if above >= TAIL:
            return k + 1 if k < episodes else None
    return None


class MarginStep(msgspec.Struct, frozen=True, kw_only=True):
    """Result of the search at one scale.

    Attributes:
        scale: scale of the disturbance model, which replaces its own.
        campaign: id of the campaign.
        episodes: number of completed episodes.
        failures: number of episodes that ended in a collision.
        verdict: what they show.
        interval: 95 % interval of the failure rate under this noise; after no failure its upper
            end is one-sided (near 3 ÷ episodes: the rule of three). None for methods that choose
            their noise, whose episodes bound no failure rate.
    """

    scale: float
    campaign: int
    episodes: int
    failures: int
    verdict: ScaleVerdict
    interval: Interval | None = None

    @property
    def is_safe(self) -> bool:
        """Whether the scale is safe by the criterion of the search."""
        return self.verdict is ScaleVerdict.PASSED


class Margin(msgspec.Struct, frozen=True, kw_only=True):
    """Scales between which a planner begins to fail.

    Attributes:
        largest_safe: the largest scale below every unsafe one; None if the smallest scale is not
            safe.
        smallest_unsafe: the smallest scale that is failing or undecided; None if all are safe.
        contrary: safe scales above `smallest_unsafe`: the search is not monotone.
        steps: all steps, by scale.
    """

    largest_safe: MarginStep | None
    smallest_unsafe: MarginStep | None
    contrary: tuple[float, ...]
    steps: tuple[MarginStep, ...]


def find_margin(
    measure: Callable[[float], MarginStep], within: ScaleRange, known: Iterable[MarginStep] = ()
) -> Margin:
    """Try both ends, then halve the gap between safe and failing until it is within tolerance.

    Args:
        measure: runs the step of a scale.
        within: range and tolerance of the search.
        known: earlier steps; those outside the range are ignored.
    """
    steps = {step.scale: step for step in known if within.holds(step.scale)}
    while (scale := _find_next_scale(steps, within)) is not None:
        steps[scale] = measure(scale)
    return _summarize_steps(steps.values())


def _find_next_scale(steps: Mapping[float, MarginStep], within: ScaleRange) -> float | None:
    """Return the next scale to try; None once the margin is within tolerance."""
    for end in (within.low, within.high):
        if end not in steps:
            return end
    seen = _summarize_steps(steps.values())
    if seen.largest_safe is None or seen.smallest_unsafe is None:
        return None
    safe, unsafe = seen.largest_safe.scale, seen.smallest_unsafe.scale
    return None if unsafe - safe <= within.tolerance else (safe + unsafe) / 2.0


def _summarize_steps(steps: Iterable[MarginStep]) -> Margin:
    """Combine steps into a margin; where they contradict each other, the cautious way."""
    ordered = tuple(sorted(steps, key=lambda step: step.scale))
    unsafe = next((step for step in ordered if not step.is_safe), None)
    before = ordered.index(unsafe) if unsafe else len(ordered)
    return Margin(
        largest_safe=ordered[before - 1] if before else None,
        smallest_unsafe=unsafe,
        contrary=tuple(step.scale for step in ordered[before:] if step.is_safe),
        steps=ordered,
    )


def describe_margin(margin: Margin, criterion: Criterion, method: str) -> list[str]:
    """Describe a margin in sentences: the verdict, contradictions, what is not shown."""
    return [
        _describe_verdict(margin, criterion),
        *_describe_contradictions(margin),
        *_describe_limits(margin, method),
    ]


def _describe_verdict(margin: Margin, criterion: Criterion) -> str:
    safe, unsafe = margin.largest_safe, margin.smallest_unsafe
    if safe is None and unsafe is not None:
        return (
            f"{_capitalize(criterion.describe(unsafe))}, the low end of the search: no margin can "
            f"be given. {_advise_lower(unsafe)}"
        )
    if safe is not None and unsafe is None:
        return (
            f"{_capitalize(criterion.describe(safe))}, the high end of the search: the margin may "
            "be larger. Search higher, or with another method."
        )
    if safe is None or unsafe is None:
        return "No scale was tested."
    found = f"{_capitalize(criterion.describe(safe))}; {criterion.describe(unsafe)}."
    if unsafe.verdict is ScaleVerdict.UNDECIDED:
        return f"{found} More episodes may decide it."
    return found


def _advise_lower(unsafe: MarginStep) -> str:
    if unsafe.verdict is ScaleVerdict.UNDECIDED:
        return "Give more episodes, or search lower."
    return "Search lower."


def _capitalize(clause: str) -> str:
    return clause[0].upper() + clause[1:]


def _count_episodes(step: MarginStep) -> str:
    return f"{step.episodes} episode{'s' * (step.episodes != 1)}"


def _describe_contradictions(margin: Margin) -> Iterator[str]:
    if margin.contrary and margin.smallest_unsafe:
        above = ", ".join(f"{scale:.4g} ×" for scale in margin.contrary)
        yield (
            f"Not monotone: {above} passed, above {_times(margin.smallest_unsafe)}, which did not. "
            "The cautious reading counts; a larger budget may settle it."
        )


def _describe_limits(margin: Margin, method: str) -> Iterator[str]:
    safe = margin.largest_safe
    if safe is None:
        return
    if safe.interval is None:
        limit = f"'{method}' chooses its noise, so that its episodes bound no failure rate"
    else:
        share = f"at most {format_share(round_up(safe.interval.high))}"
        limit = f"with 95 % confidence {share} of the episodes under this noise fail"
    if not safe.failures:
        yield (
            f"No failure found in {_count_episodes(safe)} at {_times(safe)} is not proof that there"
            f" is none: {limit}."
        )
    yield "Each scale is judged by itself: the confidence is that of one scale, not of the search."


def _times(step: MarginStep) -> str:

    return f"{step.scale:.4g} ×"


def build_step_suite(spec: CampaignSpec, scale: float, criterion: Criterion) -> Suite:
    """Return the campaign of a scale, as a suite of one member; what decides it ends it."""
    name = f"margin of {spec.name}: scale={scale:.10g}"
    tried = replace(
        spec,
        name=name,
        disturbance=replace(spec.disturbance, scale=scale),
        stop=replace(spec.stop, failures=criterion.failures),
    )
    return Suite(name, (SuiteMember(name, tried),))


def list_known_steps(
    client: Client, spec: CampaignSpec, criterion: Criterion
) -> Iterator[MarginStep]:
    """List the steps of the same search that the service has run before, at any scale.

    Raises:
        ServiceUnreachable: no service answers.
    """
    for campaign in client.campaigns.list(CampaignState.DONE):
        scale = campaign.spec.disturbance.scale
        tried = build_step_suite(spec, scale, criterion).members[0].spec
        if campaign.counts.completed and campaign.spec.is_like(tried):
            yield read_step(client, campaign, criterion)


def read_step(client: Client, campaign: Campaign, criterion: Criterion) -> MarginStep:
    """Read the step of a campaign.

    Raises:
        ServiceError: the campaign completed no episode, or did not end and does not show either
            that its scale is failing.
    """
    rate = client.campaigns.summary(campaign.id).failure_rate
    is_done = campaign.state is CampaignState.DONE
    if rate is None or not (is_done or criterion.judge(rate) is ScaleVerdict.FAILING):
        came = f"{campaign.state_word} after {campaign.counts.completed} completed episodes"
        raise ServiceError(
            f"Campaign {campaign.id} is {came}: it cannot show whether its scale passes.",
            f"See why: eigenfail campaign show {campaign.id}. Then use another seed or budget: "
            "the same search would find the same campaign.",
        )
    return MarginStep(
        scale=campaign.spec.disturbance.scale,
        campaign=campaign.id,
        episodes=rate.n,
        failures=rate.k,
        verdict=criterion.judge(rate),
        interval=rate.interval,
    )
