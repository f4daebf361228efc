"""The paper's experiments at full scale: figures, pictures, and docs/reproduction.md from both.

`python plugins/eigenfail-reproduction/benchmarks/reproduction.py` writes the page from the run that
is kept.
"""

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

sys.path.append(str(Path(__file__).parents[3]))

import msgspec
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import RESULTS, ROOT, Figure
from benchmarks.samples import COMMAND
from benchmarks.targets import Target

from eigenfail.client import Client
from eigenfail.hosting.service import Plan, local_service
from eigenfail.suites import Suite
from eigenfail_reproduction.page import format_page, list_claims
from eigenfail_reproduction.paper import PaperReproduction
from eigenfail_reproduction.programme import build_suite
from eigenfail_reproduction.report import fetch_report
from eigenfail_reproduction.statements import build_reproduction

FILE = RESULTS / "reproduction.json"
PAGE = ROOT / "docs" / "reproduction.md"
FOLDER = "reproduction"
"""Of the pictures, beside the page."""

PREFIXES = tuple(
    f"paper.{table}."
    for table in (
        "planners",
        "sweep",
        "training",
        "evaluation",
        "generalisation",
        "safety",
        "components",
        "eigenfailures",
    )
)
"""Of the names of figures: the tables."""

LEARNT, SHOWN, OTHER = "ast", "ast evaluation", "difs evaluation"

PICTURES = {
    "likelihood-severity": ("", "Likelihood against severity of failures, AST and DiFS"),
    "explained-variance": ("", "Variance explained by each principal component"),
    "scores": (SHOWN, "Failures of `ast evaluation` by their first two components"),
    "eigenfailures": (SHOWN, "Eigenfailures of `ast evaluation`, and how far its failures lie off"),
    "influence": (SHOWN, "Influence of each step of `ast evaluation`, aligned at the start"),
    "training": (LEARNT, "Mean noise of the failures in each tenth of the training `ast`"),
}
"""Of a report on three campaigns, with the campaign that a picture is of, if it is of one."""


class Run(NamedTuple):
    """What was found, and SVG pictures by name."""

    found: PaperReproduction
    pictures: Mapping[str, bytes]

    def write_beside(self, claims: Path) -> None:
        """Keep the run beside the file of the claims."""
        write(self, claims.with_name(FILE.name))


def run_reproduction(seed: int, scale: str = "full") -> Run:
    """What `eigenfail reproduce` finds, on a service of its own."""
    suite = build_suite(scale, seed)
    with (
        TemporaryDirectory() as folder,
        local_service(Plan(Path(folder), port=0)) as service,
        Client(service.address.url) as client,
    ):
        client.suites.run(suite, on_progress=lambda _: service.check())
        found = build_reproduction(client, suite, scale)
        return Run(found, dict(draw_pictures(client, suite)))


def draw_pictures(client: Client, suite: Suite) -> Iterator[tuple[str, bytes]]:
    """Pictures of a report, for which the service needs the plug-in that makes reports."""
    campaigns = zip(suite.members, client.suites.find(suite), strict=True)
    ids = {member.name: campaign.id for member, campaign in campaigns if campaign}
    trained = client.analyses.create(ids[LEARNT])
    client.analyses.wait(trained.id)
    other = client.analyses.create(ids[OTHER])
    client.analyses.wait(other.id)
    files = fetch_report(client, [ids[name] for name in (LEARNT, SHOWN, OTHER)])
    for name, (of, _) in PICTURES.items():
        file = f"{name}-campaign-{ids[of]}.svg" if of else f"{name}.svg"
        yield name, files[f"pictures/{file}"]


def find(_crew: EpisodePool, seed: int) -> Iterator[tuple[str, Figure | Run]]:
    """The run, and every number of it; a service has workers of its own."""
    run = run_reproduction(seed)
    yield "reproduction", run
    yield from figures(run.found)
    yield prove_eigenfailures(run.found)


def prove_eigenfailures(found: PaperReproduction) -> tuple[str, Figure]:
    """The eigenfailures of AST's failures that fail again in the scenario that they came from."""
    name, claim = next(
        (name, claim)
        for name, claim in figures(found)
        if name == "paper.eigenfailures.ast_evaluation_the_same_scenario.eigenfailures"
    )
    note = f"as {name}"
    return "cut_in.eigenfailures.reproduced", msgspec.structs.replace(claim, note=note)


def figures(found: PaperReproduction) -> Iterator[tuple[str, Figure]]:
    """Every number of it."""
    for name, claim in list_claims(found).items():
        ends = claim.interval and (claim.interval.low, claim.interval.high)
        yield (
            name,
            Figure(
                value=claim.value,
                unit=claim.unit,
                n=claim.n,
                interval=ends,
                paper=claim.paper,
                command=COMMAND,
            ),
        )


def read(path: Path = FILE) -> PaperReproduction:
    """What is kept."""
    return msgspec.json.decode(path.read_bytes(), type=PaperReproduction)


def write(run: Run, path: Path = FILE) -> None:
    """Replace what is kept, and the pictures beside it."""
    path.write_bytes(msgspec.json.format(msgspec.json.encode(run.found), indent=2) + b"\n")
    folder = path.with_name(FOLDER)
    folder.mkdir(exist_ok=True)
    for name, picture in run.pictures.items():
        (folder / f"{name}.svg").write_bytes(picture)


SEEDS = (
    "The interval of `difs evaluation` does not tell how far another training may differ: of three "
    "trainings of `difs` with 1,000 episodes, whose seeds are this one and the next two, 300 draws "
    "each collided in 16.0, 15.7 and 35.3 %<!-- seeds cut_in.difs.eval300.failure_rate -->."
)


MACHINE = "The machine of this run had two cores, and its service two workers."
MEASURED = "All 300 episodes of each evaluation have both measures."
UNTUNED = "Nothing was tuned to the seed."
NOTES = {
    **dict.fromkeys(
        ("planners", "sweep", "generalisation", "components", "eigenfailures"), UNTUNED
    ),
    "training": f"{UNTUNED} {MACHINE}",
    "evaluation": f"{UNTUNED} {MACHINE} {SEEDS}",
    "safety": f"{UNTUNED} {MEASURED}",
}
"""What is said of the kept run, behind the captions of the program."""


OF_PICTURES = """Of the same run: the training `ast`, `ast evaluation` and `difs evaluation`.
The analyses have the default settings: modes by behaviour, noise of both axes, aligned at the
start; of `ast` the later half of the failures, but for the tenths, which are of all. An
eigenfailure is here the median noise of its mode's failures at each step. Influence is the sum over
the first three components of their share of the variance × the absolute value of their entry.
"""


def illustrate_page(found: PaperReproduction) -> str:
    """The page, with what other seeds gave, and the pictures of the same run behind the tables."""
    tables = tuple(
        msgspec.structs.replace(table, note=f"{table.note} {NOTES.get(table.name, '')}".rstrip())
        for table in found.tables
    )
    found = msgspec.structs.replace(found, tables=tables)
    pictures = (f"![{title}]({FOLDER}/{name}.svg)\n" for name, (_, title) in PICTURES.items())
    return "\n".join((format_page(found), "## Pictures\n", OF_PICTURES, *pictures))


TRIALS = (((*PREFIXES, "cut_in.eigenfailures."), find),)
TARGETS = {"cut_in.eigenfailures.reproduced": Target(low=1.0, paper=1.0)}


if __name__ == "__main__":
    PAGE.write_text(illustrate_page(read()), encoding="utf-8")
