"""Proof by replay on the screen: launched, followed, and told in a table and in words."""

import tomllib
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from eigenfail.cli.figures import UNKNOWN, number, rate
from eigenfail.cli.progress import follow
from eigenfail.cli.tables import table
from eigenfail.client import Client
from eigenfail.errors import InvalidValue
from eigenfail.values import Proof, ReplayedNoise, ReplayKind, Reproduction

Prove = Annotated[
    bool, typer.Option("--prove", help="Replay eigenfailures and medoids, here and in variations.")
]
Variations = Annotated[
    list[str] | None,
    typer.Option(
        "--variation",
        metavar="PARAMETERS",
        help='With --prove: a scenario to replay in, such as "distance_m = 53.0"; "" is the same'
        " scenario. Repeat it for more. Not given: the same scenario and its neighbours.",
    ),
]


def proven(client: Client, analysis: int, given: Sequence[str]) -> Proof:
    """The proof of an analysis, once all of its replays have ended.

    Raises:
        InvalidValue: a variation that cannot be read, or outside the scenario's bounds.
    """
    variations = [read_variation(text) for text in given]
    launched = client.analyses.prove(analysis, variations or None)
    for scenario in launched.scenarios:
        follow(client, scenario.campaign)
    return client.analyses.proof(analysis)


def read_variation(text: str) -> dict[str, Any]:
    """Scenario parameters as in a TOML file, with commas between them.

    Raises:
        InvalidValue: they are something else.
    """
    try:
        given: dict[str, Any] = tomllib.loads(f"given = {{{text}}}")["given"]
    except tomllib.TOMLDecodeError as error:
        remedy = 'Write it as --variation "distance_m = 53.0, ego_speed_mps = 23.0".'
        raise InvalidValue("--variation", f"'{text}' cannot be read: {error}.", remedy) from None
    return given


def proof_table(proof: Proof) -> Table:
    """The replays, one a row; log p beside what noise of p(x) has on the same steps."""
    figures = ("robustness", "log p", "log p/step", "of p(x)")
    grid = table("scenario", "mode", "replayed", "outcome", *figures, "episode", right=figures)
    for scenario in proof.scenarios:
        for replay in scenario.replays:
            grid.add_row(escape(scenario.words), str(replay.mode + 1), replay.what, *cells(replay))
    return grid


def cells(replay: ReplayedNoise) -> Iterator[str]:
    """What came of one replay."""
    yield replay.outcome or UNKNOWN
    yield number(replay.robustness_m)
    yield number(replay.log_probability, 1)
    yield number(replay.log_probability_per_step)
    yield number(replay.expected_log_probability, 1)
    yield f"{replay.campaign}/{replay.index}"


def proof_words(proof: Proof) -> Iterator[str]:
    """How many failed again, of those tried."""
    yield f"{counted(proof.reproduced, ReplayKind.EIGENFAILURE)} in the same scenario."
    if len(proof.scenarios) > 1:
        count = f"in {len(proof.scenarios)} scenarios"
        yield f"{counted(proof.eigenfailures, ReplayKind.EIGENFAILURE)} {count}."
        yield f"{counted(proof.medoids, ReplayKind.MEDOID)} {count}."
    for mode in proof.modes:
        replays = f"eigenfailure {share(mode.eigenfailure)}; medoid {share(mode.medoid)}"
        yield f"Mode {mode.mode + 1}: {replays}."


def counted(found: Reproduction, kind: ReplayKind) -> str:
    """The sentence of a count, without its end."""
    if found.rate is None:
        return f"No replay of {kind}s was completed"
    told = f"{found.rate.k} of {found.rate.n} {kind}s reproduced a failure: {rate(found.rate)}"
    return told if found.rate.k else f"{told}, nearest {number(found.smallest_robustness_m)} m,"


def share(found: Reproduction) -> str:
    """Failed again of tried, and how near the rest came."""
    if found.rate is None:
        return "not replayed"
    told = f"{found.rate.k} of {found.rate.n}"
    return told if found.rate.k else f"{told} (nearest {number(found.smallest_robustness_m)} m)"
