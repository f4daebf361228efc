"""Solutions as files of a bundle: judged, with hashes of their files and versions."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import msgspec
from msgspec.structs import replace

from eigenfail.errors import InvalidValue
from eigenfail.values.operations import Versions
from eigenfail_assurance.evidence.argument import ArgumentGraph, JudgedSolution, build_graph
from eigenfail_assurance.evidence.assumptions import Surroundings, gather_surroundings
from eigenfail_assurance.evidence.counting import Counted, CountedCampaign
from eigenfail_assurance.evidence.judgement import SolutionFinding, judge_solution
from eigenfail_assurance.evidence.question import AnySolution, EvidenceQuestion
from eigenfail_assurance.evidence.records import (
    EvidenceRecords,
    PlannerIdentity,
    SolutionInput,
    WorkerVersions,
    encode_canonical,
    hash_bytes,
    list_campaigns,
)
from eigenfail_assurance.evidence.references import check_references

QUESTION, INPUTS = "question.json", "inputs.json"


class SolutionCampaign(msgspec.Struct, frozen=True, kw_only=True):
    """A campaign behind a solution.

    Attributes:
        campaign: its id.
        digest: over all of its results, as the service has it; None if it has not ended.
        planner: the planner under test.
        services: versions of the services that ran it, in order.
        workers: known versions of the workers that ran its episodes.
        files: SHA-256 of its files, by name.
    """

    campaign: int
    digest: str | None
    planner: PlannerIdentity
    services: tuple[Versions, ...]
    workers: tuple[WorkerVersions, ...]
    files: dict[str, str]


class SolutionRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A solution as a file of a bundle.

    Attributes:
        id: its number in the graph.
        kind: kind of output.
        finding: verdict on its criterion, with the numbers behind it.
        context: planner, scenario, p(x) and requirements of its campaigns, in sentences.
        assumptions: what must be true for it, in sentences.
        campaigns: the campaigns behind it.
        inputs: SHA-256 of `question.json` and `inputs.json`.
        eigenfail: version of the product that judged it.
    """

    id: str
    kind: str
    finding: SolutionFinding
    context: tuple[str, ...]
    assumptions: tuple[str, ...]
    campaigns: tuple[SolutionCampaign, ...]
    inputs: dict[str, str]
    eigenfail: str


def make_solutions(
    question: EvidenceQuestion, records: EvidenceRecords, product: str
) -> tuple[SolutionRecord, ...]:
    """Return the solutions of a question, judged by the records.

    Raises:
        InvalidValue: records do not fit the question, or cannot be read.
    """
    solutions = tuple(question.claim.list_solutions())
    if len(solutions) != len(records.inputs):
        raise InvalidValue(INPUTS, f"there are {len(records.inputs)} inputs, not {len(solutions)}.")
    counted = {each: CountedCampaign(record) for each, record in records.campaigns.items()}
    inputs = {QUESTION: encode_canonical(question), INPUTS: encode_canonical(records.inputs)}
    hashes = {name: hash_bytes(content) for name, content in inputs.items()}
    # One dictionary for each campaign: hashing a million episodes again for each solution is slow.
    files = {each: _hash_files(counted[each]) for each in counted}
    return tuple(
        _make_solution(f"Sn{number}", solution, given, _Context(counted, files, hashes, product))
        for number, (solution, given) in enumerate(zip(solutions, records.inputs, strict=True), 1)
    )


class _Context(NamedTuple):
    counted: Counted
    files: Mapping[int, dict[str, str]]
    inputs: dict[str, str]
    product: str


def _hash_files(counted: CountedCampaign) -> dict[str, str]:
    return {name: hash_bytes(content) for name, content in counted.record.list_files().items()}


def _make_solution(
    name: str, solution: AnySolution, given: SolutionInput, context: _Context
) -> SolutionRecord:
    used = list_campaigns(solution, given)
    if missing := [str(each) for each in used if each not in context.counted]:
        raise InvalidValue(name, f"there is no record of campaign {', '.join(missing)}.")
    check_references(name, solution, given, context.counted)
    surroundings = gather_surroundings(solution, given, context.counted)
    return SolutionRecord(
        id=name,
        kind=str(type(solution).__struct_config__.tag),
        finding=judge_solution(solution, given, context.counted),
        context=surroundings.context,
        assumptions=surroundings.assumptions,
        campaigns=tuple(_describe_campaign(each, context) for each in used),
        inputs=context.inputs,
        eigenfail=context.product,
    )


def _describe_campaign(campaign: int, context: _Context) -> SolutionCampaign:
    facts = context.counted[campaign].record.facts
    return SolutionCampaign(
        campaign=campaign,
        digest=facts.campaign.digest,
        planner=facts.planner,
        services=tuple(part.versions for part in facts.campaign.parts),
        workers=facts.workers,
        files=context.files[campaign],
    )


def make_graph(question: EvidenceQuestion, solutions: tuple[SolutionRecord, ...]) -> ArgumentGraph:
    """Return the graph of a question with its judged solutions."""
    judged = [
        JudgedSolution(
            each.finding,
            Surroundings(each.context, each.assumptions),
            hash_bytes(encode_canonical(each)),
        )
        for each in solutions
    ]
    assumptions = (*question.claim.assumptions, *_describe_planners(solutions))
    return build_graph(question.name, replace(question.claim, assumptions=assumptions), judged)


def _describe_planners(solutions: Sequence[SolutionRecord]) -> Iterator[str]:
    """Yield that solutions test several planners, if they do; a gate always compares two."""
    planners = [
        campaign.planner
        for solution in solutions
        if solution.kind != "gate"
        for campaign in solution.campaigns
    ]
    if len({encode_canonical(each) for each in planners}) > 1:
        names = dict.fromkeys(f"'{each.name}' {each.version}".strip() for each in planners)
        yield (
            f"The solutions test several planners or settings ({', '.join(names)}): what holds "
            "for one of them is taken to hold for the planner of the claim."
        )
