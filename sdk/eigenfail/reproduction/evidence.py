"""Collects the results of a programme from the service, and has its failures analysed."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import msgspec

from eigenfail.client import Client
from eigenfail.errors import Conflict
from eigenfail.reproduction.statements import NEEDED, judge_campaigns, judge_causes
from eigenfail.reproduction.tables import (
    AXES,
    Analyses,
    PaperReproduction,
    PaperStatement,
    PaperTable,
    build_campaign_tables,
    build_component_table,
    build_replay_table,
    build_safety_table,
)
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
    """Results by the name of the member; analyses by name and axis."""

    summaries: Mapping[str, Summary]
    safeties: Mapping[str, Safety]
    analyses: Analyses
    proofs: Mapping[str, Proof]


def build_reproduction(client: Client, suite: Suite, scale: str) -> PaperReproduction:
    """Build the paper's tables and statements from campaigns that are done.

    Launches missing analyses and replays, and waits for them.

    Raises:
        Conflict: a campaign is not done, or its failures cannot be analysed.
    """
    _require_done(suite, client.suites.find(suite))
    evidence = _gather_evidence(client, suite)
    return PaperReproduction(
        scale=scale,
        seed=suite.members[0].spec.seed,
        tables=tuple(_build_tables(evidence)),
        statements=tuple(_judge_statements(client, evidence)),
    )


def _require_done(suite: Suite, campaigns: Sequence[Campaign | None]) -> None:
    """Refuse a programme that is not done.

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


def _gather_evidence(client: Client, suite: Suite) -> Evidence:
    found = zip(suite.members, client.suites.summaries(suite), strict=True)
    summaries = {member.name: summary for member, summary in found if summary is not None}
    ids = {name: one.campaign for name, one in summaries.items() if one.counts.failures}
    diagnosed = {name: ids[name] for name in ANALYSED if name in ids}
    return Evidence(
        summaries,
        {name: client.campaigns.safety(summaries[name].campaign) for name in NEEDED},
        {
            (name, axis): _analyze(client, campaign, settings)[1]
            for name, campaign in diagnosed.items()
            for axis, settings in AXES.items()
        },
        {name: _prove(client, campaign) for name, campaign in diagnosed.items()},
    )


def _prove(client: Client, campaign: int) -> Proof:
    """Return the replays of a campaign's eigenfailures in its scenario and in similar ones."""
    analysis, _ = _analyze(client, campaign, AnalysisSettings())
    client.analyses.prove(analysis)
    return client.analyses.wait_for_proof(analysis)


def _analyze(
    client: Client, campaign: int, settings: AnalysisSettings
) -> tuple[int, AnalysisResult]:
    """Return id and result of the analysis with these settings; run it if there is none.

    Raises:
        Conflict: the failures cannot be analysed.
    """
    known = (one for one in client.analyses.list(campaign) if one.settings == settings)
    done = next((one for one in known if one.state is AnalysisState.DONE), None)
    found = client.analyses.wait((done or client.analyses.create(campaign, settings)).id)
    if found.result is None:
        raise Conflict(f"The failures of campaign {campaign} were not analysed: {found.problem}")
    return found.id, found.result


def _build_tables(evidence: Evidence) -> Iterator[PaperTable]:
    yield from build_campaign_tables(evidence.summaries)
    yield build_safety_table({name: evidence.safeties[name] for name in MEASURED})
    yield build_component_table(evidence.analyses)
    yield build_replay_table(evidence.proofs)


def _judge_statements(client: Client, evidence: Evidence) -> Iterator[PaperStatement]:
    compare = partial(_compare, client, evidence)
    yield from judge_campaigns(evidence.summaries, evidence.safeties, compare)
    measured = {name: evidence.safeties[name] for name in MEASURED}
    yield from judge_causes(evidence.analyses, evidence.proofs, measured)


def _compare(client: Client, evidence: Evidence, a: str, b: str) -> Comparison:
    one, other = (evidence.summaries[name].campaign for name in (a, b))
    return client.campaigns.compare(one, other)
