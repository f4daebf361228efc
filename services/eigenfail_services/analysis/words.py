"""Sentences about noise and about a planner's account of an episode, from plain templates.

The sentences describe the direction, strength and time of shifts in perceived values. They also
name the planner's rules that decided, and its overrides and lost tracks. Times count back from the
impact, the end of the last step: noise in the last step of 0.1 s acts from 0.1 to 0.0 s before it.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from eigenfail.explanations import NOTHING, read_word
from eigenfail.presentation.figures import count_noun
from eigenfail.values.arrays import Floats
from eigenfail.values.channels import split_name
from eigenfail.values.disturbance import AXES, NoiseTrajectory
from eigenfail.values.proof import ExplainedEpisode, ExplainedStep
from eigenfail.values.shapes import Markov, NoiseShape, Once, PerChannel, White

TELLING = 0.5
"""Share of a channel's strongest noise above which a step is described, if noise is everywhere."""

FAINT = 0.5
"""Noise that is everywhere but nowhere above this says nothing. [sigma]"""

JOINED = 3
"""Steps of less noise between two pushes the same way that make them one."""

MOST_PUSHES, MOST_CHANNELS = 3, 2
MOST_NEEDED, MOST_NEEDED_CHANNELS = 8, 4
"""Maximum number of pushes described of a channel, and of channels; further ones are counted. Of
noise that is needed, more are described."""

WAYS = {"longitudinal": ("ahead", "back"), "lateral": ("to the left", "to the right")}
"""Of positive and of negative noise of a position: where the vehicle seems to be."""

ABSENT = (
    " An event is absent at the centre of a group unless most of its failures have it at the same "
    "step."
)

WHITE = White()


class Push(NamedTuple):
    """Noise of one sign in one channel.

    Attributes:
        first: first step; `last` is the last step, included.
        steps: number of steps between both that reach the wanted level.
        mean: mean of z over these steps; `peak` is their strongest value. [sigma]
    """

    first: int
    last: int
    steps: int
    mean: float
    peak: float


class ChannelNoise(NamedTuple):
    """The noise of one channel, with its description.

    Attributes:
        noise: z, or 1 while an event lasts, shape (steps,).
        level: steps with less noise are left out.
    """

    name: str
    noise: Floats
    level: float
    is_event: bool


class Clock(NamedTuple):
    """The time of steps, counted back from the impact.

    Attributes:
        impact: number of steps until the impact; later steps do not count.
        step_s: duration of a step; None if steps are not timed. [s]
        event: name of the event that ends the steps.
    """

    impact: int
    step_s: float | None
    event: str = "the impact"

    def describe_time(self, step: int) -> str:
        """Return the time at which a step begins."""
        before = self.impact - step
        if self.step_s is None:
            return f"{before} steps before {self.event}"
        return f"{before * self.step_s:.1f} s before {self.event}"

    def describe_span(self, first: int, last: int) -> str:
        """Return the time from the beginning of one step to the end of another step."""
        before = self.impact - first, self.impact - last - 1
        if self.step_s is None:
            return f"{before[0]} … {before[1]} steps"
        since_s, until_s = (count * self.step_s for count in before)
        return f"{since_s:.1f} … {until_s:.1f} s"


def describe(
    z: Floats, clock: Clock, channels: Sequence[str] = AXES, shape: NoiseShape = WHITE
) -> str:
    """Describe noise that is present at all steps, by its strong moments in each channel.

    Args:
        z: shape (steps, channels). [sigma]
        clock: time of the impact.
        channels: the names of the columns of z.
        shape: shape of the noise, which turns z into events and values that are drawn once.
    """
    # A level for each channel: the strongest one would hide the moments of all others.
    columns = [
        each._replace(level=_choose_level(each.noise))
        for each in _list_columns(z[: clock.impact], channels, shape)
    ]
    ranked = _rank_columns(columns)
    absent = any(each.is_event and not each.noise.any() for each, _ in ranked[:MOST_CHANNELS])
    told = _describe_columns(ranked, clock, MOST_PUSHES, MOST_CHANNELS)
    return f"{told}{ABSENT * absent}"


def _list_columns(z: Floats, channels: Sequence[str], shape: NoiseShape) -> list[ChannelNoise]:
    """Return the noise of each channel: z, or u for channels whose z alone says little."""
    if not isinstance(shape, PerChannel):
        pairs = zip(channels, z.T, strict=True)
        return [ChannelNoise(name, noise, 0.0, is_event=False) for name, noise in pairs]
    # A mode has no distances: the rate of an event that depends on them is that at no distance.
    u = NoiseTrajectory(z, np.zeros_like(z), shape).standardised
    told = [isinstance(one, Markov | Once) for one in shape.shapes]
    columns = zip(channels, np.where(told, u, z).T, shape.shapes, strict=True)
    return [ChannelNoise(name, noise, 0.0, isinstance(one, Markov)) for name, noise, one in columns]


def describe_needed(
    z: Floats, clock: Clock, channels: Sequence[str] = AXES, shape: NoiseShape = WHITE
) -> str:
    """Describe noise whose steps all count, as in a minimal failure.

    Args:
        z: shape (steps, channels), zero if nothing is needed. [sigma]
        clock: time of the impact.
        channels: the names of the columns of z.
        shape: shape of the noise, which turns z into events.
    """
    # What comes after the impact cannot have caused it.
    if not z[: clock.impact].any():
        return "It needs no noise at all."
    ranked = _rank_columns(_list_columns(z[: clock.impact], channels, shape))
    return _describe_columns(ranked, clock, MOST_NEEDED, MOST_NEEDED_CHANNELS)


def find_pushes(noise: Floats, level: float) -> list[Push]:
    """Return the moments of one channel whose noise reaches a level, the strongest first.

    Args:
        noise: shape (steps,). [sigma]
        level: steps below it are left out; noise of 0 is always left out.
    """
    strengths = [
        (step, value) for step, value in enumerate(noise.tolist()) if value and abs(value) >= level
    ]
    found = [_push(run) for run in _split_runs(strengths)]
    return sorted(found, key=lambda push: (-_sum_push(push), push.first))


def _split_runs(strengths: Sequence[tuple[int, float]]) -> Iterator[list[tuple[int, float]]]:
    """Yield the steps of one sign that are adjacent, or nearly."""
    for _, same in groupby(strengths, key=lambda step: step[1] > 0.0):
        run: list[tuple[int, float]] = []
        for step in same:
            if run and step[0] - run[-1][0] > JOINED + 1:
                yield run
                run = []
            run.append(step)
        yield run


def _push(run: Sequence[tuple[int, float]]) -> Push:
    values = [value for _, value in run]
    return Push(run[0][0], run[-1][0], len(run), float(np.mean(values)), max(values, key=abs))


def _choose_level(noise: Floats) -> float:
    """Return the least noise of a channel that is described. [sigma]"""
    strongest = float(np.abs(noise).max(initial=0.0))
    return float("inf") if strongest < FAINT else TELLING * strongest


def _rank_columns(columns: Sequence[ChannelNoise]) -> list[tuple[ChannelNoise, list[Push]]]:
    """Return all channels with their pushes, the channel with the strongest pushes first."""
    found = [(column, find_pushes(column.noise, column.level)) for column in columns]
    return sorted(found, key=lambda each: -sum(map(_sum_push, each[1])))


def _describe_columns(
    ranked: Sequence[tuple[ChannelNoise, list[Push]]],
    clock: Clock,
    most_pushes: int,
    most_channels: int,
) -> str:
    """Return a sentence on the first channels, with the number of further channels."""
    phrases = []
    for column, pushes in ranked[:most_channels]:
        phrase = _describe_column(column, pushes[:most_pushes], clock)
        weaker = len(pushes) - most_pushes
        phrases.append(f"{phrase}, and {weaker} weaker" if weaker > 0 else phrase)
    text = "; ".join(phrases)
    if len(ranked) > most_channels:
        text += f"; {count_noun(len(ranked) - most_channels, 'further channel')} with less noise"
    return f"{text[:1].upper()}{text[1:]}."


def _sum_push(push: Push) -> float:
    """Return the sum of a push's noise."""
    return abs(push.mean) * push.steps


def _describe_column(column: ChannelNoise, found: Sequence[Push], clock: Clock) -> str:
    """Return the description of the noise of one channel."""
    channel, noise = column.name, column.noise
    if not noise.any():
        return f"{channel} does not occur" if column.is_event else f"{channel} noise has no effect"
    if not found:
        # Rounded up, so that the bound holds as it is written.
        bound = np.ceil(10.0 * float(np.abs(noise).max())) / 10.0
        return f"{channel} noise stays within {bound:.1f} sigma"
    # The strongest were chosen; people read them in the order in which they happen.
    in_time = sorted(found, key=lambda push: push.first)
    describe_one = _describe_event if column.is_event else _describe_push
    text = ", ".join(describe_one(push, channel, clock) for push in in_time)
    return f"{channel} {text} before {clock.event}"


def _describe_event(push: Push, _channel: str, clock: Clock) -> str:
    """Return the time span of an event."""
    length = push.last - push.first + 1
    some = "" if push.steps == length else f"in {push.steps} of {length} steps "
    return f"{some}during {clock.describe_span(push.first, push.last)}"


def _describe_push(push: Push, channel: str, clock: Clock) -> str:
    """Return the description of a push; its strongest moment only if it differs from its mean."""
    ways = WAYS.get(split_name(channel).quantity)
    way = f" ({ways[push.mean < 0.0]})" if ways else ""
    mean, peak = f"{push.mean:+.1f}", f"{push.peak:+.1f}"
    length = push.last - push.first + 1
    some = "" if push.steps == length else f" in {push.steps} of {length} steps"
    more = "" if peak == mean else f", peak {peak},"
    return f"{mean} sigma{way}{more}{some} during {clock.describe_span(push.first, push.last)}"


MOST_RULES = 2


def describe_account(episode: ExplainedEpisode, clock: Clock) -> str:
    """Return the planner's own account of an episode in a sentence; empty without content.

    If the episode fails in the same way without noise, the sentence begins with this fact.

    `ExplainingPlanner` defines the names that are read from the account.
    """
    steps = episode.steps[: clock.impact]
    phrases = [
        part
        for teller in (_describe_rules, _describe_overrides, _describe_losses)
        for part in teller(steps, clock)
    ]
    if episode.fails_alike:
        phrases.insert(0, "without noise it fails as well: noise is not what makes it fail")
    return f"{'; '.join(phrases)}." if phrases else ""


def _describe_rules(steps: Sequence[ExplainedStep], _clock: Clock) -> Iterator[str]:
    """Yield the rules that decided, with their numbers of steps."""
    counted = Counter(rule for step in steps if (rule := read_word(step, "rule")) not in NOTHING)
    if counted:
        shares = (
            f"{_make_plain(name)} in {count} of {len(steps)} steps"
            for name, count in sorted(counted.items(), key=lambda each: (-each[1], each[0]))
        )
        yield "the planner's rules that decided: " + ", ".join([*shares][:MOST_RULES])


def _describe_overrides(steps: Sequence[ExplainedStep], clock: Clock) -> Iterator[str]:
    """Yield the overrides of the plan with their times."""
    names = [read_word(step, "override") for step in steps]
    # Sorted, so that the same episode has the same words in every process.
    for name in sorted({*names} - NOTHING):
        places = [place for place, each in enumerate(names) if each == name]
        window = clock.describe_span(places[0], places[-1])
        some = "a step" if len(places) == 1 else f"{len(places)} steps"
        yield f"overridden by {_make_plain(name)} in {some} during {window} before {clock.event}"


def _describe_losses(steps: Sequence[ExplainedStep], clock: Clock) -> Iterator[str]:
    """Describe when the planner lost a track for the last time."""
    lost = [_count(step, "lost_tracks") for step in steps]
    places = [place for place in range(1, len(lost)) if lost[place] > lost[place - 1]]
    if places:
        times = "once," if len(places) == 1 else f"{len(places)} times, the last"
        yield f"it lost a track {times} {clock.describe_time(places[-1])}"


def _count(step: ExplainedStep, name: str) -> float:
    """Return a number of the account; 0 if the name is missing or its value is not a number."""
    try:
        return float(step.account.get(name, 0.0))
    except (TypeError, ValueError):
        return 0.0


def _make_plain(name: str) -> str:
    """Return a name in readable form."""
    return name.replace("_", " ")
