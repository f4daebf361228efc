"""Known failures of a baseline, and the campaigns that inject them into another planner."""

from collections.abc import Callable, Mapping
from typing import Any

import msgspec
from msgspec.structs import replace

from eigenfail.gate.found import Finding, finding
from eigenfail.gate.verdicts import verdict
from eigenfail.suites import Member
from eigenfail.values import Analysis, Campaign, CampaignSpec, Outcome, StopRules
from eigenfail.values.records import EpisodeRow

REPLAY = "replay"
MINIMAL = "minimal"
"""The method whose campaigns shrink a failure; its settings name a campaign and an episode."""

Drawn = Callable[[int], Mapping[str, Any]]
"""The scenario parameters that the baseline's episode of an index drew, by name."""


class KnownFailure(msgspec.Struct, frozen=True):
    """Noise under which the baseline failed, or is thought to have: one of three kinds.

    An eigenfailure is the centre of a failure mode; a medoid is the real failure nearest to it; a
    minimal failure is what is left of a failure that was shrunk.

    Attributes:
        what: it is, in words.
        was: the baseline's episode, as CAMPAIGN/INDEX; empty of an eigenfailure.
        before: what came of it with the baseline's planner; None where that was never tried.
    """

    what: str
    was: str = ""
    before: Outcome | None = None


class KnownReplay(msgspec.Struct, frozen=True):
    """A campaign that injects known failures.

    Attributes:
        member: of a suite; named after the member whose baseline's failures these are.
        known: the known failure of each episode, by index; others are of no interest.
    """

    member: Member
    known: dict[int, KnownFailure]


class Under(msgspec.Struct, frozen=True):
    """The planner that known failures are injected into, and the run that this belongs to.

    Attributes:
        run: name of the run.
        member: whose planner it is.
    """

    run: str
    member: Member

    def replay(self, title: str, like: CampaignSpec, **varied: Any) -> Member:
        """A campaign that replays noise in the world of another, with this planner."""
        name = f"{self.member.name}: {title}"
        spec = replace(
            like,
            name=f"{self.run}: {name}",
            method=REPLAY,
            planner=self.member.spec.planner,
            planner_settings=self.member.spec.planner_settings,
            stop=StopRules(),
            scene_every=1,
            **varied,
        )
        return Member(name, spec)


def in_scenario(spec: CampaignSpec, drawn: Mapping[str, Any]) -> CampaignSpec:
    """The campaign in the scenario that one of its episodes drew."""
    return replace(spec, scenario_parameters={**spec.scenario_parameters, **drawn})


def replay_of_minimal(under: Under, minimal: Campaign, index: int, drawn: Drawn) -> KnownReplay:
    """What a campaign shrank its failure to.

    Args:
        under: the planner.
        minimal: the campaign.
        index: of its minimal failure.
        drawn: what its episodes drew of their scenario; see `Drawn`.
    """
    was = f"{minimal.id}/{index}"
    again = under.replay(
        f"minimal failure {was}",
        in_scenario(minimal.spec, drawn(index)),
        settings={"campaign": minimal.id, "episodes": [index]},
        episodes=1,
    )
    return KnownReplay(again, {0: KnownFailure(f"minimal failure {was}", was, Outcome.COLLISION)})


def shrinks(campaign: Campaign, before: Campaign, analysis: Analysis) -> bool:
    """Whether a campaign shrank a failure of another, or a mode of its analysis.

    With the same planner: otherwise what is left of it is no failure of the baseline's.
    """
    spec, planner = campaign.spec, (before.spec.planner, before.spec.planner_settings)
    named = {"campaign": before.id, "analysis": analysis.id}
    return (
        spec.method == MINIMAL
        and (spec.planner, spec.planner_settings) == planner
        and any(spec.settings.get(name) == number for name, number in named.items())
    )


def proven(replay: KnownReplay, outcomes: Mapping[int, Outcome]) -> KnownReplay:
    """The same, knowing what came of it with the baseline's own planner."""
    known = {
        index: replace(failure, before=outcomes.get(index, failure.before))
        for index, failure in replay.known.items()
    }
    return replace(replay, known=known)


def of_known(
    replay: KnownReplay, rows: Mapping[int, EpisodeRow], pages: str
) -> tuple[Finding, ...]:
    """What became of each known failure of a replay.

    Args:
        replay: what was injected.
        rows: what came of it with the new planner, by index.
        pages: address of the service's pages.
    """
    found = []
    for index, known in replay.known.items():
        row = rows.get(index)
        became = verdict(known.before, row.outcome if row else None)
        found.append(finding(became, known.what, known.was, row, pages))
    return tuple(found)


def outcome_of(rows: Mapping[int, EpisodeRow]) -> dict[int, Outcome]:
    """What came of episodes that were run to their end, by index."""
    return {index: row.outcome for index, row in rows.items() if row.outcome is not Outcome.FAILED}
