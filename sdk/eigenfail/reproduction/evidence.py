"""What the service holds of a programme that was run, and what it makes of the failures."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import msgspec

from eigenfail.client import Client
from eigenfail.errors import Conflict
from eigenfail.reproduction.causes import of_causes
from eigenfail.reproduction.diagnosis import (
    AXES,
    Analyses,
    component_table,
    replay_table,
    safety_table,
)
from eigenfail.reproduction.results import PaperTable, Reproduction, Statement
from eigenfail.reproduction.statements import NEEDED, of_campaigns
from eigenfail.reproduction.tables import campaign_tables
from eigenfail.suites import Suite
from eigenfail.values import (
    AnalysisResult,
    AnalysisSettings,
    AnalysisState,
    Campaign,
    CampaignState,
    Comparison,
    Proof,
    Safety,
    Summary,
)

ANALYSED = ("ast evaluation", "ast_paper evaluation")
MEASURED = ("ast evaluation", "difs evaluation", "difs_paper evaluation")


class Evidence(msgspec.Struct, frozen=True):
    """All by the names of members; analyses by the axis, too."""

    summaries: Mapping[str, Summary]
    safeties: Mapping[str, Safety]
    analyses: Analyses
    proofs: Mapping[str, Proof]


def reproduction(client: Client, suite: Suite, scale: str) -> Reproduction:
    """The paper's tables and statements with our numbers, from campaigns that have ended.

    Analyses and replays that are missing are launched and waited for.

    Raises:
        Conflict: a campaign is not done, or its failures cannot be analysed.
    """
    require_done(suite, client.suites.find(suite))
    evidence = gather(client, suite)
    return Reproduction(
        scale=scale,
        seed=suite.members[0].spec.seed,
        tables=tuple(tables(evidence)),
        statements=tuple(statements(client, evidence)),
    )


def require_done(suite: Suite, campaigns: Sequence[Campaign | None]) -> None:
    """Refuse to tell of half a programme.

    Raises:
        Conflict: a campaign is missing, or ended otherwise.
    """
    for member, campaign in zip(suite.members, campaigns, strict=True):
        if campaign is None or campaign.state is not CampaignState.DONE:
            state = campaign.state if campaign else "not there"
            raise Conflict(
                f"The campaign '{member.spec.name}' is {state}, so that its tables would be wrong.",
                "Resume it, or run the programme again with another seed.",
            )


def gather(client: Client, suite: Suite) -> Evidence:
    """What came of the members that there are."""
    found = zip(suite.members, client.suites.summaries(suite), strict=True)
    summaries = {member.name: summary for member, summary in found if summary is not None}
    ids = {name: one.campaign for name, one in summaries.items() if one.counts.failures}
    diagnosed = {name: ids[name] for name in ANALYSED if name in ids}
    return Evidence(
        summaries,
        {name: client.campaigns.safety(summaries[name].campaign) for name in NEEDED},
        {
            (name, axis): analysed(client, campaign, settings)[1]
            for name, campaign in diagnosed.items()
            for axis, settings in AXES.items()
        },
        {name: proven(client, campaign) for name, campaign in diagnosed.items()},
    )


def proven(client: Client, campaign: int) -> Proof:
    """The eigenfailures of a campaign, replayed in its scenario and beside it."""
    analysis, _ = analysed(client, campaign, AnalysisSettings())
    client.analyses.prove(analysis)
    return client.analyses.wait_for_proof(analysis)


def analysed(
    client: Client, campaign: int, settings: AnalysisSettings
) -> tuple[int, AnalysisResult]:
    """The id and the result of the analysis with these settings: one that is done, or a new one.

    Raises:
        Conflict: the failures cannot be analysed.
    """
    known = (one for one in client.analyses.list(campaign) if one.settings == settings)
    done = next((one for one in known if one.state is AnalysisState.DONE), None)
    found = client.analyses.wait((done or client.analyses.create(campaign, settings)).id)
    if found.result is None:
        raise Conflict(f"The failures of campaign {campaign} were not analysed: {found.problem}")
    return found.id, found.result


def tables(evidence: Evidence) -> Iterator[PaperTable]:
    """All of them, in the paper's order."""
    yield from campaign_tables(evidence.summaries)
    yield safety_table({name: evidence.safeties[name] for name in MEASURED})
    yield component_table(evidence.analyses)
    yield replay_table(evidence.proofs)


def statements(client: Client, evidence: Evidence) -> Iterator[Statement]:
    """All of them, in the paper's order."""
    compare = partial(compared, client, evidence)
    yield from of_campaigns(evidence.summaries, evidence.safeties, compare)
    measured = {name: evidence.safeties[name] for name in MEASURED}
    yield from of_causes(evidence.analyses, evidence.proofs, measured)


def compared(client: Client, evidence: Evidence, a: str, b: str) -> Comparison:
    """Two members side by side."""
    one, other = (evidence.summaries[name].campaign for name in (a, b))
    return client.campaigns.compare(one, other)
