"""A bundle of evidence: files that follow from a question and records, and their manifest.

    evidence.json                   manifest: size and SHA-256 of every other file
    question.json                   claims and criteria
    inputs.json                     what each solution takes from the service besides campaigns
    campaigns/ID.json               a campaign with its spec, counts, estimate and versions
    campaigns/ID.episodes.csv       its episodes
    campaigns/ID.noise.json         noise of a sample of the episodes whose seeds do not give it
    solutions/SnN.json              a solution: what it shows, and the hashes of its files
    argument.json, argument.svg     the graph, with the hashes of the solutions
    report.html                     all of it to read

The same records have the same files, byte for byte. A file that depends on another file holds its
hash; the manifest holds the hash of every file. The manifest has its own hash, over itself with
that field empty; it is the root hash of the bundle.
"""

from collections.abc import Mapping
from typing import Annotated, NamedTuple

import msgspec
from msgspec.structs import replace

from eigenfail_assurance.evidence.argument import ArgumentGraph
from eigenfail_assurance.evidence.drawing import draw_graph
from eigenfail_assurance.evidence.page import format_evidence_page
from eigenfail_assurance.evidence.question import EvidenceQuestion
from eigenfail_assurance.evidence.records import EvidenceRecords, encode_canonical, hash_bytes
from eigenfail_assurance.evidence.solutions import (
    INPUTS,
    QUESTION,
    SolutionRecord,
    make_graph,
    make_solutions,
)

FORMAT = "eigenfail evidence 1"
MANIFEST = "evidence.json"
ARGUMENT, PICTURE, PAGE = "argument.json", "argument.svg", "report.html"

LARGEST_FILE = 2**28
"""Size of a file that is read at most. [bytes]"""

Hash = Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]


class FileEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A file in a manifest, by size [bytes] and SHA-256."""

    path: str
    size: Annotated[int, msgspec.Meta(ge=0, le=LARGEST_FILE)]
    sha256: Hash


class Manifest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Sizes and hashes of the files of a bundle.

    Attributes:
        format: format of the bundle.
        eigenfail: version of the product that wrote it.
        name: name of the argument.
        verdict: of the top claim.
        files: all other files, by name.
        sha256: SHA-256 of the manifest with this field empty: the root hash.
    """

    format: str
    eigenfail: str
    name: str
    verdict: str
    files: tuple[FileEntry, ...]
    sha256: Hash | str = ""

    def find_hash(self) -> str:
        """Return the root hash, computed from the other fields."""
        return hash_bytes(encode_canonical(replace(self, sha256="")))


class EvidenceBundle(NamedTuple):
    """A bundle in memory.

    Attributes:
        manifest: sizes and hashes of its files.
        graph: the argument.
        files: content of all files by name, the manifest among them.
    """

    manifest: Manifest
    graph: ArgumentGraph
    files: Mapping[str, bytes]


def make_bundle(
    question: EvidenceQuestion, records: EvidenceRecords, product: str
) -> EvidenceBundle:
    """Return the bundle of a question: the same bytes for the same records.

    Args:
        question: claims and criteria.
        records: campaigns and inputs of the solutions.
        product: version of the product.

    Raises:
        InvalidValue: records do not fit the question, or cannot be read.
    """
    files = {QUESTION: encode_canonical(question), INPUTS: encode_canonical(records.inputs)}
    for campaign in sorted(records.campaigns):
        files |= records.campaigns[campaign].list_files()
    made = make_solutions(question, records, product)
    files |= {f"solutions/{each.id}.json": encode_canonical(each) for each in made}
    graph = make_graph(question, made)
    files[ARGUMENT] = encode_canonical(graph)
    files |= draw_files(graph, made, product)
    manifest = make_manifest(graph, files, product)
    return EvidenceBundle(manifest, graph, {MANIFEST: encode_canonical(manifest)} | files)


def draw_files(
    graph: ArgumentGraph, solutions: tuple[SolutionRecord, ...], product: str
) -> dict[str, bytes]:
    """Return the picture and the page of an argument by name."""
    picture = draw_graph(graph)
    page = format_evidence_page(graph, solutions, picture, product)
    return {PICTURE: picture.encode(), PAGE: page.encode()}


def make_manifest(graph: ArgumentGraph, files: Mapping[str, bytes], product: str) -> Manifest:
    """Return the manifest of files, with its own hash."""
    entries = (
        FileEntry(path=name, size=len(content), sha256=hash_bytes(content))
        for name, content in sorted(files.items())
    )
    bare = Manifest(
        format=FORMAT,
        eigenfail=product,
        name=graph.name,
        verdict=graph.verdict.value,
        files=tuple(entries),
    )
    return replace(bare, sha256=bare.find_hash())
