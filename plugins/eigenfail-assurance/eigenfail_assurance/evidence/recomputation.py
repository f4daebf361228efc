"""Contents of a bundle, recomputed from its records and compared with its files."""

from collections.abc import Iterator, Mapping
from math import isclose
from typing import Any, NamedTuple

import msgspec
from msgspec.structs import replace

from eigenfail import __version__
from eigenfail.errors import InvalidValue
from eigenfail.values.campaign import FINAL_STATES, CampaignState
from eigenfail.values.campaign_spec import RESULT_RULES
from eigenfail.values.episode import episode_seed
from eigenfail_assurance.evidence import bundle, counting, solutions
from eigenfail_assurance.evidence.argument import ArgumentGraph
from eigenfail_assurance.evidence.judgement import TOLERANCE
from eigenfail_assurance.evidence.question import EvidenceQuestion
from eigenfail_assurance.evidence.records import (
    CampaignFacts,
    CampaignRecord,
    EvidenceRecords,
    NoiseLine,
    SolutionInput,
    decode_file,
    encode_canonical,
    hash_bytes,
    hash_episodes,
)
from eigenfail_assurance.evidence.storage import BundleDefect, make_defect

CAMPAIGNS, TABLE, NOISE = "campaigns/", ".episodes.csv", ".noise.json"


class ReadRecords(NamedTuple):
    """The question of a bundle, and the records that its solutions rest on."""

    question: EvidenceQuestion
    records: EvidenceRecords


class ContentComparison(NamedTuple):
    """Differences from the records, and parts that could not be compared, in sentences."""

    defects: tuple[BundleDefect, ...]
    notes: tuple[str, ...]


def read_records(files: Mapping[str, bytes]) -> ReadRecords:
    """Return the question and the records in the files of a bundle.

    Raises:
        InvalidValue: a file is missing or cannot be read; the error names it.
    """
    question = decode_file(
        _find_file(files, solutions.QUESTION), EvidenceQuestion, solutions.QUESTION
    )
    inputs = decode_file(
        _find_file(files, solutions.INPUTS), tuple[SolutionInput, ...], solutions.INPUTS
    )
    found = {}
    for name in files:
        if name.startswith(CAMPAIGNS) and name.endswith(TABLE):
            stem = name.removesuffix(TABLE)
            found[int(stem.removeprefix(CAMPAIGNS))] = _read_campaign(files, stem)
    return ReadRecords(question, EvidenceRecords(found, inputs))


def _find_file(files: Mapping[str, bytes], name: str) -> bytes:
    if name not in files:
        raise InvalidValue(name, "is missing.")
    return files[name]


def _read_campaign(files: Mapping[str, bytes], stem: str) -> CampaignRecord:
    facts = decode_file(_find_file(files, f"{stem}.json"), CampaignFacts, f"{stem}.json")
    noise: tuple[NoiseLine, ...] = ()
    if (name := f"{stem}{NOISE}") in files:
        noise = decode_file(files[name], tuple[NoiseLine, ...], name)
    if stem != f"{CAMPAIGNS}{facts.campaign.id}":
        raise InvalidValue(f"{stem}.json", f"it is campaign {facts.campaign.id}.")
    return CampaignRecord(facts=facts, table=files[f"{stem}{TABLE}"], noise=noise)


def compare_contents(
    manifest: bundle.Manifest, files: Mapping[str, bytes], read: ReadRecords
) -> ContentComparison:
    """Compare campaigns, solutions, graph and report with what the records give.

    Args:
        manifest: the manifest.
        files: all files by name.
        read: question and records in them.

    Raises:
        InvalidValue: a file cannot be read; the error names it.
    """
    made = solutions.make_solutions(read.question, read.records, manifest.eigenfail)
    stored = tuple(_read_solution(files, each) for each in made)
    graph = solutions.make_graph(read.question, stored)
    pairs = list(zip(stored, made, strict=True))
    found = [
        *_check_names(files, read.records, made),
        *(each for record in read.records.campaigns.values() for each in check_campaign(record)),
        *(each for one, other in pairs for each in _compare_figures(one, other)),
        *(each for one in stored for each in _compare_chain(files, one)),
        *_compare_graph(manifest, files, graph),
    ]
    if manifest.eigenfail != __version__:
        return ContentComparison(tuple(found), (_describe_release(manifest),))
    found += [each for one, other in pairs for each in _compare_texts(one, other)]
    found += [
        BundleDefect(where=name, problem="It does not show the solutions and the graph.")
        for name, content in bundle.draw_files(graph, stored, manifest.eigenfail).items()
        if files.get(name) != content
    ]
    return ContentComparison(tuple(found), ())


def _describe_release(manifest: bundle.Manifest) -> str:
    return (
        f"The bundle was written by eigenfail {manifest.eigenfail}, and this is {__version__}: "
        "numbers, verdicts and the graph were computed again, texts and pages were not."
    )


def _read_solution(
    files: Mapping[str, bytes], made: solutions.SolutionRecord
) -> solutions.SolutionRecord:
    name = f"solutions/{made.id}.json"
    found = decode_file(_find_file(files, name), solutions.SolutionRecord, name)
    if found.id != made.id:
        raise InvalidValue(f"{name}: id", f"It is '{found.id}'.")
    return found


def _check_names(
    files: Mapping[str, bytes], records: EvidenceRecords, made: tuple[solutions.SolutionRecord, ...]
) -> Iterator[BundleDefect]:
    """Yield files that belong to no part of the question."""
    used = {each.campaign for solution in made for each in solution.campaigns}
    expected = {
        bundle.MANIFEST,
        solutions.QUESTION,
        solutions.INPUTS,
        bundle.ARGUMENT,
        bundle.PICTURE,
        bundle.PAGE,
    }
    expected |= {f"solutions/{each.id}.json" for each in made}
    for campaign in used:
        expected |= records.campaigns[campaign].list_files().keys()
    for name in sorted(files.keys() - expected):
        yield BundleDefect(where=name, problem="It belongs to no solution of the question.")


def check_campaign(record: CampaignRecord) -> Iterator[BundleDefect]:
    """Yield the defects of a campaign: of its digest, counts, indices, seeds and recorded noise.

    Raises:
        InvalidValue: the episodes cannot be read.
    """
    counted, campaign = counting.CountedCampaign(record), record.campaign
    yield from _check_digest(counted)
    if campaign.state in FINAL_STATES:
        yield from _check_counts(counted)
    if campaign.state is CampaignState.DONE:
        yield from _check_completeness(counted)
    yield from _check_unresolved(counted)
    for line in record.noise:
        try:
            line.read()
        except InvalidValue as error:
            yield replace(make_defect(error), where=f"{CAMPAIGNS}{campaign.id}{NOISE}")
    for episode in counted.episodes:
        expected = episode_seed(campaign.spec.seed, episode.index)
        # A replay has the seed of the episode that its noise comes from.
        if episode.seed != expected and campaign.spec.method not in counting.REPLAYING:
            problem = f"The seed of episode {episode.index} is not that of the campaign's seed."
            yield BundleDefect(where=f"{CAMPAIGNS}{campaign.id}{TABLE}", problem=problem)
            return


def _check_digest(counted: counting.CountedCampaign) -> Iterator[BundleDefect]:
    campaign = counted.campaign
    where = f"{CAMPAIGNS}{campaign.id}.json: campaign.digest"
    if campaign.digest is None and campaign.state is CampaignState.DONE:
        yield BundleDefect(where=where, problem="It is missing, and the campaign is done.")
    if campaign.digest not in {None, hash_episodes(counted.episodes)}:
        problem = f"It is {campaign.digest}, and that of the episodes is another one."
        yield BundleDefect(where=where, problem=problem)


def _check_counts(counted: counting.CountedCampaign) -> Iterator[BundleDefect]:
    """Yield the counts of a campaign that has ended, and that its episodes do not give.

    Counts of a running campaign are not checked: they were read at another moment than its
    episodes.
    """
    campaign, episodes = counted.campaign, len(counted.episodes)
    name = f"{CAMPAIGNS}{campaign.id}.json: campaign.counts"
    said, found = campaign.counts, counted.counted.counts
    for field in ("completed", "failures", "errored"):
        one, other = getattr(said, field), getattr(found, field)
        if one != other:
            problem = f"It is {one}, and there are {other} such episodes."
            yield BundleDefect(where=f"{name}.{field}", problem=problem)
    if said.planned != campaign.spec.episodes:
        problem = f"It is {said.planned}, and the specification has {campaign.spec.episodes}."
        yield BundleDefect(where=f"{name}.planned", problem=problem)
    if said.cancelled != said.planned - episodes:
        problem = f"It is {said.cancelled}, and {episodes} of {said.planned} episodes are there."
        yield BundleDefect(where=f"{name}.cancelled", problem=problem)


def _check_completeness(counted: counting.CountedCampaign) -> Iterator[BundleDefect]:
    """Yield missing episodes of a campaign that is done and was not ended by a stop rule.

    Rounds are completed in index order. Only a rule on time or cost ends a campaign within a round,
    so that episodes before the last one may be missing.
    """
    campaign, rules = counted.campaign, counted.campaign.spec.stop.given()
    if counted.has_gaps and rules.keys() <= set(RESULT_RULES):
        absent = next(place for place, each in enumerate(counted.episodes) if each.index != place)
        problem = f"There is no episode {absent}, and the campaign is done."
        yield BundleDefect(where=f"{CAMPAIGNS}{campaign.id}{TABLE}", problem=problem)
    is_ended = counting.is_ended_by_failures([counted]) or rules.keys() - {"failures"}
    if campaign.spec.method == counting.MONTE_CARLO and campaign.counts.cancelled and not is_ended:
        where = f"{CAMPAIGNS}{campaign.id}.json: campaign.counts.cancelled"
        problem = f"It is {campaign.counts.cancelled}, and no stop rule ended the campaign."
        yield BundleDefect(where=where, problem=problem)


def _check_unresolved(counted: counting.CountedCampaign) -> Iterator[BundleDefect]:
    """Yield a defect if the service counted more unresolved episodes than safe ones."""
    campaign, unresolved = counted.campaign, counted.record.facts.unresolved
    if unresolved > counted.unresolved:
        problem = f"It is {unresolved}, and there are {counted.unresolved} safe episodes."
        yield BundleDefect(where=f"{CAMPAIGNS}{campaign.id}.json: unresolved", problem=problem)


def _compare_chain(
    files: Mapping[str, bytes], stored: solutions.SolutionRecord
) -> Iterator[BundleDefect]:
    """Yield the files that a solution rests on, and that do not have the hashes in it."""
    hashes = dict(stored.inputs)
    for campaign in stored.campaigns:
        hashes |= campaign.files
    for name, said in hashes.items():
        if name not in files or hash_bytes(files[name]) != said:
            problem = f"Its SHA-256 is not the one in solutions/{stored.id}.json."
            yield BundleDefect(where=name, problem=problem)


def _compare_figures(
    stored: solutions.SolutionRecord, made: solutions.SolutionRecord
) -> Iterator[BundleDefect]:
    """Yield verdicts and numbers that the records do not give, within the last bits."""
    name = f"solutions/{stored.id}.json: finding"
    one, other = stored.finding, made.finding
    if one.verdict is not other.verdict:
        problem = f"It is '{one.verdict}', and the records give '{other.verdict}'."
        yield BundleDefect(where=f"{name}.verdict", problem=problem)
    for field in sorted(one.figures.keys() | other.figures.keys()):
        said, found = one.figures.get(field), other.figures.get(field)
        if not _is_equal(said, found):
            problem = f"It is {said}, and the records give {found}."
            yield BundleDefect(where=f"{name}.figures.{field}", problem=problem)


def _is_equal(one: float | None, other: float | None) -> bool:
    if one is None or other is None:
        return one is other
    return isclose(one, other, rel_tol=TOLERANCE)


def _compare_texts(
    stored: solutions.SolutionRecord, made: solutions.SolutionRecord
) -> Iterator[BundleDefect]:
    """Yield all other fields of a solution that the records do not give.

    Hashes are checked against the stored files, see `_compare_chain`, since a later release may
    write the same records with further fields.
    """
    one, other = (_flatten(msgspec.to_builtins(_leave_out_hashes(each))) for each in (stored, made))
    for field in sorted(one.keys() | other.keys()):
        if one.get(field) != other.get(field) and not field.startswith("finding.figures."):
            problem = "It is not what the records give."
            yield BundleDefect(where=f"solutions/{stored.id}.json: {field}", problem=problem)


def _leave_out_hashes(solution: solutions.SolutionRecord) -> solutions.SolutionRecord:
    """Return a solution with names of files in place of their hashes."""
    campaigns = tuple(
        replace(each, files={name: name for name in each.files}) for each in solution.campaigns
    )
    inputs = {name: name for name in solution.inputs}
    return replace(solution, campaigns=campaigns, inputs=inputs)


def _flatten(value: Any, field: str = "") -> dict[str, Any]:
    """Return the leaves of plain data by their paths."""
    if isinstance(value, Mapping):
        parts = {f"{field}.{name}" if field else name: each for name, each in value.items()}
    elif isinstance(value, list | tuple):
        parts = {f"{field}[{place}]": each for place, each in enumerate(value)}
    else:
        return {field: value}
    return {
        path: leaf for name, each in parts.items() for path, leaf in _flatten(each, name).items()
    }


def _compare_graph(
    manifest: bundle.Manifest, files: Mapping[str, bytes], graph: ArgumentGraph
) -> Iterator[BundleDefect]:
    if files.get(bundle.ARGUMENT) != encode_canonical(graph):
        problem = "It is not the graph of the question and the solutions."
        yield BundleDefect(where=bundle.ARGUMENT, problem=problem)
    for field, said, found in (
        ("name", manifest.name, graph.name),
        ("verdict", manifest.verdict, graph.verdict.value),
    ):
        if said != found:
            problem = f"It is '{said}', and the graph gives '{found}'."
            yield BundleDefect(where=f"{bundle.MANIFEST}: {field}", problem=problem)
