"""Explanations of stored episodes: an episode is run again and described in sentences.

`ExplainingPlanner` lists the names that are read from a planner's account of a step.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import groupby, pairwise
from math import cos, inf, isfinite, isnan
from statistics import fmean
from typing import NamedTuple

import msgspec

from eigenfail import logs, processes
from eigenfail.processes import answer
from eigenfail.replays import MODULE, ReplayQuestion, answer_replays, explain_episode
from eigenfail.values.arrays import decode_array, encode_array
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.proof import ExplainedEpisode, ExplainedStep, Explanation, Replayed
from eigenfail.values.scene import Scene

MISJUDGED_MPS = 3.0
"""A closing speed that the planner underestimates by more than this is mentioned."""


BRAKED_MPS2 = 0.1


_MOST_SENTENCES = 3
"""More spans of a kind than this share one sentence."""


NOTHING = frozenset({"", "none"})
SOLVED = frozenset({"", "solved"})
"""What planners report where there is nothing to tell; empty, where they report nothing."""

Steps = Sequence[ExplainedStep]


class _Event(NamedTuple):
    time_s: float
    text: str


def measure_gap(
    scene: Scene | None, step: int, vehicle: int | None
) -> tuple[float | None, float | None]:
    """Return the true gap to a vehicle along the road [m], and its closing speed [m/s].

    Args:
        scene: course of the episode; None if it is not known.
        step: number of steps so far.
        vehicle: number of the vehicle, from 1.

    Returns:
        None for both if the vehicle is not known or not present.
    """
    if scene is None or vehicle is None or not 0 < vehicle < len(scene.sizes):
        return None, None
    ego, other = scene.vehicles[step][[0, vehicle]].tolist()
    if isnan(other[0]):
        return None, None
    half_lengths_m = float(scene.sizes[[0, vehicle], 0].sum()) / 2.0
    closing_mps = ego[3] * cos(ego[2]) - other[3] * cos(other[2])
    # Positions are those of centres.
    return other[0] - ego[0] - half_lengths_m, closing_mps


def find_only_vehicle(scene: Scene | None) -> int | None:
    """Return the number of the only vehicle besides the ego; None if there are more."""
    return 1 if scene is not None and len(scene.sizes) == 2 else None


def _name_vehicle(episode: ExplainedEpisode, vehicle: int | None, otherwise: str) -> str:
    """Return the words for a vehicle: with its number, unless there is only one vehicle."""
    scene = episode.result.scene
    if vehicle is None or scene is None or len(scene.sizes) == 2:
        return otherwise
    return f"vehicle {vehicle}"


def tell_story(episode: ExplainedEpisode) -> list[str]:
    """Describe an episode in sentences, in order of time."""
    happened = [found for teller in _EVENT_FINDERS for found in teller(episode)]
    return [f"{text}." for _, text in sorted(happened, key=lambda found: found.time_s)]


def _compare_undisturbed(episode: ExplainedEpisode) -> Iterator[_Event]:
    undisturbed = episode.undisturbed
    if undisturbed is None:
        return
    if episode.fails_alike:
        verdict = "fails as well: noise is not what makes it fail"
    elif undisturbed.result.is_failure:
        verdict = "fails in another way"
    else:
        verdict = "does not fail"
    end = _END_DESCRIPTIONS[undisturbed.result.outcome](undisturbed)
    # It is told first: whoever reads of causes must know whether noise is one.
    yield _Event(-inf, f"Without noise the same episode {verdict}. {end}")


def _find_lost_tracks(episode: ExplainedEpisode) -> Iterator[_Event]:
    scene = episode.result.scene
    for place, (before, now) in enumerate(pairwise(episode.steps), 1):
        # A counter: only its rises are losses.
        if _read_figure(now, "lost_tracks") <= _read_figure(before, "lost_tracks"):
            continue
        numbers: list[int | None]
        numbers = [int(each) for each in read_word(now, "lost_vehicles").split() if each.isdigit()]
        only = find_only_vehicle(scene)
        for vehicle in numbers or (only,):
            lost = _name_vehicle(episode, vehicle, "")
            text = (
                f"At {_format_time(now)} {f'the track of {lost}' if lost else 'a track'} was lost"
            )
            gap_m, closing_mps = measure_gap(scene, place, vehicle)
            if gap_m is not None and closing_mps is not None:
                text += f"; the true gap: {gap_m:.0f} m, closing at {closing_mps:.1f} m/s"
            yield _Event(now.time_s, text)


def _find_blindness(episode: ExplainedEpisode) -> Iterator[_Event]:
    def is_blind(vehicle: int, step: ExplainedStep) -> bool:
        return read_word(step, "heeds") == "nobody" and step.ahead == vehicle

    # A dict keeps the order in which vehicles come up.
    ahead = dict.fromkeys(step.ahead for step in episode.steps if step.ahead is not None)
    for vehicle in ahead:
        name = _name_vehicle(episode, vehicle, "")
        what = f"{name}, the next one ahead" if name else "the vehicle ahead"
        spans = _find_spans(episode.steps, partial(is_blind, vehicle))
        yield from _describe_spans(spans, f"it ignored {what}")


def _find_misjudged_speeds(episode: ExplainedEpisode) -> Iterator[_Event]:
    def is_wrong(times_s: set[float], step: ExplainedStep) -> bool:
        return step.time_s in times_s

    # The estimate of a new track starts wrong: steps before the first good estimate of a vehicle do
    # not count.
    for vehicle in dict.fromkeys(step.vehicle for step in episode.steps):
        judged = [
            step
            for step in episode.steps
            if step.vehicle == vehicle and _find_speed_error(step) is not None
        ]
        settled_s = next((step.time_s for step in judged if not _is_misjudged(step)), 0.0)
        wrong = {step.time_s for step in judged if step.time_s >= settled_s and _is_misjudged(step)}
        name = _name_vehicle(episode, vehicle, "")
        whom = f" on {name}" if name else ""
        for span in _find_spans(episode.steps, partial(is_wrong, wrong)):
            believed = fmean(_read_figure(step, "closing_mps") for step in span)
            true = fmean(step.closing_mps or 0.0 for step in span)
            text = f"it believed to close in{whom} at {believed:.1f} m/s on average; in truth"
            yield _Event(span[0].time_s, f"{_format_span(span)} {text} {true:.1f} m/s")


def _find_leads(episode: ExplainedEpisode) -> Iterator[_Event]:
    def is_lead(vehicle: int | None, step: ExplainedStep) -> bool:
        return read_word(step, "heeds") == "lead" and step.vehicle == vehicle

    for vehicle in dict.fromkeys(step.vehicle for step in episode.steps):
        name = _name_vehicle(episode, vehicle, "the vehicle ahead")
        spans = _find_spans(episode.steps, partial(is_lead, vehicle))
        yield from _describe_spans(spans, f"it took {name} for its lead")


def _find_overrides(episode: ExplainedEpisode) -> Iterator[_Event]:
    def is_override(name: str, step: ExplainedStep) -> bool:
        return read_word(step, "override") == name

    # A set has no order, but the events of all finders are sorted by time.
    for name in {read_word(step, "override") for step in episode.steps} - NOTHING:
        spans = _find_spans(episode.steps, partial(is_override, name))
        yield from _describe_spans(spans, f"the plan was overridden: {name.replace('_', ' ')}")


def _find_unsolved_programs(episode: ExplainedEpisode) -> Iterator[_Event]:
    spans = _find_spans(episode.steps, lambda step: read_word(step, "qp_status") not in SOLVED)
    yield from _describe_spans(spans, "the quadratic program was not solved")


def _find_hardest_braking(episode: ExplainedEpisode) -> Iterator[_Event]:
    # An episode may have no step: its fault is told by its end.
    hardest = min(episode.steps, key=lambda step: step.acceleration_mps2, default=None)
    if hardest is not None and hardest.acceleration_mps2 < -BRAKED_MPS2:
        braked = f"it asked for its hardest braking: {-hardest.acceleration_mps2:.2f} m/s²"
        yield _Event(hardest.time_s, f"At {_format_time(hardest)} {braked}")


def _describe_end(episode: ExplainedEpisode) -> Iterator[_Event]:
    # Events are sorted by time, and the end is told last.
    yield _Event(float("inf"), _END_DESCRIPTIONS[episode.result.outcome](episode))


def _describe_collision(episode: ExplainedEpisode) -> str:
    # A collision is detected at the end of the last step.
    result, struck = episode.result, _name_vehicle(episode, episode.struck, "")
    severity = result.measures.severity if result.measures else None
    after_s = result.scene.dt_s * result.steps if result.scene else None
    end = f"After {_format_number(after_s, 1)} s collision{f' with {struck}' if struck else ''}"
    return f"{end}: severity {_format_number(severity, 1)} m²/s²"


def _describe_violation(episode: ExplainedEpisode) -> str:
    measures = episode.result.measures
    number = measures.violated if measures else None
    return f"{_describe_safe_end(episode)}, and requirement {number} is violated"


def _describe_safe_end(episode: ExplainedEpisode) -> str:
    measures = episode.result.measures
    if measures is not None and measures.collided_s is not None:
        return f"{_describe_collision(episode)}, which no requirement forbids"
    nearest_m = measures.distance_m if measures else None
    return f"No collision: smallest distance {_format_number(nearest_m, 1)} m"


def _describe_error(episode: ExplainedEpisode) -> str:
    result = episode.result
    why = result.fault.message.rstrip(".") if result.fault else "no reason was stored"
    return f"After {result.steps} steps the episode was aborted: {why}"


_END_DESCRIPTIONS: dict[Outcome, Callable[[ExplainedEpisode], str]] = {
    Outcome.COLLISION: _describe_collision,
    Outcome.VIOLATION: _describe_violation,
    Outcome.SAFE: _describe_safe_end,
    Outcome.ERRORED: _describe_error,
}


_EVENT_FINDERS = (
    _compare_undisturbed,
    _find_lost_tracks,
    _find_blindness,
    _find_misjudged_speeds,
    _find_leads,
    _find_overrides,
    _find_unsolved_programs,
    _find_hardest_braking,
    _describe_end,
)


def _format_number(value: float | None, digits: int) -> str:
    return "–" if value is None or not isfinite(value) else f"{value:.{digits}f}"


def _describe_spans(spans: Sequence[Steps], what: str) -> Iterator[_Event]:
    # A planner that changes its mind at each step would otherwise fill pages.
    if len(spans) <= _MOST_SENTENCES:
        yield from (_Event(span[0].time_s, f"{_format_span(span)} {what}") for span in spans)
        return
    whole = [spans[0][0], spans[-1][-1]]
    steps = sum(map(len, spans))
    text = f"{_format_span(whole)}, {len(spans)} times and {steps} steps in all, {what}"
    yield _Event(whole[0].time_s, text)


def _find_spans(steps: Steps, holds: Callable[[ExplainedStep], bool]) -> list[Steps]:
    """Return the runs of consecutive steps for which the predicate holds."""
    return [list(run) for held, run in groupby(steps, holds) if held]


def _format_span(span: Steps) -> str:
    first, last = _format_time(span[0]), _format_time(span[-1])
    return f"At {first}" if first == last else f"From {first} to {last}"


def _format_time(step: ExplainedStep) -> str:
    return f"{step.time_s:.1f} s"


def read_word(step: ExplainedStep, name: str) -> str:
    """Return a text from the planner's account of a step; empty if the name is missing."""
    return str(step.account.get(name, ""))


def _read_figure(step: ExplainedStep, name: str) -> float:
    value = step.account.get(name, 0.0)
    return value if isinstance(value, float) else 0.0


def _find_speed_error(step: ExplainedStep) -> float | None:
    """Return the true closing speed minus the planner's estimate [m/s]; None without one."""
    if step.closing_mps is None or "closing_mps" not in step.account:
        return None
    return step.closing_mps - _read_figure(step, "closing_mps")


def _is_misjudged(step: ExplainedStep) -> bool:
    return (_find_speed_error(step) or 0.0) > MISJUDGED_MPS


class StepWindow(msgspec.Struct, frozen=True):
    """Selection of steps: every n-th between two times [s], both included."""

    since_s: float
    until_s: float
    every: int

    def select(self, steps: Sequence[ExplainedStep]) -> tuple[ExplainedStep, ...]:
        """Return the selected steps."""
        picked = steps[:: self.every]
        return tuple(step for step in picked if self.since_s <= step.time_s <= self.until_s)


WHOLE = StepWindow(-inf, inf, 1)


def build_explanation(
    episode: str, planner: str, replayed: Replayed, explained: ExplainedEpisode, window: StepWindow
) -> Explanation:
    """Build the explanation of an episode from its replay."""
    # A planner without `explain` is no error: its controls are told all the same.
    silent = not any(step.account for step in explained.steps)
    return Explanation(
        episode=episode,
        planner=planner,
        replayed=replayed,
        verdict=describe_replay(replayed),
        note=f"The planner '{planner}' provides no explanation: {NO_ACCOUNT}" if silent else "",
        steps=window.select(explained.steps),
        story=tuple(tell_story(explained)),
        undisturbed=explained.undisturbed.result.outcome if explained.undisturbed else None,
    )


NO_ACCOUNT = "it has no `explain`, or returns nothing there. Only its controls follow."


def describe_replay(replayed: Replayed) -> str:
    """State in a sentence whether the replay equals the stored episode."""
    if replayed.same:
        return (
            "This explanation comes from a replay that equals the stored episode bit for bit: "
            f"digest {replayed.digest}."
        )
    again = f"{replayed.outcome.word}, digest {replayed.digest}"
    stored = f"{replayed.stored_outcome.word}, digest {replayed.stored_digest}"
    if replayed.unsteady is not None:
        why = describe_unsteadiness(replayed.unsteady)
        return (
            f"NOT DETERMINISTIC: the replay ({again}) does not equal the stored episode "
            f"({stored}). {why} What follows describes the replay."
        )
    return (
        f"DIFFERENT: the replay ({again}) does not equal the stored episode ({stored}); what "
        "follows describes the replay. Use the versions and the type of machine of the campaign."
    )


def describe_unsteadiness(how: str) -> str:
    """State in sentences that a stack does not repeat itself, and how its runs differ."""
    return (
        f"The stack does not repeat itself: two replays of the same noise with the same code "
        f"differ ({how}). Fix its random seeds, and keep time and threads out of its decisions."
    )


TIMEOUT_S = 110.0
"""Less than the proxy of `deploy/nginx` and our own client wait."""


class _ExplanationQuestion(msgspec.Struct, frozen=True, eq=False, tag=True):
    campaign: int
    spec: CampaignSpec
    stored: EpisodeResult


_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array)


_questions = msgspec.msgpack.Decoder(_ExplanationQuestion | ReplayQuestion, dec_hook=decode_array)


_answers = msgspec.msgpack.Decoder(Explanation, dec_hook=decode_array)


def encode_question(campaign: int, spec: CampaignSpec, stored: EpisodeResult) -> bytes:
    """Encode the question for the side process; equal episodes give equal questions."""
    return _encoder.encode(_ExplanationQuestion(campaign, spec, stored))


def explain_in_process(asked: bytes, timeout_s: float = TIMEOUT_S) -> Explanation:
    """Explain an episode in a separate process, which may fail without harm to this process.

    Args:
        asked: question made by `encode_question`.
        timeout_s: time after which the process is killed. [s]

    Raises:
        InvalidValue: the episode does not have a course to explain.
        ServiceError: the simulator is not installed here, or the process gave no answer.
    """
    return _answers.decode(processes.ask(MODULE, asked, timeout_s))


def answer_question(asked: bytes) -> bytes:
    """Answer a question in the process that was started for it."""
    question = _questions.decode(asked)
    if isinstance(question, ReplayQuestion):
        return answer_replays(question)
    return _encoder.encode(_explain(question))


def _explain(wanted: _ExplanationQuestion) -> Explanation:
    # The scene of the replay stands in for one that was not stored, if both episodes are equal.
    stored = wanted.stored
    replayed, episode = explain_episode(wanted.spec, stored)
    name = f"{wanted.campaign}/{stored.index}"
    explanation = build_explanation(name, wanted.spec.planner, replayed, episode, WHOLE)
    has_news = replayed.same and stored.scene is None
    return msgspec.structs.replace(explanation, scene=episode.result.scene if has_news else None)


if __name__ == "__main__":
    logs.configure("controller")
    answer(answer_question)
