"""The known failures of a baseline, as a service knows them."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

from eigenfail.cli.gate_analyses import analysed_alone
from eigenfail.cli.places import Place
from eigenfail.client import Client
from eigenfail.errors import Conflict
from eigenfail.gate.known import (
    KnownReplay,
    Under,
    outcome_of,
    proven,
    replay_of_minimal,
    shrinks,
)
from eigenfail.gate.known_modes import replays_of_modes
from eigenfail.gate.versions import run_of
from eigenfail.suites import Member, Suite
from eigenfail.values import (
    Analysis,
    Campaign,
    CampaignState,
    MinimalFailure,
    episode_seed,
)
from eigenfail.values.records import EpisodeRow
from eigenfail.values.variation import KINDS
from eigenfail.variations import drawn_for


class Replay(NamedTuple):
    """Known failures injected into the new planner, and into the baseline's own."""

    now: KnownReplay
    before: KnownReplay


class Known(NamedTuple):
    """The known failures of a member's baseline, and what keeps others from being known."""

    replays: tuple[Replay, ...] = ()
    notes: tuple[str, ...] = ()


class Shrunk(NamedTuple):
    """A campaign that shrank a failure, and what it came down to."""

    campaign: Campaign
    failure: MinimalFailure


class KnownFailures:
    """Finds the known failures of campaigns, analysing those that were not.

    Args:
        client: of the service.
        place: where it is.
    """

    def __init__(self, client: Client, place: Place) -> None:
        self._client = client
        self._place = place

    def of(self, run: str, member: Member, before: Campaign) -> Known:
        """Those of a baseline's campaign.

        Args:
            run: the name of the run in which they are replayed.
            member: whose planner they are injected into.
            before: the campaign.
        """
        if not before.counts.failures:
            return Known()
        if varies(before) and not drawn(before, 0):
            problem = f"scenario '{before.spec.scenario}' is not installed here."
            return Known(notes=(f"Known failures are not replayed: {problem}",))
        analysis = analysed_alone(self._client, self._place, before.id)
        new = Under(run, member)
        old = Under(run_of(before, member), Member(member.name, before.spec))
        shrunk = [*self._shrunk(before, analysis)]
        replays = zip(
            replays_of(new, before, analysis, shrunk),
            replays_of(old, before, analysis, shrunk),
            strict=True,
        )
        notes = () if analysis.result else (f"It has no failure modes: {analysis.problem}",)
        return Known(tuple(Replay(*both) for both in replays), notes)

    def proven(self, replay: Replay) -> KnownReplay:
        """What is injected, knowing what came of it when the baseline's version was gated."""
        (found,) = self._client.suites.find(Suite("", (replay.before.member,)))
        if found is None or found.state is not CampaignState.DONE:
            return replay.now
        return proven(replay.now, outcome_of(rows(self._client, found)))

    def _shrunk(self, before: Campaign, analysis: Analysis) -> Iterator[Shrunk]:
        """What was shrunk of a campaign; nothing of what failed no more."""
        for campaign in self._client.campaigns.list(CampaignState.DONE):
            if shrinks(campaign, before, analysis):
                with suppress(Conflict):
                    yield Shrunk(campaign, self._client.campaigns.minimal(campaign.id))


def replays_of(
    under: Under, before: Campaign, analysis: Analysis, shrunk: Sequence[Shrunk]
) -> Iterator[KnownReplay]:
    """The modes of a campaign, and what was shrunk of it, for one planner."""
    yield from replays_of_modes(under, before, analysis, partial(drawn, before))
    for campaign, failure in shrunk:
        yield replay_of_minimal(under, campaign, failure.index, partial(drawn, campaign))


def rows(client: Client, campaign: Campaign) -> dict[int, EpisodeRow]:
    """The episodes of a campaign that have a result, by index."""
    return {row.index: row for row in client.episodes.list(campaign.id)}


def varies(campaign: Campaign) -> bool:
    """Whether its episodes draw parameters of their scenario."""
    given = campaign.spec.scenario_parameters.values()
    return any(isinstance(each, dict) and KINDS.keys() & each.keys() for each in given)


def drawn(campaign: Campaign, index: int) -> Mapping[str, Any]:
    """What an episode drew of its scenario's parameters, by name."""
    return drawn_for(campaign.spec, episode_seed(campaign.spec.seed, index))
