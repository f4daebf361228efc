"""Proof by replay, as a part of the page of an analysis."""

from collections.abc import Iterator

import msgspec

from eigenfail import values
from eigenfail.presentation.figures import UNKNOWN, format_number
from eigenfail_api.dashboard import rendering

CAME_TO_NOTHING = frozenset({values.CampaignState.CANCELLED, values.CampaignState.DEAD})
NOT_TRIED = rendering.Tile(UNKNOWN, ("no replay completed",))


class ScenarioLine(msgspec.Struct, frozen=True, kw_only=True):
    """The replays in one scenario."""

    words: str
    campaign: int
    badge: rendering.Badge
    eigenfailures: rendering.Tile
    medoids: rendering.Tile


class ReplayLine(msgspec.Struct, frozen=True, kw_only=True):
    """One replay; `badge` is None while it is not in, and modes count from 1."""

    scenario: str
    mode: int
    what: str
    badge: rendering.Badge | None
    campaign: int
    index: int
    robustness: str
    likelihood: str
    per_step: str
    expected: str


class ProofView(msgspec.Struct, frozen=True, kw_only=True):
    """The proof section of an analysis page.

    Attributes:
        ended: replays that are in, of `planned`.
        may_ask: whether asking would replay anything: nothing was, or some of it was cut off, or
            centres do not fail.
        asks_for_points: whether it would search the nearest failing points.
        tallies: how many failed again, of those tried.
    """

    ended: int
    planned: int
    is_done: bool
    may_ask: bool
    asks_for_points: bool
    tallies: tuple[tuple[str, rendering.Tile], ...]
    scenarios: tuple[ScenarioLine, ...]
    replays: tuple[ReplayLine, ...]


def make_proof_view(found: values.Proof, unit: str) -> ProofView:
    """Return the view of an analysis's replays; robustness in a unit, or none."""
    replays = [replay for scenario in found.scenarios for replay in scenario.replays]
    cut_off = any(scenario.state in CAME_TO_NOTHING for scenario in found.scenarios)
    return ProofView(
        ended=sum(replay.outcome is not None for replay in replays),
        planned=len(replays),
        is_done=found.done,
        may_ask=not found.scenarios or cut_off or bool(found.done and found.unplaced),
        asks_for_points=bool(found.unplaced),
        tallies=make_tallies(found, unit),
        scenarios=tuple(make_scenario_line(scenario, unit) for scenario in found.scenarios),
        replays=tuple(line for scenario in found.scenarios for line in replay_lines(scenario)),
    )


def make_tallies(found: values.Proof, unit: str) -> tuple[tuple[str, rendering.Tile], ...]:
    """Return the tiles of replays in the same scenario, and in all if there are several."""
    same = (("Eigenfailures, same scenario", describe_reproduction(found.reproduced, unit)),)
    count = len(found.scenarios)
    if count < 2:
        return (*same, ("Medoids", describe_reproduction(found.medoids, unit)))
    return (
        *same,
        (f"Eigenfailures, {count} scenarios", describe_reproduction(found.eigenfailures, unit)),
        (f"Medoids, {count} scenarios", describe_reproduction(found.medoids, unit)),
    )


def describe_reproduction(found: values.Reproduction, unit: str) -> rendering.Tile:
    """Return how many replays failed again, of those tried, and how near they came if none did.

    Args:
        found: count of the replays.
        unit: unit of robustness; empty for a function.
    """
    rate = found.rate
    if rate is None:
        return NOT_TRIED
    nearest = "\u00a0".join(filter(None, (format_number(found.smallest_robustness_m), unit)))
    lines = () if rate.k else (f"smallest robustness {nearest}",)
    return rendering.Tile(f"{rate.k} of {rate.n}", lines)


def make_scenario_line(scenario: values.ProvenScenario, unit: str) -> ScenarioLine:
    """Return the line of a scenario."""
    return ScenarioLine(
        words=scenario.words,
        campaign=scenario.campaign,
        badge=make_scenario_badge(scenario),
        eigenfailures=describe_reproduction(scenario.eigenfailures, unit),
        medoids=describe_reproduction(scenario.medoids, unit),
    )


def make_scenario_badge(scenario: values.ProvenScenario) -> rendering.Badge:
    """Return the badge of the campaign that replays: errored if every replay of it errored."""
    ended = [replay.outcome for replay in scenario.replays if replay.outcome is not None]
    is_errored = bool(ended) and all(outcome is values.Outcome.ERRORED for outcome in ended)
    is_done = scenario.state is values.CampaignState.DONE
    return (
        rendering.ERRORED_BADGE
        if is_done and is_errored
        else rendering.CAMPAIGN_BADGES[scenario.state]
    )


def replay_lines(scenario: values.ProvenScenario) -> Iterator[ReplayLine]:
    """Its replays."""
    return (replay_line(scenario.words, replay) for replay in scenario.replays)


def replay_line(scenario: str, replay: values.ReplayedNoise) -> ReplayLine:
    """One replay."""
    return ReplayLine(
        scenario=scenario,
        mode=replay.mode + 1,
        what=values.ReplayKind(replay.what).value,
        badge=rendering.OUTCOME_BADGES[replay.outcome] if replay.outcome else None,
        campaign=replay.campaign,
        index=replay.index,
        robustness=format_number(replay.robustness_m),
        likelihood=format_number(replay.log_probability, 5),
        per_step=format_number(replay.log_probability_per_step),
        expected=format_number(replay.expected_log_probability, 5),
    )
