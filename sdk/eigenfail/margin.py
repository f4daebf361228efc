"""The noise margin of a planner: the largest scale of the noise at which no failure is found.

The margin is found by bisection. Each step is a campaign, which is created once and found again.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Annotated

import msgspec
from msgspec.structs import replace

from eigenfail.client import Client
from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.suites import Suite, SuiteMember
from eigenfail.values import Campaign, CampaignSpec, CampaignState

LARGEST_SCALE = 10.0
FINEST = 1e-3

Scale = Annotated[float, msgspec.Meta(gt=0.0, le=LARGEST_SCALE)]


class ScaleRange(msgspec.Struct, frozen=True):
    """Range of scales to search.

    Attributes:
        low: smallest scale; it is always tried.
        high: largest scale; it is always tried.
        tolerance: the search ends when a scale with failures is this close to one without.
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


class MarginStep(msgspec.Struct, frozen=True, kw_only=True):
    """Result of the search at one scale.

    Attributes:
        scale: scale of the disturbance model, which replaces its own.
        campaign: id of the campaign.
        episodes: number of completed episodes.
        failures: number of episodes that ended in a collision.
        upper_bound: upper bound of the failure rate under this noise if none failed (95 %; near
            3 ÷ episodes: the rule of three). None after a failure, which ends the step, and for
            methods that choose their noise, whose episodes bound no failure rate.
    """

    scale: float
    campaign: int
    episodes: int
    failures: int
    upper_bound: float | None = None

    @property
    def is_safe(self) -> bool:
        """Whether no failure was found, which does not prove that there is none."""
        return self.failures == 0


class Margin(msgspec.Struct, frozen=True, kw_only=True):
    """Scales between which a planner begins to fail.

    Attributes:
        largest_safe: the largest scale without a failure below all scales with one; None if the
            smallest scale has failures.
        smallest_failing: the smallest scale with a failure; None if no scale has one.
        contrary: scales without a failure above `smallest_failing`: the search is not monotone.
        steps: all steps, by scale.
    """

    largest_safe: MarginStep | None
    smallest_failing: MarginStep | None
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
    if seen.largest_safe is None or seen.smallest_failing is None:
        return None
    safe, failing = seen.largest_safe.scale, seen.smallest_failing.scale
    return None if failing - safe <= within.tolerance else (safe + failing) / 2.0


def _summarize_steps(steps: Iterable[MarginStep]) -> Margin:
    """Combine steps into a margin; where they contradict each other, the cautious way."""
    ordered = tuple(sorted(steps, key=lambda step: step.scale))
    failing = next((step for step in ordered if not step.is_safe), None)
    before = ordered.index(failing) if failing else len(ordered)
    return Margin(
        largest_safe=ordered[before - 1] if before else None,
        smallest_failing=failing,
        contrary=tuple(step.scale for step in ordered[before:] if step.is_safe),
        steps=ordered,
    )


def describe_margin(margin: Margin, method: str) -> list[str]:
    """Describe a margin in sentences: the verdict, contradictions, confidence."""
    return [
        _describe_verdict(margin),
        *_describe_contradictions(margin),
        *_describe_confidence(margin, method),
    ]


def _describe_verdict(margin: Margin) -> str:

    safe, failing = margin.largest_safe, margin.smallest_failing
    if safe is None and failing is not None:
        return (
            f"A failure was found at {_times(failing)} the noise, the low end of the search:"
            " no margin can be given. Search lower."
        )
    if safe is not None and failing is None:
        return (
            f"No failure was found up to {_times(safe)} the noise, the high end of the search:"
            " the margin may be larger. Search higher, or with another method."
        )
    if safe is None or failing is None:
        return "No scale was tested."
    return _describe_gap(safe, failing)


def _describe_gap(safe: MarginStep, failing: MarginStep) -> str:

    measured = (
        f"No failure was found in {_count_episodes(safe)} at {_times(safe)} the specified noise;"
        f" a failure was found at {_times(failing)}."
    )
    if safe.scale > 1.0:
        return f"{measured} The search found no failure at the specified noise."
    if failing.scale <= 1.0:
        return f"{measured} The planner does not meet the specified noise."
    return f"{measured} The search shows no margin above the specified noise."


def _count_episodes(step: MarginStep) -> str:

    return f"{step.episodes} episode{'s' * (step.episodes != 1)}"


def _describe_contradictions(margin: Margin) -> Iterator[str]:

    if margin.contrary and margin.smallest_failing:
        above = ", ".join(f"{scale:.4g} ×" for scale in margin.contrary)
        yield (
            f"Not monotone: no failure was found at {above}, above the failure at"
            f" {_times(margin.smallest_failing)}. The cautious reading counts;"
            " a larger budget may settle it."
        )


def _describe_confidence(margin: Margin, method: str) -> Iterator[str]:

    safe = margin.largest_safe
    if safe is None:
        return
    if safe.upper_bound is None:
        limit = f"'{method}' chooses its noise, so that its episodes bound no failure rate"
    else:
        share = f"at most {100.0 * safe.upper_bound:.2g} %"
        limit = f"with 95 % confidence {share} of the episodes under this noise fail"
    yield (
        f"No failure found in {_count_episodes(safe)} at {_times(safe)} is not proof that there"
        f" is none: {limit}."
    )


def _times(step: MarginStep) -> str:

    return f"{step.scale:.4g} ×"


def build_step_suite(spec: CampaignSpec, scale: float) -> Suite:
    """Return the campaign of a scale, as a suite of one member; the first failure ends it."""
    name = f"margin of {spec.name}: scale={scale:.10g}"
    tried = replace(
        spec,
        name=name,
        disturbance=replace(spec.disturbance, scale=scale),
        stop=replace(spec.stop, failures=1),
    )
    return Suite(name, (SuiteMember(name, tried),))


def list_known_steps(client: Client, spec: CampaignSpec) -> Iterator[MarginStep]:
    """List the steps of the same search that the service has run before, at any scale.

    Raises:
        ServiceUnreachable: no service answers.
    """
    for campaign in client.campaigns.list(CampaignState.DONE):
        scale = campaign.spec.disturbance.scale
        tried = build_step_suite(spec, scale).members[0].spec
        if campaign.counts.completed and campaign.spec.is_like(tried):
            yield read_step(client, campaign)


def read_step(client: Client, campaign: Campaign) -> MarginStep:
    """Read the step of a campaign.

    Raises:
        ServiceError: the campaign did not end, or completed no episode.
    """
    rate = client.campaigns.summary(campaign.id).failure_rate
    if rate is None or (campaign.state is not CampaignState.DONE and not rate.k):
        came = f"{campaign.state_word} after {campaign.counts.completed} completed episodes"
        raise ServiceError(
            f"Campaign {campaign.id} is {came}: it cannot show whether its scale is safe.",
            f"See why: eigenfail campaign show {campaign.id}. Then use another seed or budget: "
            "the same search would find the same campaign.",
        )
    return MarginStep(
        scale=campaign.spec.disturbance.scale,
        campaign=campaign.id,
        episodes=rate.n,
        failures=rate.k,
        upper_bound=rate.interval.high if rate.sampled and not rate.k else None,
    )
