"""The paper's tables of campaigns, filled from the summaries of ours."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import msgspec

from eigenfail.intervals import find_interval
from eigenfail.reproduction.programme import LEARNERS, ScenarioProgramme
from eigenfail.values import (
    AnalysisResult,
    AnalysisSettings,
    Interval,
    Proof,
    Rate,
    Safety,
    Summary,
)
from eigenfail.values.analysis import STABLE
from eigenfail.values.disturbance import AXES
from eigenfail.values.proof import ProvenScenario
from eigenfail.values.safety import Violations

REPLAYED = "share of replays"
"""Unit of shares of a few replays of chosen noise: no random sample, so without an interval."""


class PaperNumber(msgspec.Struct, frozen=True):
    """One of our numbers, with the paper's.

    Attributes:
        value: None if undefined, such as the severity of no failures.
        n: number of episodes or failures behind it.
        paper: the paper's number; None if the paper gives none.
    """

    value: float | None
    n: int
    interval: Interval | None = None
    paper: float | None = None


class PaperRow(msgspec.Struct, frozen=True):
    """A row of a table; numbers in the order of the table's columns."""

    name: str
    numbers: tuple[PaperNumber, ...]
    campaign: int | None = None


class PaperColumn(msgspec.Struct, frozen=True):
    """Name, title and unit of a column.

    The unit "share" is printed in percent, `REPLAYED` as k of n.
    """

    name: str
    title: str
    unit: str


class PaperTable(msgspec.Struct, frozen=True):
    """One table of the paper, with our numbers and the printed ones.

    Attributes:
        name: short name, for files and claims.
        note: what a reader must know to compare.
    """

    name: str
    title: str
    columns: tuple[PaperColumn, ...]
    rows: tuple[PaperRow, ...]
    note: str = ""


class PaperStatement(msgspec.Struct, frozen=True):
    """A statement of the paper, judged by our numbers.

    Attributes:
        holds: None where our numbers cannot decide.
        rule: what must be so for the statement to hold, and for it not to hold.
        figures: the numbers that decide it.
        why: what explains it where it does not hold; shown only there.
        subject: what of several campaigns it was judged by, such as "ast"; empty where there is
            one choice.
        asked: whether our runs have what the statement is about, such as failures to compare.
    """

    paper: str
    holds: bool | None
    figures: str
    why: str = ""
    rule: str = ""
    subject: str = ""
    asked: bool = True


class PaperReproduction(msgspec.Struct, frozen=True):
    """All tables and statements, at one scale and seed."""

    scale: str
    seed: int
    tables: tuple[PaperTable, ...]
    statements: tuple[PaperStatement, ...]
    scenario: str = "cut_in"


Numbers = Mapping[str, float]
Rows = Mapping[str, Numbers]


def _publish(rate: float, log_p: float, severity: float) -> Numbers:
    """Return failure rate [%] as a share, mean log p of the failures, mean severity [m²/s²]."""
    return {"failure_rate": rate / 100.0, "log_p": log_p, "severity": severity}


PLANNERS: Rows = MappingProxyType(
    {
        "monte_carlo rulebook": {"failure_rate": 0.0, "severity": 0.0},
        "monte_carlo idm": {"failure_rate": 0.401, "severity": 0.719},
    }
)

SWEEP: Rows = MappingProxyType(
    {
        "sweep base": _publish(96, -5360.22, 152.47),
        "sweep alpha=500": _publish(45, -2465.45, 137.28),
        "sweep alpha=1000": _publish(72, -2124.35, 126.37),
        "sweep alpha=5000": _publish(55, -3950.79, 150.77),
        "sweep c_dist=100": _publish(93, -7340.49, 145.40),
        "sweep c_dist=5000": _publish(98, -7512.87, 165.92),
        "sweep learning_rate=0.001": _publish(3, -1185.76, 122.90),
        "sweep learning_rate=0.0001": _publish(96, -5694.37, 188.23),
        "sweep learning_rate=5e-05": _publish(3, -1885.44, 119.94),
        "sweep batch_size=16": _publish(100, -4014.96, 175.52),
        "sweep batch_size=256": _publish(96, -7250.31, 165.64),
    }
)

LONG_SWEEP: Rows = MappingProxyType(
    {
        **SWEEP,
        "sweep tau=0.001": _publish(99, -3218.86, 136.15),
        "sweep tau=0.01": _publish(98, -4002.00, 155.10),
        "sweep buffer_size=10000": _publish(98, -3861.41, 131.12),
    }
)
"""With the rows that have an effect where episodes have more decisions."""

TRAINING: Rows = MappingProxyType(
    {
        "ast_paper": {**_publish(87.7, -4506.13, 152.63), "cost_usd": 0.012},
        "difs_paper": {**_publish(2.4, -1495.67, 124.93), "cost_usd": 0.648},
    }
)

EVALUATION: Rows = MappingProxyType(
    {
        "monte_carlo rulebook": {"failure_rate": 0.0},
        "ast_paper evaluation": {**_publish(94.6, -2870.26, 164.75), "cost_usd": 0.023},
        "difs_paper evaluation": {**_publish(3.1, -1490.71, 115.21), "cost_usd": 0.518},
    }
)

GENERALISATION: tuple[Numbers, ...] = (
    {"failure_rate": 0.946, "severity": 164.75},
    {"failure_rate": 1.0, "severity": 190.50},
    {"failure_rate": 1.0, "severity": 174.45},
)
"""Where AST was trained, where the car cuts in 5 m further, and where it does 5 m nearer."""

SAFETY: Rows = MappingProxyType(
    {
        "collision": {"count": 9},
        "min_ttc": {"count": 19, "median": 3.50, "worst": 0.015},
        "drac": {"count": 4, "median": 0.40, "worst": 43.633},
    }
)
SAFETY_EPISODES = 300
"""Of DiFS."""
SAFETY_COUNTS = ", ".join(f"{row['count']:g}" for row in SAFETY.values())

EXPLAINED_BY_THREE = MappingProxyType({"longitudinal": 0.40})

MODES = 3


Summaries = Mapping[str, Summary]
Read = Callable[[Summary], PaperNumber]

DRAWN = (
    "Failure rate: share of the n episodes that collide. Brackets hold Wilson's 95 % interval of "
    "independent draws; where none or all failed, an exact one-sided 95 % bound. Ends and bounds "
    "are rounded outwards."
)
ONE_SEARCHER = "That of an evaluation is about its one trained searcher."
SEARCHED = (
    "Failure rate: share of the n episodes that collide; in a search they depend on those before "
    "them, so that it has no interval and is no rate under p(x)."
)
MEANS = (
    "Log p (natural logarithm of the density of the errors in metres, summed over the steps) and "
    "severity (squared relative speed at the collision) are means over the failures; log p per "
    "step is the sum over all failures ÷ their steps. Log p is not comparable with the paper's, "
    "which does not give its number of steps."
)
COST = (
    "Instance-hours are the time that this campaign was active on one instance, in one run; cost "
    "is their price at 1.20 USD per hour ÷ failures, without that of a training before it. "
    "Campaigns of the suite run side by side, four at a time unless the service is told otherwise, "
    "and share its workers and processor cores; that time is counted in full for each of them, so "
    "that hours and cost are not those of the campaign alone. The paper's cost is of a GPU "
    "instance at that price."
)
PAPERS = "of its own planner, simulator and settings, also beside our defaults."
NOT_SWEPT = (
    "Each row changes one setting of the base: `ast` with alpha 10,000, c_dist 1,000, tau 0.005, "
    "learning_rate 3e-4, batch_size 64, buffer_size 100,000, four gradient steps for each decision "
    "and our defaults. The paper also varies tau and buffer_size, which have no effect here, for "
    "the reason given beside the statements."
)
OF_PLANNERS = (
    f"One Monte Carlo campaign of each planner. {DRAWN} Severity is the mean over the failures "
    "(squared relative speed). The paper's numbers are of its own planner and of its IDM; it gives "
    "neither their number of episodes nor the episodes over which severity is averaged."
)
LARGEST_NOT_SWEPT = (
    "Each row changes one setting of the base: `ast` with alpha 10,000, c_dist 1,000, tau 0.005, "
    "learning_rate 3e-4, batch_size 64, buffer_size 100,000, four gradient steps for each decision "
    "and our defaults. The paper's buffer_size of 1,000,000 would give the base again: 300 "
    "episodes have fewer than 100,000 decisions."
)
OF_PAPERS_SWEEP = (
    "The paper's numbers are of 300 episodes each, of the same values with its own planner and "
    "simulator."
)
OF_TRAINING = (
    f"One training campaign for each row. {SEARCHED} {MEANS} {COST} The paper's numbers are of "
    f"1,000 episodes each, {PAPERS}"
)
OF_EVALUATION = (
    "Draws from p(x) (`monte_carlo`), and from what each training left, which learns nothing "
    f"more. {DRAWN} {ONE_SEARCHER} {MEANS} {COST} The paper's numbers are of 2,000 episodes "
    f"of Monte Carlo and 300 each of the others, {PAPERS}"
)
OF_MOVES = (
    f"{DRAWN} {ONE_SEARCHER} Severity (squared relative speed at the "
    "collision) is the mean over the failures. The paper's numbers are of 300 episodes at its "
    f"usual distance and 100 at each other, {PAPERS}"
)
OF_SAFETY = (
    "Share of the n episodes of an evaluation with a collision, a MinTTC (smallest value of gap ÷ "
    "closing speed) below 1.5 s, a DRAC (largest value of closing speed² ÷ (2 · gap)) above "
    "7 m/s². "
    "Brackets hold Wilson's 95 % interval of independent draws from that one trained "
    "searcher; where none or all are counted, an exact one-sided 95 % bound. Ends and bounds are "
    "rounded outwards. Median and worst (smallest MinTTC, largest DRAC) are over the episodes in "
    "which the truck ever closed in; in one that collides, up to the last step of 0.1 s before the "
    f"contact. The paper's shares are its counts ({SAFETY_COUNTS}) of {SAFETY_EPISODES} episodes "
    "of DiFS; it does not say over which of them its medians are, and has none of AST."
)
OF_COMPONENTS = (
    "Analyses of the n failures of an evaluation by the noise (in sigma) of one axis, aligned at "
    "the collision, with default settings otherwise. Variance: the share that the first three "
    "principal components explain. Modes are groups of K-means, as many as have the "
    "largest silhouette (Rousseeuw 1987); they are distinct only where it exceeds the largest of "
    "19 draws of data without groups, and where the median adjusted Rand index (Hubert and Arabie "
    f"1985) is {STABLE} or more; where they are not, one mode is counted. That index "
    "is between the modes and those of failures drawn again with replacement, the median over "
    f"{AnalysisSettings().bootstrap} such draws, in brackets the range of their middle 95 %, "
    "rounded outwards. The paper's numbers are of 300 failures of its AST; it does not say of "
    "which axis its three modes are, nor clearly that its 40 % are of the longitudinal noise, nor "
    "how its failures are aligned: the statements below are judged by other choices, too."
)
OF_REPLAYS = (
    "one eigenfailure and one medoid of each group of the failures of an "
    "evaluation by the noise of both axes, aligned at the start, also where the groups are no "
    "distinct modes. The eigenfailure is the noise that belongs to the mean of the group's scores "
    f"on the first {AnalysisSettings().components} principal components, without the others; the "
    "medoid is the noise of the failure whose scores are nearest to that mean. A replay always has "
    "the same result: these are counts, no rates. The paper says *all*, and gives no number."
)
OF_ALL_VEHICLES = (
    "The noise of an axis is here that of all five vehicles; failures are aligned at the collision "
    "in all statements but that on replays."
)


class ScenarioCaptions(msgspec.Struct, frozen=True):
    """What captions say of one scenario: its sweep, the moves of its parameters, replays."""

    sweep: str
    moves: str
    moves_title: str
    replays: str
    components: str


CAPTIONS: Mapping[str, ScenarioCaptions] = MappingProxyType(
    {
        "cut_in": ScenarioCaptions(
            sweep=NOT_SWEPT,
            moves=(
                "What was trained with the cut-in at distance_m 58, evaluated there and where it "
                "begins 5 m further (`plus5`) and nearer (`minus5`)."
            ),
            moves_title="AST where the cut-in moves",
            replays=(
                "Replays that collided, of all, in the named scenario (*the same* has distance_m "
                "58):"
            ),
            components=OF_COMPONENTS,
        ),
        "highway_drive": ScenarioCaptions(
            sweep=LARGEST_NOT_SWEPT,
            moves=(
                "What was trained with follower_gap_m 9, slow_gap_m 78.5 and cut_in_distance_m 57, "
                "evaluated there, with larger gaps (`farther`: 10, 80, 60) and with smaller ones "
                "(`nearer`: 8, 77, 54). The bounds of the parameters leave no room for 5 m."
            ),
            moves_title="AST where the gaps are others",
            replays=(
                "Replays that collided, of all, in the named scenario (*the same* has slow_gap_m "
                "78.5):"
            ),
            components=f"{OF_COMPONENTS} {OF_ALL_VEHICLES}",
        ),
    }
)


def _read_rate(of: Summary) -> PaperNumber:
    if of.failure_rate is None:
        return PaperNumber(None, 0)
    return PaperNumber(of.failure_rate.value, of.failure_rate.n, of.failure_rate.interval)


def _read_draws(of: Summary) -> PaperNumber:
    """Return the failure rate of independent draws, from p(x) or from one trained searcher."""
    return _count_draws(of.failure_rate)


def _count_draws(rate: Rate | None, paper: float | None = None) -> PaperNumber:
    if rate is None:
        return PaperNumber(None, 0, paper=paper)
    return PaperNumber(rate.value, rate.n, find_interval(rate.k, rate.n), paper)


def _read_mean(value: Callable[[Summary], float | None]) -> Read:
    return lambda of: PaperNumber(value(of), of.counts.failures)


def _read_cost(of: Summary) -> PaperNumber:
    return PaperNumber(of.cost.per_failure_usd, of.counts.failures, of.cost.interval_usd)


def _read_hours(of: Summary) -> PaperNumber:
    return PaperNumber(of.cost.instance_hours, of.counts.completed)


FAILURE_RATE = PaperColumn("failure_rate", "failure rate", "share")
RATE = (FAILURE_RATE, _read_rate)
DRAWN_RATE = (FAILURE_RATE, _read_draws)
LOG_P = (
    PaperColumn("log_p", "mean log p", "nat"),
    _read_mean(lambda of: of.mean_log_probability),
)
PER_STEP_P = (
    PaperColumn("log_p_per_step", "log p per step", "nat"),
    _read_mean(lambda of: of.log_probability_per_step),
)
SEVERITY = (
    PaperColumn("severity", "mean severity", "m²/s²"),
    _read_mean(lambda of: of.mean_severity),
)
COST_USD = (PaperColumn("cost_usd", "cost per failure", "USD"), _read_cost)
HOURS = (PaperColumn("hours", "instance-hours", "h"), _read_hours)


class TableLayout(NamedTuple):
    """Columns and campaigns of a table; `rows` are the paper's numbers by campaign."""

    name: str
    title: str
    columns: Sequence[tuple[PaperColumn, Read]]
    rows: Rows
    note: str = ""


def _pair_rows(rows: Rows, suffix: str) -> Rows:
    """Return the paper's numbers of a method for its default and its paper settings."""
    return {
        f"{name}{suffix}": rows[f"{name.removesuffix('_paper')}_paper{suffix}"] for name in LEARNERS
    }


def _pair_moves(programme: ScenarioProgramme) -> Rows:
    """Return the paper's numbers of AST where it was trained and in similar scenarios."""
    places = ("evaluation", *programme.moved)
    return {
        f"{name} {place}": numbers
        for name in ("ast", "ast_paper")
        for place, numbers in zip(places, GENERALISATION, strict=True)
    }


SEARCHES = (HOURS, RATE, COST_USD, LOG_P, PER_STEP_P, SEVERITY)
DRAWS = (HOURS, DRAWN_RATE, COST_USD, LOG_P, PER_STEP_P, SEVERITY)


def list_layouts(programme: ScenarioProgramme) -> tuple[TableLayout, ...]:
    """Return the layouts of the tables of campaigns, in the paper's order."""
    captions = CAPTIONS[programme.scenario]
    return (
        TableLayout(
            "planners", "Planners under Monte Carlo", (RATE, SEVERITY), PLANNERS, OF_PLANNERS
        ),
        TableLayout(
            "sweep",
            "Sweep of AST's settings",
            (RATE, LOG_P, PER_STEP_P, SEVERITY),
            LONG_SWEEP if "tau" in programme.sweep else SWEEP,
            f"{captions.sweep} {SEARCHED} {MEANS} {OF_PAPERS_SWEEP}",
        ),
        TableLayout("training", "Training", SEARCHES, _pair_rows(TRAINING, ""), OF_TRAINING),
        TableLayout(
            "evaluation",
            "Evaluation",
            DRAWS,
            {
                "monte_carlo rulebook": EVALUATION["monte_carlo rulebook"],
                **_pair_rows(EVALUATION, " evaluation"),
            },
            OF_EVALUATION,
        ),
        TableLayout(
            "generalisation",
            captions.moves_title,
            (DRAWN_RATE, SEVERITY),
            _pair_moves(programme),
            f"{captions.moves} {OF_MOVES}",
        ),
    )


def build_campaign_tables(found: Summaries, programme: ScenarioProgramme) -> Iterator[PaperTable]:
    """Build each table that has a campaign, with a row for each campaign that exists."""
    for layout in list_layouts(programme):
        rows = tuple(_build_row(name, found[name], layout) for name in layout.rows if name in found)
        columns = tuple(column for column, _ in layout.columns)
        if rows:
            yield PaperTable(layout.name, layout.title, columns, rows, layout.note)


def _build_row(name: str, of: Summary, layout: TableLayout) -> PaperRow:
    paper = layout.rows[name]
    numbers = ((column, read(of)) for column, read in layout.columns)
    beside = (
        msgspec.structs.replace(number, paper=paper.get(column.name)) for column, number in numbers
    )
    return PaperRow(name, tuple(beside), of.campaign)


def _group_by_noise(**changes: Any) -> AnalysisSettings:
    """Return settings of an analysis that finds modes as the paper does."""
    return AnalysisSettings(features="noise", **changes)


READINGS: Mapping[tuple[str, str], AnalysisSettings] = MappingProxyType(
    {
        ("longitudinal", "collision"): _group_by_noise(axes="longitudinal", align="collision"),
        ("lateral", "collision"): _group_by_noise(axes="lateral", align="collision"),
        ("joint", "collision"): _group_by_noise(align="collision"),
        ("longitudinal", "start"): _group_by_noise(axes="longitudinal"),
        ("lateral", "start"): _group_by_noise(axes="lateral"),
        # The centre is the paper's, for replays; modes and components do not depend on it.
        ("joint", "start"): _group_by_noise(centre="mean"),
    }
)
"""Analyses by axes and alignment: the paper leaves both open."""


def list_readings(programme: ScenarioProgramme) -> Mapping[tuple[str, str], AnalysisSettings]:
    """Return the settings of the analyses of a programme, by axes and alignment.

    Where the noise is on every vehicle, an axis is that of all vehicles, and all analyses but that
    for replays are aligned at the collision.
    """
    if not programme.every_vehicle:
        return READINGS
    named = dict(zip(AXES, programme.axes, strict=True))
    return {
        (axes, align): msgspec.structs.replace(settings, axes=named.get(axes, settings.axes))
        for (axes, align), settings in READINGS.items()
        if align == "collision" or axes == "joint"
    }


TABLED = (("longitudinal", "collision"), ("lateral", "collision"))
"""Those of the table of components."""

Analyses = Mapping[tuple[str, str, str], AnalysisResult]
"""Of the failures of an evaluation, by the name of its member, axes and alignment."""

MEASURES = (
    PaperColumn("count", "episodes", "share"),
    PaperColumn("median", "median", "s or m/s²"),
    PaperColumn("worst", "worst", "s or m/s²"),
)
COMPONENTS = (
    PaperColumn("first_three", "variance of the first three", "share"),
    PaperColumn("modes", "distinct modes", "modes"),
    PaperColumn("silhouette", "silhouette", "index"),
    PaperColumn("noise_silhouette", "silhouette without groups", "index"),
    PaperColumn("stability", "adjusted Rand index", "index"),
)
REPLAYS = (
    PaperColumn("eigenfailures", "eigenfailures reproduced", REPLAYED),
    PaperColumn("medoids", "medoids reproduced", REPLAYED),
)


def build_safety_table(found: Mapping[str, Safety]) -> PaperTable:
    """Build the table of collisions, MinTTC and DRAC of evaluations."""
    rows = (row for name, safety in found.items() for row in _build_safety_rows(name, safety))
    return PaperTable("safety", "Safety measures", MEASURES, tuple(rows), OF_SAFETY)


def _build_safety_rows(name: str, safety: Safety) -> Iterator[PaperRow]:
    # The paper has these measures of DiFS alone.
    paper = SAFETY if name.startswith("difs") else {}
    collisions = (
        _count_draws(safety.collisions, _read_papers_share(paper.get("collision"))),
        *2 * (PaperNumber(None, 0),),
    )
    yield PaperRow(f"{name}: collision", collisions, safety.campaign)
    for measure, words in (("min_ttc", "MinTTC < 1.5 s"), ("drac", "DRAC > 7 m/s²")):
        of = safety.ttc if measure == "min_ttc" else safety.drac
        numbers = _read_violations(of, paper.get(measure))
        yield PaperRow(f"{name}: {words}", numbers, safety.campaign)


def _read_violations(of: Violations, paper: Numbers | None) -> tuple[PaperNumber, ...]:
    median, worst = (paper["median"], paper["worst"]) if paper else (None, None)
    return (
        _count_draws(of.beyond, _read_papers_share(paper)),
        PaperNumber(of.median, of.n, paper=median),
        PaperNumber(of.worst, of.n, paper=worst),
    )


def _read_papers_share(paper: Numbers | None) -> float | None:
    """Return the paper's count as a share of its 300 episodes."""
    return paper["count"] / SAFETY_EPISODES if paper else None


def describe_replays(programme: ScenarioProgramme) -> str:
    """Return the caption of the table of replays."""
    return f"{CAPTIONS[programme.scenario].replays} {OF_REPLAYS}"


def build_component_table(found: Analyses, programme: ScenarioProgramme) -> PaperTable:
    """Build the table of principal components and modes, one row for each axis."""
    rows = (
        PaperRow(f"{name}: {axes}", _read_components(axes, result))
        for (name, axes, align), result in found.items()
        if (axes, align) in TABLED
    )
    caption = CAPTIONS[programme.scenario].components
    return PaperTable(
        "components", "Principal components and modes", COMPONENTS, tuple(rows), caption
    )


def _read_components(axis: str, result: AnalysisResult) -> tuple[PaperNumber, ...]:
    n = len(result.episodes)
    return (
        PaperNumber(float(result.explained.sum()), n, paper=EXPLAINED_BY_THREE.get(axis)),
        PaperNumber(float(len(result.modes) if result.distinct else 1), n, paper=MODES),
        PaperNumber(result.silhouette, n),
        PaperNumber(result.noise_silhouette, n),
        _read_stability(result),
    )


def _read_stability(result: AnalysisResult) -> PaperNumber:
    if result.stability is None:
        return PaperNumber(None, 0)
    return PaperNumber(
        result.stability.median, result.stability.resamples, result.stability.interval
    )


def build_replay_table(found: Mapping[str, Proof], programme: ScenarioProgramme) -> PaperTable:
    """Build the table of replays of eigenfailures and medoids, by scenario."""
    rows = (
        PaperRow(f"{name}: {_name_scenario(scenario)}", _read_replays(scenario), scenario.campaign)
        for name, proof in found.items()
        for scenario in proof.scenarios
    )
    caption = describe_replays(programme)
    return PaperTable("eigenfailures", "Eigenfailures replayed", REPLAYS, tuple(rows), caption)


def _read_replays(scenario: ProvenScenario) -> tuple[PaperNumber, ...]:
    # The paper says that all eigenfailures failed again.
    return (_read_share(scenario.eigenfailures.rate, 1.0), _read_share(scenario.medoids.rate))


def _read_share(rate: Rate | None, paper: float | None = None) -> PaperNumber:
    if rate is None:
        return PaperNumber(None, 0, paper=paper)
    return PaperNumber(rate.value, rate.n, paper=paper)


def _name_scenario(scenario: ProvenScenario) -> str:
    given = scenario.scenario_parameters
    return ", ".join(f"{name} {value:g}" for name, value in given.items()) or "the same scenario"
