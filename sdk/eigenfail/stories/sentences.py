"""What happened in an explained episode, in words: a sentence for each thing of note, in order.

The names that a planner's account may use for these things are those of `ExplainingPlanner`.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import groupby, pairwise
from math import isfinite
from statistics import fmean
from typing import NamedTuple

from eigenfail.values import EpisodeResult, ExplainedEpisode, ExplainedStep, Outcome

MISJUDGED_MPS = 3.0
"""A closing speed believed to be this much lower than the true one is worth a sentence."""
BRAKED_MPS2 = 0.1
FEW = 3
"""More spans of a kind than this are told in one sentence."""

Steps = Sequence[ExplainedStep]


class Happening(NamedTuple):
    """Something of note, and when."""

    time_s: float
    text: str


def story(episode: ExplainedEpisode) -> list[str]:
    """The episode in sentences, in the order of time."""
    happened = [found for teller in TELLERS for found in teller(episode)]
    return [f"{text}." for _, text in sorted(happened, key=lambda found: found.time_s)]


def lost_tracks(episode: ExplainedEpisode) -> Iterator[Happening]:
    """When the planner lost sight of somebody."""
    for before, now in pairwise(episode.steps):
        lost = figure(now, "lost_tracks"), figure(before, "lost_tracks")
        if lost[0] > lost[1]:
            truth = f"{number(now.gap_m, 0)} m, closing at {number(now.closing_mps, 1)} m/s"
            yield Happening(now.time_s, f"At {at(now)} a track was lost; the true gap: {truth}")


def blindness(episode: ExplainedEpisode) -> Iterator[Happening]:
    """When it heeded nobody, though somebody was ahead."""
    spans = spans_of(episode.steps, lambda step: says("heeds", "nobody", step) and ahead(step))
    yield from told(spans, "it heeded nobody ahead")


def misjudgement(episode: ExplainedEpisode) -> Iterator[Happening]:
    """When it believed to close in far slower than it did; the first look is forgiven."""
    judged = [step for step in episode.steps if misjudged_by(step) is not None]
    settled_s = next((step.time_s for step in judged if not is_misjudged(step)), 0.0)
    later = [step for step in episode.steps if step.time_s >= settled_s]
    for span in spans_of(later, is_misjudged):
        believed = fmean(figure(step, "closing_mps") for step in span)
        true = fmean(step.closing_mps or 0.0 for step in span)
        text = f"it believed to close in at {believed:.1f} m/s on average; in truth {true:.1f} m/s"
        yield Happening(span[0].time_s, f"{during(span)} {text}")


def leads(episode: ExplainedEpisode) -> Iterator[Happening]:
    """When it took the vehicle ahead for its lead."""
    spans = spans_of(episode.steps, partial(says, "heeds", "lead"))
    yield from told(spans, "it took the vehicle ahead for its lead")


def overrides(episode: ExplainedEpisode) -> Iterator[Happening]:
    """When something overrode the plan."""
    names = dict.fromkeys(word(step, "override") for step in episode.steps)
    for name in names.keys() - {"", "none"}:
        spans = spans_of(episode.steps, partial(says, "override", name))
        yield from told(spans, f"the plan was overridden: {name.replace('_', ' ')}")


def unsolved(episode: ExplainedEpisode) -> Iterator[Happening]:
    """When the quadratic program gave no answer."""
    spans = spans_of(episode.steps, lambda step: word(step, "qp_status") not in ("", "solved"))
    yield from told(spans, "the quadratic program was not solved")


def braking(episode: ExplainedEpisode) -> Iterator[Happening]:
    """The hardest braking."""
    hardest = min(episode.steps, key=lambda step: step.acceleration_mps2, default=None)
    if hardest is not None and hardest.acceleration_mps2 < -BRAKED_MPS2:
        braked = f"it braked hardest: {-hardest.acceleration_mps2:.2f} m/s²"
        yield Happening(hardest.time_s, f"At {at(hardest)} {braked}")


def ending(episode: ExplainedEpisode) -> Iterator[Happening]:
    """How it ended."""
    yield Happening(float("inf"), ENDINGS[episode.result.outcome](episode.result))


def collided(result: EpisodeResult) -> str:
    """The collision; it is seen at the end of the last step."""
    severity = result.measures.severity if result.measures else None
    after_s = result.scene.dt_s * result.steps if result.scene else None
    return f"After {number(after_s, 1)} s collision: severity {number(severity, 1)} m²/s²"


def stayed_safe(result: EpisodeResult) -> str:
    """How near it came."""
    nearest_m = result.measures.robustness_m if result.measures else None
    return f"No collision: never nearer than {number(nearest_m, 1)} m"


def broke_off(result: EpisodeResult) -> str:
    """Why it could not go on."""
    why = result.fault.message.rstrip(".") if result.fault else "no reason was kept"
    return f"After {result.steps} steps the episode could not go on: {why}"


ENDINGS: dict[Outcome, Callable[[EpisodeResult], str]] = {
    Outcome.COLLISION: collided,
    Outcome.SAFE: stayed_safe,
    Outcome.FAILED: broke_off,
}
TELLERS = (lost_tracks, blindness, misjudgement, leads, overrides, unsolved, braking, ending)


def number(value: float | None, digits: int) -> str:
    """With a fixed number of decimals; what is not known is a dash."""
    return "–" if value is None or not isfinite(value) else f"{value:.{digits}f}"


def told(spans: Sequence[Steps], what: str) -> Iterator[Happening]:
    """A sentence for each span; one for all if there are many."""
    if len(spans) <= FEW:
        yield from (Happening(span[0].time_s, f"{during(span)} {what}") for span in spans)
        return
    whole = [spans[0][0], spans[-1][-1]]
    steps = sum(map(len, spans))
    text = f"{during(whole)}, {len(spans)} times and {steps} steps in all, {what}"
    yield Happening(whole[0].time_s, text)


def spans_of(steps: Steps, holds: Callable[[ExplainedStep], bool]) -> list[Steps]:
    """The unbroken runs of steps of which it holds."""
    return [list(run) for held, run in groupby(steps, holds) if held]


def during(span: Steps) -> str:
    """From its first to its last step."""
    first, last = at(span[0]), at(span[-1])
    return f"At {first}" if first == last else f"From {first} to {last}"


def at(step: ExplainedStep) -> str:
    """When."""
    return f"{step.time_s:.1f} s"


def word(step: ExplainedStep, name: str) -> str:
    """A word of the account; empty if it has none of that name."""
    return str(step.account.get(name, ""))


def says(name: str, text: str, step: ExplainedStep) -> bool:
    """Whether the account has this word under this name."""
    return word(step, name) == text


def figure(step: ExplainedStep, name: str) -> float:
    """A figure of the account; 0 if it has none of that name."""
    value = step.account.get(name, 0.0)
    return value if isinstance(value, float) else 0.0


def ahead(step: ExplainedStep) -> bool:
    """Whether the nearest vehicle is in front, in truth."""
    return step.gap_m is not None and step.gap_m > 0.0


def misjudged_by(step: ExplainedStep) -> float | None:
    """How much lower than the true closing speed the believed one is [m/s]."""
    if step.closing_mps is None or "closing_mps" not in step.account:
        return None
    return step.closing_mps - figure(step, "closing_mps")


def is_misjudged(step: ExplainedStep) -> bool:
    """Whether by much."""
    return (misjudged_by(step) or 0.0) > MISJUDGED_MPS
