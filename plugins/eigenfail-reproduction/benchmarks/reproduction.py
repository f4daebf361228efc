"""The paper's experiments over five seeds: figures, pictures, and docs/reproduction.md from them.

`python plugins/eigenfail-reproduction/benchmarks/reproduction.py` writes the page from the runs
that are kept.
"""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

sys.path.append(str(Path(__file__).parents[3]))

import msgspec
import over_seeds
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import RESULTS, ROOT, Figure
from benchmarks.samples import COMMAND
from benchmarks.targets import Target

from eigenfail.client import Client
from eigenfail.hosting.service import Plan, local_service
from eigenfail.suites import Suite
from eigenfail_reproduction import page, seeds
from eigenfail_reproduction.paper import PaperReproduction
from eigenfail_reproduction.programme import build_suite
from eigenfail_reproduction.report import fetch_report
from eigenfail_reproduction.statements import build_reproduction

SEEDS = 5
FILE = RESULTS / "reproduction.json"
PAGE = ROOT / "docs" / "reproduction.md"
FOLDER = "reproduction"
"""Of the pictures, beside the page."""

TABLES = (
    "planners",
    "sweep",
    "training",
    "evaluation",
    "generalisation",
    "safety",
    "components",
    "eigenfailures",
)
COUNTS = ("paper.asked", "paper.holds", "paper.refuted", "paper.undecided", "paper.sweep_rows")
PREFIXES = (*(f"paper.{table}." for table in TABLES), *COUNTS)
"""Of the names of figures: the tables, and counts over all seeds."""

LEARNT, SHOWN, OTHER = "ast", "ast evaluation", "ast_paper evaluation"

PICTURES = {
    "likelihood-severity": ("", "Likelihood against severity of failures of AST"),
    "explained-variance": ("", "Variance explained by each principal component"),
    "scores": (SHOWN, "Failures of `ast evaluation` by their first two components"),
    "eigenfailures": (SHOWN, "Eigenfailures of `ast evaluation`, and how far its failures lie off"),
    "influence": (SHOWN, "Influence of each step of `ast evaluation`, aligned at the start"),
    "training": (LEARNT, "Mean noise of the failures in each tenth of the training `ast`"),
}
"""Of a report on three campaigns, with the campaign that a picture is of, if it is of one."""


class Runs(NamedTuple):
    """What was found with each seed, and SVG pictures of the first one by name."""

    found: tuple[PaperReproduction, ...]
    pictures: Mapping[str, bytes]

    def write_beside(self, claims: Path) -> None:
        """Keep the runs beside the file of the claims."""
        write(self, claims.with_name(FILE.name))


def find(_crew: EpisodePool, seed: int) -> Iterator[tuple[str, Figure | Runs]]:
    """The runs, and every number of them; a service has workers of its own."""
    runs = run_seeds(range(seed, seed + SEEDS))
    yield "reproduction", runs
    yield from list_figures(runs.found)


def run_seeds(each: Sequence[int], scale: str = "full") -> Runs:
    """What `eigenfail reproduce` finds with each seed, on a service of its own."""
    with (
        TemporaryDirectory() as folder,
        local_service(Plan(Path(folder), port=0)) as service,
        Client(service.address.url) as client,
    ):
        suites = [build_suite(scale, seed) for seed in each]
        found = tuple(run_suite(client, suite, scale, service.check) for suite in suites)
        return Runs(found, dict(draw_pictures(client, suites[0])))


def run_suite(
    client: Client, suite: Suite, scale: str, check: Callable[[], None]
) -> PaperReproduction:
    """Run the campaigns of one seed while the service lives, and build their tables."""
    client.suites.run(suite, on_progress=lambda _: check())
    print(f"{suite.name}, seed {suite.members[0].spec.seed}: campaigns are done", flush=True)
    return build_reproduction(client, suite, scale)


def draw_pictures(client: Client, suite: Suite) -> Iterator[tuple[str, bytes]]:
    """Pictures of a report, for which the service needs the plug-in that makes reports."""
    campaigns = zip(suite.members, client.suites.find(suite), strict=True)
    ids = {member.name: campaign.id for member, campaign in campaigns if campaign}
    # The default analysis is the newest one of each, which the report draws.
    for name in (LEARNT, SHOWN, OTHER):
        client.analyses.wait(client.analyses.create(ids[name]).id)
    files = fetch_report(client, [ids[name] for name in (LEARNT, SHOWN, OTHER)])
    for name, (of, _) in PICTURES.items():
        file = f"{name}-campaign-{ids[of]}.svg" if of else f"{name}.svg"
        yield name, files[f"pictures/{file}"]


def list_figures(found: Sequence[PaperReproduction]) -> Iterator[tuple[str, Figure]]:
    """Every number of the tables, and counts of verdicts and of settings with an effect."""
    yield from over_seeds.list_figures(found)
    yield from over_seeds.list_verdicts("paper", found)
    rows = len(list_sweep(found[0]))
    acting = 1 + sum(has_effect(name, found) for name in list_sweep(found[0]) if name != BASE)
    same = "paper.eigenfailures.ast_evaluation_the_same_scenario.eigenfailures"
    proven = dict(over_seeds.list_figures(found))[same]
    yield "cut_in.eigenfailures.reproduced", msgspec.structs.replace(proven, note=f"as {same}")
    note = f"rows of {rows} that differ from the base with each seed, and the base"
    yield (
        "paper.sweep_rows_acting",
        Figure(value=acting, unit="rows", n=rows, command=COMMAND, note=note),
    )


BASE = "sweep base"


def list_sweep(found: PaperReproduction) -> list[str]:
    """The names of the campaigns of the sweep."""
    return [row.name for one in found.tables if one.name == "sweep" for row in one.rows]


def has_effect(row: str, found: Sequence[PaperReproduction]) -> bool:
    """Whether a campaign of the sweep has other failures than the base with each seed."""
    return all(list_values(one, row) not in ({}, list_values(one, BASE)) for one in found)


def list_values(found: PaperReproduction, row: str) -> Mapping[str, float | None]:
    """The numbers of a campaign of the sweep; none if it was not run."""
    numbers = over_seeds.find_numbers(found, "sweep", row)
    return {name: number.value for name, number in numbers.items()}


def read(path: Path = FILE) -> tuple[PaperReproduction, ...]:
    """Return the kept runs."""
    return over_seeds.read(path)


def write(runs: Runs, path: Path = FILE) -> None:
    """Replace the kept runs, and the pictures in a folder next to them."""
    over_seeds.write(over_seeds.SeedRuns(runs.found), path)
    folder = path.with_name(FOLDER)
    folder.mkdir(exist_ok=True)
    for name, picture in runs.pictures.items():
        (folder / f"{name}.svg").write_bytes(picture)


OPENING = """# The paper's experiments, reproduced

The paper is Warner et al., *Importance Sampling and PCA for Finding Failures in Commercial
Autonomous Vehicles*. Its planner and its simulator are not public. This page repeats its
experiments with our planner `rulebook`, our scenario `cut_in` and our simulator, so our numbers
need not be the paper's.

{asked}<!-- claim paper.asked --> of {statements} comparisons with the paper's statements can be
asked here: {holds}<!-- claim paper.holds --> hold, {refuted}<!-- claim paper.refuted --> do not
hold, and {undecided}<!-- claim paper.undecided --> are not shown
([verdicts](#verdicts-over-the-seeds)). `eigenfail reproduce --scale full --seed {first}` runs the
campaigns of one seed.

How to read the tables:

- Every campaign was run with five seeds, {first} to {last}, and 1000 more in evaluations. A number
  is the median of the seeds; the smallest and the largest follow in parentheses. Draws of
  `monte_carlo` and `held`, and replays, are counted over all seeds together.
"""

OF_PICTURES = """The pictures are for the first seed: the training `ast`, `ast evaluation` and
`ast_paper evaluation`. Analyses have the default settings: modes by behaviour, noise of both axes,
aligned at the start. Of the training, the later half of the failures is analysed; the tenths
include all failures. An eigenfailure here is the median noise of its mode's failures at each step.
Influence is the sum over the first three components of their share of the variance × the absolute
value of their entry.
"""

RULES = """The numbers are for seed {seed}.
"""

DRAWN = """\
Draws of `monte_carlo` and `held` are counted over all seeds, with Wilson's 95 % interval in
square brackets; if none or all failed, the bound is exact and one-sided (95 %). Ends and bounds
are rounded outwards. Upper ends count draws that may have failed: errored and unresolved ones.
"""
SEARCHED = """\
A search chooses its episodes by the results of earlier ones. Its failure rate is therefore not a
rate under p(x), and has no interval.
"""
MEANS = """\
Log p is the natural logarithm of the density of the errors [m], summed over the steps of an
episode. Severity is the squared relative speed at the collision. Both are means over the failures
of a campaign. Log p per step is the sum over its failures, divided by their steps.
"""
COST = """\
Instance-hours are the time for which a campaign was active, with four campaigns side by side on
two processor cores, which also ran other programs. Cost is their price at 1.20 USD per hour,
divided by the failures; an earlier training is not included. The paper's cost is for a GPU
instance at the same price.
"""
CAPTIONS: Mapping[str, str] = {
    "planners": f"""\
2,000 episodes of Monte Carlo with each planner and seed. {DRAWN}The paper's numbers are for its
own planner and its IDM.
""",
    "sweep": f"""\
Each row changes one setting of the base: `ast` with alpha 10,000, c_dist 1,000, tau 0.005,
learning_rate 3e-4, batch_size 64, buffer_size 100,000 and four gradient steps for each decision.
A campaign has 300 episodes. Rows name the paper's buffer sizes. Buffers here hold a fiftieth of
these decisions, because an action lasts 50 steps. The paper's buffer_size of 1,000,000 was not
run. {SEARCHED}{MEANS}The paper's numbers are for 300 episodes with its own planner and simulator.
""",
    "training": f"""\
Trainings of 1,000 episodes. {SEARCHED}{MEANS}{COST}The paper's numbers are for 1,000 episodes
with its own planner, simulator and settings.
""",
    "evaluation": f"""\
2,000 draws from p(x) (`monte_carlo`), 2,000 draws from p(x) with each draw held for a second
(`held`), and 300 draws from the searcher that each training left, which learns nothing more.
{DRAWN}{MEANS}{COST}The paper's numbers are for 2,000 episodes of Monte Carlo and 300 of each
other row, with its own planner, simulator and settings.
""",
    "generalisation": """\
AST was trained with a cut-in at distance_m 58, and is evaluated there (300 draws), 5 m further
away (`plus5`) and 5 m nearer (`minus5`, 100 draws each). Severity is the squared relative speed
at the collision, the mean over the failures. The paper's numbers are for as many episodes with
its own planner and simulator.
""",
    "safety": """\
The share of the 300 episodes of an evaluation with a collision, with a MinTTC below 1.5 s, and
with a DRAC above 7 m/s². MinTTC is the smallest value of gap ÷ closing speed; DRAC is the largest
value of closing speed² ÷ (2 · gap). Median and worst of a seed are over its episodes in which the
truck ever closed in. An episode with a collision counts up to the last step before the contact.
The paper has such counts for 300 episodes of DiFS alone.
""",
    "components": """\
Analyses of the failures of an evaluation by the noise of one axis (in sigma), aligned at the
collision; other settings are defaults. Variance is the share that the first three principal
components explain. Modes are groups of K-means; their number has the largest silhouette
(Rousseeuw 1987). They are distinct if the silhouette exceeds the largest of 19 draws of data
without groups, and if the median adjusted Rand index (Hubert and Arabie 1985) between the modes
and modes of failures drawn again is high enough; otherwise one mode is counted. The paper's
numbers are for 300 failures of its AST. It does not say which axis has three modes, nor how its
failures are aligned.
""",
    "eigenfailures": """\
Replays that collided, of all replays of all seeds in the named scenario (*the same* has
distance_m 58): one eigenfailure and one medoid for each group of the failures of an evaluation.
Groups are by the noise of both axes, aligned at the start, and need not be distinct modes. The
eigenfailure is the noise at the mean of the group's scores on the first three principal
components; the medoid is the noise of the failure whose scores are nearest to this mean. A replay
always has the same result, so these are counts.
""",
}
"""Captions of the tables, by their names."""


def format_page(found: Sequence[PaperReproduction]) -> str:
    """The page in Markdown."""
    figures = dict(list_figures(found))
    judged = seeds.judge_over_seeds(found)
    counts = {
        name: f"{figures[f'paper.{name}'].value:.0f}"
        for name in ("asked", "holds", "refuted", "undecided")
    }
    opening = OPENING.format(
        first=found[0].seed, last=found[-1].seed, statements=len(judged), **counts
    )
    parts = (
        opening + page.READING + over_seeds.EARLIER_DIFS + page.SETTINGS["cut_in"],
        *over_seeds.format_tables(found, CAPTIONS),
        "## Verdicts over the seeds\n",
        VERDICTS,
        over_seeds.OF_VERDICTS,
        *over_seeds.format_verdicts(judged, REASONS),
        "## Rules, and numbers of one seed\n",
        page.OF_STATEMENTS,
        RULES.format(seed=found[0].seed),
        *over_seeds.format_rules(found[0]),
        "## Pictures\n",
        OF_PICTURES,
        *(f"![{title}]({FOLDER}/{name}.svg)\n" for name, (_, title) in PICTURES.items()),
    )
    return "\n".join(parts)


VERDICTS = """\
Each seed judges a statement, as the column *holds if* of the next table says. A statement *cannot
be asked* unless more than half of the seeds have the data, such as ten failures to compare. It
*holds* if it holds in more than half of all seeds; otherwise it *does not hold*. A seed is
*undecided* if an interval includes no difference, or if choices that the paper leaves open give
different answers. A verdict is *not shown* if at least as many seeds are undecided as give it.
"""

NOT_BOTH = "Monte Carlo finds no failure where AST and DiFS both do."
BATCH = "A small batch improves failure rate, log p and severity."
ALPHA = "A small alpha makes failures likelier and fewer."
C_DIST = "A large c_dist makes failures more frequent and more severe."
TAU = "A small tau makes failures likelier."
BUFFER = "A large buffer makes failures likelier."
LIKELIER = "DiFS finds likelier failures than AST."
MOVES = "AST's policy fails the planner at other distances of the cut-in, too."
COMPONENTS = "Longitudinal noise needs more components than lateral noise."
LARGEST = "The largest entries of the components lie just before the collision."
MODES = "There are 3 distinct failure modes."
REPLAYS = "Eigenfailures reproduce failures in all scenarios tested."
SEVERE = "Severe collisions are rarer than minor ones."

NOTHING_FOUND = (
    "The earlier DiFS with the paper's schedule found no failure. Its first 500 draws are white "
    "noise over 700 steps, which never comes near a collision. Tested in trials (seed 11): no "
    "other weight of the condition (0.15, 5, 10), and no more gradient steps (2,000), found one in "
    "1,000 episodes. The present one found none with 1,000 gradient steps, in a trial with seed 11."
)
ONE_AXIS = (
    "Tested: a policy repeats the noise that decides, and the other noise varies. With four of "
    "five seeds longitudinal noise decides: without lateral noise all failures fail again, and "
    "without longitudinal noise 0 to 40 % do. With the fifth seed lateral noise decides, and needs "
    "fewer components at the collision (claims `paper.causes.ast.*`)."
)
TWO_AXES = (
    "Tested, and not explained: longitudinal noise decides with three of five seeds (claims "
    "`paper.causes.ast_paper.*`). With the two others the shares at the collision are equal "
    "(80.5 %), or lateral noise needs more components (72.7 against 80.2 %)."
)
EARLIER = (
    "Tested: the noise just before the collision does not matter. Replayed without the noise of "
    "their last second, all failures fail again; with that noise alone, none does (medians of the "
    "claims `paper.causes.*`)."
)
POLICY_DECIDES = "It depends on the trained policy: "
READINGS = (
    "The number of groups depends on choices that the paper leaves open (axis, alignment): the six "
    "readings of one seed have from 2 to 8 groups, or none that is distinct."
)

REASONS: Mapping[tuple[str, str], str] = {
    (
        "Under Monte Carlo the planner fails less often than IDM.",
        "",
    ): "`idm` takes perceived positions as they are. With a new error every 0.02 s it always "
    "crashes; with one every 0.1 s it crashes in 36 % of episodes (claim "
    "`cut_in.idm.mc2000.failure_rate`).",
    (
        NOT_BOTH,
        "ast, difs",
    ): "In evaluation, AST found failures with every seed, and DiFS with three of five.",
    (NOT_BOTH, "ast_paper, difs_paper"): NOTHING_FOUND,
    (BATCH, ""): "Tested: a gradient step on a small batch sees fewer decisions. With 16 in place "
    "of 4 gradient steps, a batch of 16 sees as many decisions as the base, and finds 224 failures "
    "in the median; the base finds 175, and 181 with 16 gradient steps, too (claims "
    "`paper.causes.*`). Log p and severity were not tested.",
    (ALPHA, ""): "Tested with five seeds: their spread is larger than the effect. The base alone "
    "has 133 to 228 failures; with the smallest alpha there are more in three seeds and fewer in "
    "two.",
    (C_DIST, ""): "Tested with five seeds: two of the three seeds that have ten failures of each "
    "have the most severe ones with the smallest c_dist, and none with the largest. Some trainings "
    "with a small or a large c_dist learn nothing within 300 episodes.",
    (TAU, ""): "The smallest tau gives likelier failures than the base with all four seeds that "
    "have ten failures. With two of these seeds the largest tau gives failures that are likelier "
    "still.",
    (BUFFER, ""): "The small buffer holds 14 episodes. Trainings with it find fewer than ten "
    "failures in three of five seeds.",
    (LIKELIER, "ast, difs"): "Tested: the number of steps. With 700 steps, DiFS reaches "
    "failures only by much less likely noise. With 100 steps of 0.1 s its failures are likelier "
    "than AST's failures (claims `cut_in.difs.eval300.log_p_per_step`, "
    "`cut_in.ast.eval300.log_p_per_step`).",
    (LIKELIER, "ast_paper, difs_paper"): NOTHING_FOUND,
    (MOVES, "ast"): "The policies see the vehicles and react to them.",
    (MOVES, "ast_paper"): "The policies see the vehicles and react to them.",
    (COMPONENTS, "ast"): ONE_AXIS,
    (COMPONENTS, "ast_paper"): TWO_AXES,
    (LARGEST, "ast"): EARLIER,
    (LARGEST, "ast_paper"): EARLIER,
    (MODES, "ast"): READINGS,
    (MODES, "ast_paper"): READINGS,
    (REPLAYS, "ast"): "A policy adds much the same noise in all failures of a group.",
    (REPLAYS, "ast_paper"): "A policy adds much the same noise in all failures of a group.",
    (SEVERE, "ast"): POLICY_DECIDES + "three seeds show it, and no seed the contrary.",
    (SEVERE, "ast_paper"): POLICY_DECIDES + "one seed shows it, and two show the contrary.",
    (SEVERE, "difs"): "All three seeds whose evaluation has failures show it.",
    (SEVERE, "difs_paper"): NOTHING_FOUND,
}
"""Why each statement holds, does not hold or cannot be asked, by statement and subject."""


TRIALS = (((*PREFIXES, "cut_in.eigenfailures."), find),)
TARGETS = {
    "cut_in.eigenfailures.reproduced": Target(low=1.0, paper=1.0),
    "paper.sweep_rows_acting": Target(low=14.0),
}


if __name__ == "__main__":
    PAGE.write_text(format_page(read()), encoding="utf-8")
