"""Argue claims about a planner with outputs, as a bundle that is verified offline."""

import re
from collections.abc import Iterator
from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import msgspec
import typer
from typer.core import TyperGroup

from eigenfail.cli.connection import connect_to
from eigenfail.cli.options import AsJson, Url
from eigenfail.cli.render import show
from eigenfail.errors import InvalidValue
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.presentation.figures import count_noun
from eigenfail.progress import announce
from eigenfail_assurance.evidence.argument import ArgumentGraph
from eigenfail_assurance.evidence.bundle import EvidenceBundle
from eigenfail_assurance.evidence.collection import collect_bundle
from eigenfail_assurance.evidence.judgement import ClaimVerdict
from eigenfail_assurance.evidence.page import describe_verdict, list_lines
from eigenfail_assurance.evidence.question import read_evidence_file
from eigenfail_assurance.evidence.storage import check_output, write_bundle
from eigenfail_assurance.evidence.verification import EvidenceCheck, verify_bundle

COLLECT = "collect"

EXIT_CODES = {
    ClaimVerdict.SUPPORTED: 0,
    ClaimVerdict.REFUTED: 1,
    ClaimVerdict.UNDECIDED: 3,
    ClaimVerdict.UNDEVELOPED: 3,
}

TAMPERED = 1

ROOT_HASH = re.compile(r"[0-9a-fA-F]{64}")


class EvidenceCommands(TyperGroup):
    """`eigenfail evidence`, which collects for a file if no other command is named."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the command in front of a file."""
        if args and args[0] not in (*self.commands, *ctx.help_option_names):
            args = [COLLECT, *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=EvidenceCommands,
    add_completion=False,
    no_args_is_help=True,
    help="Argue claims about a planner with outputs, as a bundle that is verified offline.\n\n"
    "`eigenfail evidence FILE.toml` is short for `eigenfail evidence collect FILE.toml`.",
)

EvidenceFile = Annotated[
    Path, typer.Argument(metavar="FILE.toml", help="Claims, with the outputs that support them.")
]
Output = Annotated[
    Path, typer.Option("--output", "-o", help="Folder of the bundle, or an archive NAME.zip.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace the bundle that is there.")]
BundlePath = Annotated[
    Path, typer.Argument(metavar="BUNDLE", help="Folder or ZIP archive of a bundle.")
]
RootHash = Annotated[
    str, typer.Option("--root-hash", help="Root hash that was printed when it was made.")
]
Replay = Annotated[
    int, typer.Option("--replay", min=0, max=100_000, help="Number of episodes to run again.")
]
SampleSeed = Annotated[
    int | None,
    typer.Option(
        "--seed",
        min=0,
        show_default="from the root hash",
        help="Seed of the choice of these episodes.",
    ),
]


class CollectedEvidence(msgspec.Struct, frozen=True, kw_only=True):
    """What `eigenfail evidence` says of a bundle.

    Attributes:
        output: where it is.
        root_hash: its root hash.
        argument: the graph.
    """

    output: str
    root_hash: str
    argument: ArgumentGraph


@app.command(COLLECT)
def collect(
    context: typer.Context,
    file: EvidenceFile,
    output: Output = Path("evidence"),
    force: Force = False,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Judge each claim by the outputs that are to support it, and write a bundle.

    The bundle holds the argument in the Goal Structuring Notation, a report, and the episodes that
    the numbers rest on. Exits with 0 if the top claim is supported, with 1 if it is refuted, and
    with 3 if it is undecided or undeveloped; the bundle is written in each case. An error of the
    service exits with 3 as well, with a message on standard error and without a bundle.
    """
    question = read_evidence_file(file)
    check_output(output, force=force)
    with connect_to(context, url) as client, announce("Collecting the evidence"):
        bundle = collect_bundle(client, question)
        write_bundle(bundle.files, output)
    said = CollectedEvidence(
        output=str(output), root_hash=bundle.manifest.sha256, argument=bundle.graph
    )
    show(said, as_json, *_list_lines(bundle, output))
    raise typer.Exit(EXIT_CODES[bundle.graph.verdict])


@app.command()
def verify(
    bundle: BundlePath,
    root_hash: RootHash = "",
    replay: Replay = 0,
    seed: SampleSeed = None,
    as_json: AsJson = False,
) -> None:
    """Check a bundle without a service: its hashes, its numbers, and replays of a sample.

    Exits with 0 if all is as it was written, with 1 if something is not, and with 2 if there is no
    bundle. Replays run the planners that the bundle names, as far as they are installed here.
    """
    if root_hash and not ROOT_HASH.fullmatch(root_hash):
        problem = f"'{root_hash}' is no SHA-256 of 64 hexadecimal digits."
        raise InvalidValue("--root-hash", problem, "Copy the line that was printed.")
    with announce(f"Verifying {bundle}"):
        checked = verify_bundle(bundle, root_hash, replay, seed)
    show(checked, as_json, *_list_findings(checked))
    raise typer.Exit(0 if checked.is_verified else TAMPERED)


def _list_lines(bundle: EvidenceBundle, output: Path) -> tuple[str, ...]:
    root_hash = bundle.manifest.sha256
    command = f"eigenfail evidence verify {quote(str(output))} --replay 10 --root-hash {root_hash}"
    return (
        describe_verdict(bundle.graph),
        "",
        *list_lines(bundle.graph),
        "",
        f"The bundle is {output}.",
        f"Root hash: {root_hash}",
        f"Check it: {command}",
    )


def _list_findings(checked: EvidenceCheck) -> Iterator[str]:
    for each in checked.defects:
        yield f"{each.where}: {each.problem}"
    if checked.is_verified:
        yield (
            f"Verified: {count_noun(checked.files, 'file')}, "
            f"{count_noun(checked.solutions, 'solution')} computed again from "
            f"{count_noun(checked.episodes, 'episode')}, {checked.replayed} of them run again."
        )
        yield f"Top claim: {checked.verdict}."
    else:
        yield f"Not verified: {count_noun(len(checked.defects), 'defect')}."
    if checked.root_hash:
        yield f"Root hash: {checked.root_hash}"
    yield from checked.notes
