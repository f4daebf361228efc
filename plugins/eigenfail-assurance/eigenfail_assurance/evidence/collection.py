"""Records that the solutions of a question rest on, read from a service."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from eigenfail import __version__
from eigenfail.client import Client
from eigenfail.errors import Conflict, InvalidValue, NotFound
from eigenfail.values.analysis import AnalysisState
from eigenfail.values.campaign import Campaign
from eigenfail.values.episode import Outcome
from eigenfail.values.operations import Versions
from eigenfail_assurance.evidence.bundle import EvidenceBundle, make_bundle
from eigenfail_assurance.evidence.question import (
    AnySolution,
    EvidenceQuestion,
    GateSolution,
    ProbabilitySolution,
    ReplaySolution,
    RiskSolution,
    SearchSolution,
    SensorSolution,
)
from eigenfail_assurance.evidence.records import (
    COLUMNS,
    MOST_EPISODES,
    CampaignFacts,
    CampaignRecord,
    EvidenceRecords,
    NoiseLine,
    RecordedEpisode,
    SolutionInput,
    WorkerVersions,
    follows_from_seed,
    list_campaigns,
    read_episodes,
)
from eigenfail_assurance.risk.client import assess_risk
from eigenfail_assurance.risk.pooling import pick_named
from eigenfail_assurance.risk.question import (
    CampaignReference,
    Driving,
    RiskQuestion,
    RiskScenario,
    RiskTarget,
)

MOST_NOISE = 50
"""Episodes of a campaign whose noise is recorded where it does not follow from their seeds."""


def collect_bundle(client: Client, question: EvidenceQuestion) -> EvidenceBundle:
    """Return the bundle of a question, as the campaigns of a service stand; nothing is written.

    Args:
        client: client of the service that has the campaigns.
        question: claims and solutions; see
            `eigenfail_assurance.evidence.question.read_evidence_file`.

    Raises:
        NotFound: a campaign that is named does not exist.
        InvalidValue: a campaign is named twice, does not fit the others that it is counted together
            with, or is too large.
    """
    return make_bundle(question, collect_records(client, question), __version__)


def collect_records(client: Client, question: EvidenceQuestion) -> EvidenceRecords:
    """Return the records that the solutions of a question rest on, in their present state.

    Args:
        client: client of the service that has the campaigns.
        question: claims and solutions.

    Raises:
        NotFound: a campaign that is named does not exist.
        InvalidValue: a campaign is named twice, does not fit the others that it is counted together
            with, or is too large.
    """
    solutions = tuple(question.claim.list_solutions())
    inputs = tuple(_collect_input(client, each) for each in solutions)
    used = {
        campaign
        for solution, given in zip(solutions, inputs, strict=True)
        for campaign in list_campaigns(solution, given)
    }
    records = {each: _collect_campaign(client, each) for each in sorted(used)}
    return EvidenceRecords(records, inputs)


def _collect_input(client: Client, solution: AnySolution) -> SolutionInput:
    collect: Callable[[Client, Any], SolutionInput] = _COLLECTORS[type(solution)]
    return collect(client, solution)


def _ask_probability(client: Client, solution: ProbabilitySolution) -> SolutionInput:
    """Request the risk of one encounter an hour; its rate equals P(failure)."""
    met = RiskScenario(name="encounter", per_hour=1.0, campaigns=solution.campaigns)
    question = RiskQuestion(
        name="P(failure)",
        target=RiskTarget(per_hour=solution.at_most),
        exposure=Driving(hours=1.0),
        scenarios=(met,),
    )
    return _ask_risk(client, RiskSolution(question=question))


def _ask_risk(client: Client, solution: RiskSolution) -> SolutionInput:
    found = assess_risk(client, solution.question)
    campaigns = tuple(each.campaigns for each in found.scenarios)
    return SolutionInput(campaigns=campaigns, notes=found.notes)


def _ask_search(client: Client, solution: SearchSolution) -> SolutionInput:
    found = tuple(find_campaign(client, each).id for each in solution.campaigns)
    if len(set(found)) < len(found):
        raise InvalidValue("campaigns", "a campaign is named twice.", "Name each campaign once.")
    return SolutionInput(campaigns=(found,))


def _ask_replay(client: Client, solution: ReplaySolution) -> SolutionInput:
    campaign = find_campaign(client, solution.campaign)
    done = (each for each in client.analyses.list(campaign.id) if each.state is AnalysisState.DONE)
    if (analysis := next(done, None)) is None:
        missing = f"Campaign {campaign.id} has no analysis that is done."
        return SolutionInput(campaigns=((campaign.id,),), missing=(missing,))
    proof = client.analyses.proof(analysis.id)
    return SolutionInput(campaigns=((campaign.id,),), proof=proof)


def _ask_nothing(_client: Client, _solution: GateSolution | SensorSolution) -> SolutionInput:
    return SolutionInput()


_COLLECTORS: Mapping[type, Callable[..., SolutionInput]] = {
    ProbabilitySolution: _ask_probability,
    RiskSolution: _ask_risk,
    SearchSolution: _ask_search,
    ReplaySolution: _ask_replay,
    GateSolution: _ask_nothing,
    SensorSolution: _ask_nothing,
}


def find_campaign(client: Client, reference: CampaignReference) -> Campaign:
    """Return the campaign of an id, or the only one of a name.

    Raises:
        NotFound: no campaign has the id or name.
        InvalidValue: several have the name.
    """
    if isinstance(reference, int):
        return client.campaigns.get(reference)
    found = client.campaigns.list(search=reference)
    return pick_named(reference, [each for each in found if each.spec.name == reference])


def _collect_campaign(client: Client, campaign: int) -> CampaignRecord:
    found = client.campaigns.get(campaign)
    if found.counts.planned > MOST_EPISODES:
        problem = f"campaign {campaign} has more than {MOST_EPISODES:,} episodes."
        raise InvalidValue("campaigns", problem, "Name several smaller ones.")
    with TemporaryDirectory() as folder:
        file = Path(folder) / "episodes.csv"
        client.episodes.export(campaign, file, "csv", fields=COLUMNS)
        table = file.read_bytes()
    episodes = read_episodes(table, f"campaigns/{campaign}.episodes.csv")
    ended = client.campaigns.summary(campaign).unresolved
    facts = CampaignFacts(
        campaign=found,
        workers=_collect_workers(client, campaign),
        unresolved=ended.count,
    )
    noise = tuple(_collect_noise(client, found, episodes))
    return CampaignRecord(facts=facts, table=table, noise=noise)


def _collect_workers(client: Client, campaign: int) -> tuple[WorkerVersions, ...]:
    """Return the versions that workers of a campaign had, each set of versions once."""
    grouped: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for share in sorted(client.campaigns.workers(campaign), key=lambda each: each.worker):
        versions = _find_worker_versions(client, campaign, share.worker)
        grouped.setdefault(tuple(sorted(versions.items())), []).append(share.worker)
    return tuple(
        WorkerVersions(workers=tuple(names), versions=dict(versions))
        for versions, names in grouped.items()
    )


def _find_worker_versions(client: Client, campaign: int, worker: str) -> Versions:
    """Return the versions of a worker by its first episode; empty if they are not known any more.

    Versions come from the record of the worker's arrival; services keep only the newest records.
    """
    where = f'worker = "{worker}"'
    first = next(iter(client.episodes.list(campaign, filter=where, fields=("index",))), None)
    if first is None or not isinstance(index := first["index"], int):
        return {}
    try:
        return client.episodes.worker(campaign, index).versions
    except NotFound:
        return {}


def _collect_noise(
    client: Client, campaign: Campaign, episodes: Sequence[RecordedEpisode]
) -> list[NoiseLine]:
    """Return the noise of a sample of the episodes whose noise does not follow from their seeds.

    The sample follows from the campaign's seed. Noise that was pruned is left out.
    """
    chosen = [
        each.index
        for each in episodes
        if not follows_from_seed(each) and each.outcome is not Outcome.ERRORED
    ]
    if len(chosen) > MOST_NOISE:
        generator = np.random.default_rng(campaign.spec.seed)
        chosen = sorted(generator.choice(chosen, MOST_NOISE, replace=False).tolist())
    found = []
    for index in chosen:
        try:
            z = client.episodes.get(campaign.id, index).noise.z
        except Conflict:
            continue
        if len(z):
            found.append(NoiseLine.of(index, z))
    return found
