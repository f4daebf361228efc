"""Words for what a planner did in an episode: what decided, what overrode it, what it lost."""

from collections import Counter
from collections.abc import Iterator, Sequence

from eigenfail.stories.moments import NOTHING
from eigenfail.stories.sentences import word
from eigenfail.values import ExplainedEpisode, ExplainedStep
from eigenfail_services.analysis.words import Clock

MOST_RULES = 2


def describe_account(episode: ExplainedEpisode, clock: Clock) -> str:
    """The planner's own account of an episode in a sentence; empty if it explains nothing.

    The names looked for in the account are those of `ExplainingPlanner`.
    """
    steps = episode.steps[: clock.impact]
    told = [part for teller in (rules, overrides, losses) for part in teller(steps, clock)]
    return f"{'; '.join(told)}." if told else ""


def rules(steps: Sequence[ExplainedStep], _clock: Clock) -> Iterator[str]:
    """Which rules decided, and in how many of the steps."""
    counted = Counter(rule for step in steps if (rule := word(step, "rule")) not in NOTHING)
    if counted:
        shares = (
            f"{plain(name)} in {count} of {len(steps)} steps"
            for name, count in sorted(counted.items(), key=lambda each: (-each[1], each[0]))
        )
        yield "what decided: " + ", ".join([*shares][:MOST_RULES])


def overrides(steps: Sequence[ExplainedStep], clock: Clock) -> Iterator[str]:
    """What overrode the plan, from when to when."""
    names = [word(step, "override") for step in steps]
    for name in sorted({*names} - NOTHING):
        places = [place for place, each in enumerate(names) if each == name]
        window = clock.window(places[0], places[-1])
        some = "a step" if len(places) == 1 else f"{len(places)} steps"
        yield f"overridden by {plain(name)} in {some} during {window} before {clock.event}"


def losses(steps: Sequence[ExplainedStep], clock: Clock) -> Iterator[str]:
    """When it lost sight of somebody for the last time."""
    lost = [count(step, "lost_tracks") for step in steps]
    places = [place for place in range(1, len(lost)) if lost[place] > lost[place - 1]]
    if places:
        times = "once," if len(places) == 1 else f"{len(places)} times, the last"
        yield f"it lost a track {times} {clock.moment(places[-1])}"


def count(step: ExplainedStep, name: str) -> float:
    """A number of the account; 0 if it has none of that name, or anything but a number there."""
    try:
        return float(step.account.get(name, 0.0))
    except (TypeError, ValueError):
        return 0.0


def plain(name: str) -> str:
    """A name as people read it."""
    return name.replace("_", " ")
