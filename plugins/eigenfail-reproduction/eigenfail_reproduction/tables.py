"""The paper's tables of campaigns, filled from the summaries of ours."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import msgspec

from eigenfail.intervals import bound_rate
from eigenfail.values.analysis import AnalysisResult, AnalysisSettings
from eigenfail.values.disturbance import AXES
from eigenfail.values.estimates import Rate
from eigenfail.values.proof import Proof, ProvenScenario
from eigenfail.values.safety import Safety, Violations
from eigenfail.values.summary import Summary
from eigenfail_reproduction.captions import (
    CAPTIONS,
    MEANS,
    OF_EVALUATION,
    OF_MOVES,
    OF_PAPERS_SWEEP,
    OF_PLANNERS,
    OF_REPLAYS,
    OF_SAFETY,
    OF_TRAINING,
    SEARCHED,
)
from eigenfail_reproduction.paper import (
    EVALUATION,
    EXPLAINED_BY_THREE,
    GENERALISATION,
    MODES,
    PLANNERS,
    REPLAYED,
    SAFETY,
    SAFETY_EPISODES,
    SWEEP,
    TRAINING,
    DrawCounts,
    Numbers,
    PaperColumn,
    PaperNumber,
    PaperRow,
    PaperTable,
    Rows,
)
from eigenfail_reproduction.programme import LEARNERS, ScenarioProgramme

Summaries = Mapping[str, Summary]
Read = Callable[[Summary], PaperNumber]


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
    draws = DrawCounts(rate.k, rate.trials, rate.errored + rate.unresolved)
    return PaperNumber(rate.value, rate.n, bound_rate(rate), paper, draws)


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
            "planners", "Planners under Monte Carlo", (DRAWN_RATE, SEVERITY), PLANNERS, OF_PLANNERS
        ),
        TableLayout(
            "sweep",
            "Sweep of AST's settings",
            (RATE, LOG_P, PER_STEP_P, SEVERITY),
            SWEEP,
            f"{captions.sweep} {SEARCHED} {MEANS} {OF_PAPERS_SWEEP}",
        ),
        TableLayout("training", "Training", SEARCHES, _pair_rows(TRAINING, ""), OF_TRAINING),
        TableLayout(
            "evaluation",
            "Evaluation",
            DRAWS,
            {
                **{name: EVALUATION[name] for name in ("monte_carlo rulebook", "held")},
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


def list_readings(
    programme: ScenarioProgramme,
) -> Mapping[tuple[str, str], AnalysisSettings]:
    """Return the settings of the analyses of a programme, by axes and alignment.

    If the noise is on every vehicle, an axis is that of all vehicles, and all analyses but that
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
