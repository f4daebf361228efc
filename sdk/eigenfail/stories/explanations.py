"""Everything that is said of an episode that was run again for the sake of its explanation."""

from collections.abc import Sequence
from math import inf

import msgspec

from eigenfail.stories.sentences import story
from eigenfail.values import ExplainedEpisode, ExplainedStep, Explanation, Replayed


class Window(msgspec.Struct, frozen=True):
    """Which steps are shown: every n-th of those between two times, both included [s]."""

    since_s: float
    until_s: float
    every: int

    def of(self, steps: Sequence[ExplainedStep]) -> tuple[ExplainedStep, ...]:
        """The steps shown."""
        picked = steps[:: self.every]
        return tuple(step for step in picked if self.since_s <= step.time_s <= self.until_s)


WHOLE = Window(-inf, inf, 1)


def explanation_of(
    episode: str, planner: str, replayed: Replayed, explained: ExplainedEpisode, window: Window
) -> Explanation:
    """Everything that is said of an episode."""
    silent = not any(step.account for step in explained.steps)
    return Explanation(
        episode=episode,
        planner=planner,
        replayed=replayed,
        verdict=verdict(replayed),
        note=f"The planner '{planner}' explains nothing: {NO_ACCOUNT}" if silent else "",
        steps=window.of(explained.steps),
        story=tuple(story(explained)),
    )


NO_ACCOUNT = "it has no `explain`, or says nothing there. What follows are its controls alone."


def verdict(replayed: Replayed) -> str:
    """Whether the replay is the stored episode, in a sentence."""
    if replayed.same:
        return (
            "What is told here comes from a run of its own, which gave the stored episode bit for "
            f"bit: digest {replayed.digest}."
        )
    return (
        f"DIFFERENT: the replay ({replayed.outcome}, digest {replayed.digest}) is not the stored"
        f" episode ({replayed.stored_outcome}, digest {replayed.stored_digest}); what follows is of"
        " the replay. Use the versions and the type of machine that the campaign ran on."
    )
