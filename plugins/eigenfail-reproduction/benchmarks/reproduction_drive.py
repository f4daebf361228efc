"""The paper's experiments on `highway_drive` over five seeds: figures, and the page from them.

The first seed runs the full programme, the others what is trained alone.
`python plugins/eigenfail-reproduction/benchmarks/reproduction_drive.py` writes the page from the
kept runs.
"""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.append(str(Path(__file__).parents[3]))

import msgspec
import over_seeds
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import RESULTS, ROOT, Figure
from benchmarks.learning_figures import of_seeds
from benchmarks.samples import COMMAND

from eigenfail.client import Client
from eigenfail.hosting.service import Plan, local_service
from eigenfail.values.estimates import Interval
from eigenfail_reproduction import seeds
from eigenfail_reproduction.page import PREFIXES as NAMES
from eigenfail_reproduction.page import format_our_number, format_tables, list_claims
from eigenfail_reproduction.paper import PaperNumber, PaperReproduction
from eigenfail_reproduction.programme import LEARNERS, build_suite
from eigenfail_reproduction.statements import build_reproduction
from eigenfail_reproduction.tables import FAILURE_RATE

SCENARIO = "highway_drive"
PREFIX = NAMES[SCENARIO]
SEEDS = 5
FILE = RESULTS / "reproduction_drive.json"
PAGE = ROOT / "docs" / "reproduction_drive.md"

PREFIXES = ("paper.drive.",)
"""Of the names of figures: the first seed, the counts of verdicts, and learners over seeds."""


class SeedRuns(over_seeds.SeedRuns, frozen=True):
    """What was found with each seed, which is kept in a file."""

    def write_beside(self, claims: Path) -> None:
        """Keep the runs beside the file of the claims."""
        over_seeds.write(self, claims.with_name(FILE.name))


def find(_crew: EpisodePool, seed: int) -> Iterator[tuple[str, Figure | SeedRuns]]:
    """Yield the reproductions, and the figures in them."""
    with (
        TemporaryDirectory() as folder,
        local_service(Plan(Path(folder), port=0)) as service,
        Client(service.address.url) as client,
    ):
        runs = SeedRuns(tuple(run_seeds(client, seed, service.check)))
    yield "reproduction_drive", runs
    yield from list_figures(runs.found)


def run_seeds(client: Client, seed: int, check: Callable[[], None]) -> Iterator[PaperReproduction]:
    """Run the programme of each seed while the service lives, one after the other."""
    for each in range(seed, seed + SEEDS):
        scale = "full" if each == seed else "learners"
        suite = build_suite(scale, each, SCENARIO)
        client.suites.run(suite, on_progress=lambda _: check())
        yield build_reproduction(client, suite, scale, SCENARIO)


def list_figures(found: Sequence[PaperReproduction]) -> Iterator[tuple[str, Figure]]:
    """Every number of the first seed, counts of verdicts, and failure rates over the seeds."""
    for name, claim in list_claims(found[0]).items():
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
    yield from over_seeds.list_verdicts(PREFIX, found)
    for learner in LEARNERS:
        place = f"{PREFIX}.learners.{learner}"
        yield f"{place}.eval300.failure_rate", count_draws(found[:1], learner)
        yield f"{place}.eval100.failure_rate", count_draws(found[1:], learner)
        rates = [find_rate(each, "training", learner) for each in found[1:]]
        shares = [rate.value for rate in rates]
        figure = of_seeds(shares, "share", rates[0].n, f"; scenario {SCENARIO}")
        yield f"{place}.train300.failure_rate", figure


def count_draws(found: Sequence[PaperReproduction], learner: str) -> Figure:
    """The failure rate of draws from what trainings left: its median over the seeds.

    One training has an interval, which is about its searcher. Several searchers have none.
    """
    rates = [find_rate(each, "evaluation", f"{learner} evaluation") for each in found]
    figure = of_seeds([rate.value for rate in rates], "share", sum(rate.n for rate in rates))
    ends = rates[0].interval if len(rates) == 1 else None
    note = f"scenario {SCENARIO}; draws from what was trained; {figure.note}"
    interval = ends and (ends.low, ends.high)
    return msgspec.structs.replace(figure, interval=interval, note=note)


def find_rate(found: PaperReproduction, table: str, row: str) -> PaperNumber:
    """The failure rate of a campaign."""
    return over_seeds.find_numbers(found, table, row)["failure_rate"]


def read(path: Path = FILE) -> tuple[PaperReproduction, ...]:
    """What is kept."""
    return over_seeds.read(path)


OPENING = """# The paper's experiments on a drive

This page has the experiments of [The paper reproduced](reproduction.md) on another scenario,
[`highway_drive`](world.md#the-scenario-highway_drive). It labels every failure with its true cause,
so that modes can be compared with causes. `eigenfail reproduce --scenario highway_drive --scale
full --seed {first}` runs the campaigns of the first seed. Tables below *Learners over the seeds*
are for this seed alone: a row is one campaign.

- **The drive** has three challenges, one after the other. In the *phantom*, noise pulls a passing
  car into the truck's lane, and a follower is behind. In the *reveal*, a car leaves the lane and
  uncovers a slow car. In the *cut-in*, a car changes into the lane. A *cause* names the challenge
  whose vehicle was struck, and says whether the planner had lost its track of that vehicle
  ([world](world.md#the-scenario-highway_drive)).
- **Settings**: `ast` and `difs` have our defaults, but trainings of AST end after 100 failures in a
  row, and evaluations run the last policy. `ast_paper` has the settings of the paper's main runs,
  with four gradient steps for each decision, and the settings of `ast` for all others; `difs_paper`
  has the paper's schedule. White noise with the paper's sigma is on every vehicle: ten channels.
{earlier_difs}- **Searches follow** the smallest *time to collision* of an episode
  ([importance](requirements.md#importance)). The paper uses the smallest distance. Here a passing
  car in the next lane sets that distance, which is nearly the same in every drive under p(x)
  ([measured](world.md#the-scenario-highway_drive)).
- **Fixed before the runs**: the programme (`PROGRAMMES` in `programme.py` of the
  [plug-in](../plugins/eigenfail-reproduction/README.md)), the statements and the rule of the
  verdicts, after a trial with few episodes and another seed. In a first run searches followed the
  distance, and the evaluations of DiFS had no failure in 700 draws. Two changes were made in trials
  with the seeds 11 and 12, and all campaigns were run again: searches follow the time to collision,
  and `difs_paper` weighs its condition by 2. The paper does not give this weight; our default,
  0.15, found no failure. One rule came later: a setting cannot be asked about if its campaigns have
  the same failures.
- **Steps**: an episode has 420 steps of 0.1 s. This number cannot be set. The paper does not give
  the number of its steps.
- **Seeds**: {first} to {last}, and 1000 more in evaluations. The first seed runs all campaigns with
  the paper's numbers of episodes. The other seeds (`--scale learners`) only train and evaluate,
  with 300 and 100 episodes. This was decided while the first seed ran, for lack of computing time,
  and before any statement was judged.
- **Held noise**: the programme has had the campaign `held` since these runs; they lack it.
- **Time**: the machine ran other programs at the same time, so instance-hours and cost say little
  about the methods.
- **Verdicts** follow the rule of [that page](reproduction.md#verdicts-over-the-seeds).

{asked}<!-- claim paper.drive.asked --> of {statements} statements can be asked:
{holds}<!-- claim paper.drive.holds --> hold, {refuted}<!-- claim paper.drive.refuted --> are
refuted, and {undecided}<!-- claim paper.drive.undecided --> are not shown. The last one is about a
setting without an effect.
"""


def format_page(found: Sequence[PaperReproduction]) -> str:
    """The page in Markdown."""
    figures = dict(list_figures(found))
    judged = seeds.judge_over_seeds(found)
    opening = OPENING.format(
        first=found[0].seed,
        last=found[-1].seed,
        earlier_difs=over_seeds.EARLIER_DIFS,
        statements=len(judged),
        asked=f"{figures['paper.drive.asked'].value:.0f}",
        **{
            name: f"{figures[f'paper.drive.{name}'].value:.0f}"
            for name in ("holds", "refuted", "undecided")
        },
    )
    parts = (
        opening,
        "## Verdicts over the seeds\n",
        over_seeds.OF_VERDICTS + ONE_SEED,
        *over_seeds.format_verdicts(judged, REASONS),
        "## Rules, and numbers of one seed\n",
        RULES.format(seed=found[0].seed),
        *over_seeds.format_rules(found[0]),
        *format_learners(found, figures),
    )
    return "\n".join((*parts, *format_tables(found[0])))


RULES = """The numbers are for seed {seed}; its tables are below.
"""
ONE_SEED = """If a statement has one seed, only the first seed has its campaigns.
"""


OF_LEARNERS = """\
The share of episodes that collide. The first two columns are for seed {first}: 1,000 episodes of
the training, and 300 draws from its searcher. The next two columns list the seeds {second} to
{last}: 300 episodes of each training, and 100 draws from each searcher. The last column is the
median of these four searchers. Brackets are Wilson's 95 % interval of the draws from one searcher;
if none or all failed, the bound is exact and one-sided (95 %). Other trainings may differ by more.
"""


def format_learners(
    found: Sequence[PaperReproduction], figures: Mapping[str, Figure]
) -> Iterator[str]:
    """The table of failure rates over the seeds."""
    first, *others = found
    yield "## Learners over the seeds\n"
    yield OF_LEARNERS.format(first=first.seed, second=others[0].seed, last=others[-1].seed)
    yield "| learner | 1,000 trained | 300 draws | 300 trained | 100 draws each | median |"
    yield "|---|--:|--:|--:|--:|--:|"
    for learner in LEARNERS:
        cells = (
            mark_share(
                f"{PREFIX}.training.{learner}.failure_rate",
                find_rate(first, "training", learner),
            ),
            mark_figure(f"{PREFIX}.learners.{learner}.eval300.failure_rate", figures),
            mark_seeds(
                f"{PREFIX}.learners.{learner}.train300.failure_rate",
                [find_rate(each, "training", learner) for each in others],
            ),
            mark_seeds(
                f"{PREFIX}.learners.{learner}.eval100.failure_rate",
                [find_rate(each, "evaluation", f"{learner} evaluation") for each in others],
            ),
            mark_figure(f"{PREFIX}.learners.{learner}.eval100.failure_rate", figures),
        )
        yield f"| `{learner}` | {' | '.join(cells)} |"
    yield ""


def mark_share(name: str, number: PaperNumber) -> str:
    """A share of a table, with its mark."""
    return f"{format_our_number(FAILURE_RATE, number)}<!-- claim {name} -->"


def mark_figure(name: str, figures: Mapping[str, Figure]) -> str:
    """A share with its interval, and its mark."""
    figure = figures[name]
    interval = figure.interval and Interval(*figure.interval)
    return mark_share(name, PaperNumber(figure.value, figure.n, interval))


def mark_seeds(name: str, rates: Sequence[PaperNumber]) -> str:
    """One share for each seed, with their mark."""
    shares = ", ".join(f"{100.0 * (rate.value or 0.0):.1f}" for rate in rates)
    return f"{shares} %<!-- seeds {name} -->"


FOUND_ANYWAY = (
    "Monte Carlo found failures: the drive was made to fail seldom, not never. Both searches found "
    "many more in fewer episodes."
)
STEPWISE = (
    "Failures of DiFS are likelier for each step in all five seeds. Failures of AST end sooner, "
    "most in the first challenge, so mean log p has the other order."
)
MOVED = (
    "Most failures happen in the phantom, the first challenge. Of the gaps that were moved, only "
    "the gap to the follower matters there."
)
CLOSE_SHARES = (
    "The two shares are close in most seeds, and three seeds against two are not a clear majority."
)
SPREAD = (
    "Influence is spread over the seconds before the collision. Policies hold their noise for a "
    "second, which may be the cause (not tested)."
)
REPLAYED = (
    "A policy adds much the same noise in all failures of a group, and most failures happen before "
    "the gap matters that the similar scenarios change."
)

REASONS: Mapping[tuple[str, str], str] = {
    (
        "Under Monte Carlo the planner fails less often than IDM.",
        "",
    ): "`idm` takes perceived positions as they are, and crashes in nearly every drive with noise "
    "on all vehicles.",
    (
        "Monte Carlo finds no failure where AST and DiFS both do.",
        "ast, difs",
    ): FOUND_ANYWAY,
    (
        "Monte Carlo finds no failure where AST and DiFS both do.",
        "ast_paper, difs_paper",
    ): FOUND_ANYWAY,
    (
        "A small batch improves failure rate, log p and severity.",
        "",
    ): "The share of failures does not differ significantly from the base, and mean log p has "
    "another order.",
    (
        "A small alpha makes failures likelier and fewer.",
        "",
    ): "A small alpha makes failures likelier, as the paper says, and more frequent.",
    (
        "A large c_dist makes failures more frequent and more severe.",
        "",
    ): "Severity is highest with the largest c_dist, but its failure rate does not differ "
    "significantly from the base.",
    (
        "A small tau makes failures likelier.",
        "",
    ): "Log p per step does not follow tau, and mean log p has another order.",
    (
        "A large buffer makes failures likelier.",
        "",
    ): "Both campaigns have the same failures: most episodes end early, so the smaller buffer "
    "drops no decision.",
    ("DiFS finds likelier failures than AST.", "ast, difs"): STEPWISE,
    ("DiFS finds likelier failures than AST.", "ast_paper, difs_paper"): STEPWISE,
    ("AST's policy fails the planner at other distances of the cut-in, too.", "ast"): MOVED,
    ("AST's policy fails the planner at other distances of the cut-in, too.", "ast_paper"): MOVED,
    (
        "Longitudinal noise needs more components than lateral noise.",
        "ast",
    ): CLOSE_SHARES,
    (
        "Longitudinal noise needs more components than lateral noise.",
        "ast_paper",
    ): CLOSE_SHARES,
    ("The largest entries of the components lie just before the collision.", "ast"): SPREAD,
    ("The largest entries of the components lie just before the collision.", "ast_paper"): SPREAD,
    (
        "There are 3 distinct failure modes.",
        "ast",
    ): "Nearly all failures happen in the phantom (mode collapse). One seed has three modes, and "
    "they do not agree with the causes.",
    (
        "There are 3 distinct failure modes.",
        "ast_paper",
    ): "Most failures happen in the phantom. Seeds have two to four modes, or no distinct mode. "
    "The seed with three modes misses the causes by a little (index 0.61).",
    (
        "Eigenfailures reproduce failures in all scenarios tested.",
        "ast",
    ): REPLAYED + " Two seeds have failures with more causes; one half and two thirds of their "
    "replays collide.",
    ("Eigenfailures reproduce failures in all scenarios tested.", "ast_paper"): REPLAYED,
    (
        "Severe collisions are rarer than minor ones.",
        "ast",
    ): "It depends on the trained policy: two seeds show it, two show the contrary.",
    (
        "Severe collisions are rarer than minor ones.",
        "ast_paper",
    ): "It depends on the trained policy: one seed shows it, one shows the contrary.",
    (
        "Severe collisions are rarer than minor ones.",
        "difs",
    ): "The rank correlation is below 0 in four of five seeds, and its interval includes 0 in all.",
    (
        "Severe collisions are rarer than minor ones.",
        "difs_paper",
    ): "Four seeds show it, and in the fifth the interval just includes 0.",
}
"""Why each statement holds, does not hold or cannot be asked, by statement and subject."""


TRIALS = ((PREFIXES, find),)


if __name__ == "__main__":
    PAGE.write_text(format_page(read()), encoding="utf-8")
