"""Proof by replay: what came of eigenfailures and medoids that were injected again."""

from collections.abc import Iterator

import msgspec

from eigenfail.values import (
    CampaignState,
    Proof,
    ProvenScenario,
    ReplayedNoise,
    ReplayKind,
    Reproduction,
)
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.states import CAMPAIGN_BADGES, OUTCOME_BADGES, Badge
from eigenfail_api.dashboard.views.summaries import Figure

CAME_TO_NOTHING = frozenset({CampaignState.CANCELLED, CampaignState.DEAD})
NOT_TRIED = Figure(formats.NONE, ("no replay is in",))


class ScenarioLine(msgspec.Struct, frozen=True, kw_only=True):
    """The replays in one scenario."""

    words: str
    campaign: int
    badge: Badge
    eigenfailures: Figure
    medoids: Figure


class ReplayLine(msgspec.Struct, frozen=True, kw_only=True):
    """One replay; `badge` is None while it is not in, and modes count from 1."""

    scenario: str
    mode: int
    what: str
    badge: Badge | None
    campaign: int
    index: int
    robustness: str
    likelihood: str
    per_step: str
    expected: str


class ProofView(msgspec.Struct, frozen=True, kw_only=True):
    """The part of an analysis's page that tells of its proof.

    Attributes:
        ended: replays that are in, of `planned`.
        may_ask: whether asking would replay anything: nothing was, or some of it was cut off.
        tallies: how many failed again, of those tried.
    """

    ended: int
    planned: int
    is_done: bool
    may_ask: bool
    tallies: tuple[tuple[str, Figure], ...]
    scenarios: tuple[ScenarioLine, ...]
    replays: tuple[ReplayLine, ...]


def proof_view(found: Proof) -> ProofView:
    """How things stand."""
    replays = [replay for scenario in found.scenarios for replay in scenario.replays]
    cut_off = any(scenario.state in CAME_TO_NOTHING for scenario in found.scenarios)
    return ProofView(
        ended=sum(replay.outcome is not None for replay in replays),
        planned=len(replays),
        is_done=found.done,
        may_ask=not found.scenarios or cut_off,
        tallies=tallies(found),
        scenarios=tuple(map(scenario_line, found.scenarios)),
        replays=tuple(line for scenario in found.scenarios for line in replay_lines(scenario)),
    )


def tallies(found: Proof) -> tuple[tuple[str, Figure], ...]:
    """In the same scenario, and in all of them where there are several."""
    same = (("Eigenfailures, same scenario", tried(found.reproduced)),)
    count = len(found.scenarios)
    if count < 2:
        return (*same, ("Medoids", tried(found.medoids)))
    return (
        *same,
        (f"Eigenfailures, {count} scenarios", tried(found.eigenfailures)),
        (f"Medoids, {count} scenarios", tried(found.medoids)),
    )


def tried(found: Reproduction) -> Figure:
    """Failed again of tried, with Wilson's interval, and how near they came."""
    rate = found.rate
    if rate is None:
        return NOT_TRIED
    share = f"{formats.percent(rate.value)}, {formats.rate_interval(rate)}"
    nearest = formats.number(found.smallest_robustness_m)
    return Figure(f"{rate.k} of {rate.n}", (share, f"smallest robustness {nearest}\u00a0m"))


def scenario_line(scenario: ProvenScenario) -> ScenarioLine:
    """One scenario."""
    return ScenarioLine(
        words=scenario.words,
        campaign=scenario.campaign,
        badge=CAMPAIGN_BADGES[scenario.state],
        eigenfailures=tried(scenario.eigenfailures),
        medoids=tried(scenario.medoids),
    )


def replay_lines(scenario: ProvenScenario) -> Iterator[ReplayLine]:
    """Its replays."""
    return (replay_line(scenario.words, replay) for replay in scenario.replays)


def replay_line(scenario: str, replay: ReplayedNoise) -> ReplayLine:
    """One replay."""
    return ReplayLine(
        scenario=scenario,
        mode=replay.mode + 1,
        what=ReplayKind(replay.what).value,
        badge=OUTCOME_BADGES[replay.outcome] if replay.outcome else None,
        campaign=replay.campaign,
        index=replay.index,
        robustness=formats.number(replay.robustness_m),
        likelihood=formats.number(replay.log_probability, 5),
        per_step=formats.number(replay.log_probability_per_step),
        expected=formats.number(replay.expected_log_probability, 5),
    )
