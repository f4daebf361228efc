"""The paper's figures on causes: safety measures, components, modes, eigenfailures."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType

from eigenfail.reproduction import published
from eigenfail.reproduction.results import Column, Number, PaperTable, Row
from eigenfail.values import AnalysisResult, AnalysisSettings, Proof, Rate, Safety
from eigenfail.values.proof import ProvenScenario
from eigenfail.values.safety import Violations

AXES: Mapping[str, AnalysisSettings] = MappingProxyType(
    {
        "longitudinal": AnalysisSettings(align="collision", axes="longitudinal"),
        "lateral": AnalysisSettings(align="collision", axes="lateral"),
    }
)
"""How each axis of the noise is analysed apart."""

Analyses = Mapping[tuple[str, str], AnalysisResult]
"""Of the failures of an evaluation, by the name of its member and the axis."""

MEASURES = (
    Column("count", "episodes", "share"),
    Column("median", "median", "s or m/s²"),
    Column("worst", "worst", "s or m/s²"),
)
COMPONENTS = (
    Column("first_three", "variance of the first three", "share"),
    Column("modes", "distinct modes", "modes"),
    Column("silhouette", "silhouette", "index"),
    Column("noise_silhouette", "of noise", "index"),
    Column("stability", "adjusted Rand index", "index"),
    Column("late_influence", "influence just before the collision", "share"),
    Column("late_time", "share of the time", "share"),
)
REPLAYS = (
    Column("eigenfailures", "eigenfailures reproduced", "share"),
    Column("medoids", "medoids reproduced", "share"),
)


def safety_table(found: Mapping[str, Safety]) -> PaperTable:
    """Collisions, MinTTC and DRAC of evaluations."""
    rows = (row for name, safety in found.items() for row in of_safety(name, safety))
    note = "The paper's are of its 300 episodes of DiFS. Collisions have no median and no worst."
    return PaperTable("safety", "Safety measures", MEASURES, tuple(rows), note)


def of_safety(name: str, safety: Safety) -> Iterator[Row]:
    """The three rows of an evaluation."""
    collisions = (share(safety.collisions, papers_share("collision")), *2 * (Number(None, 0),))
    yield Row(f"{name}: collision", collisions, safety.campaign)
    for measure, words in (("min_ttc", "MinTTC < 1.5 s"), ("drac", "DRAC > 7 m/s²")):
        of = safety.ttc if measure == "min_ttc" else safety.drac
        yield Row(f"{name}: {words}", measured(measure, of), safety.campaign)


def measured(measure: str, of: Violations) -> tuple[Number, ...]:
    """Episodes beyond the threshold, median and worst."""
    paper = published.SAFETY[measure]
    return (
        share(of.beyond, papers_share(measure)),
        Number(of.median, of.n, paper=paper["median"]),
        Number(of.worst, of.n, paper=paper["worst"]),
    )


def papers_share(measure: str) -> float:
    """The paper's count as a share of its 300 episodes."""
    return published.SAFETY[measure]["count"] / published.SAFETY_EPISODES


def share(rate: Rate | None, paper: float | None = None) -> Number:
    """A rate with its interval."""
    if rate is None:
        return Number(None, 0, paper=paper)
    return Number(rate.value, rate.n, rate.interval, paper)


def component_table(found: Analyses) -> PaperTable:
    """What PCA and clustering say of the failures, each axis apart."""
    rows = (
        Row(f"{name}: {axis}", components(axis, result)) for (name, axis), result in found.items()
    )
    note = "Aligned at the collision; silhouettes count only where they exceed those of noise."
    return PaperTable("components", "Principal components and modes", COMPONENTS, tuple(rows), note)


def components(axis: str, result: AnalysisResult) -> tuple[Number, ...]:
    """The numbers of one analysis."""
    n = len(result.episodes)
    return (
        Number(float(result.explained.sum()), n, paper=published.EXPLAINED_BY_THREE.get(axis)),
        Number(float(len(result.modes) if result.distinct else 1), n, paper=published.MODES),
        Number(result.silhouette, n),
        Number(result.noise_silhouette, n),
        stability(result),
        *late(axis, result),
    )


def stability(result: AnalysisResult) -> Number:
    """Whether the clusters come back under the bootstrap."""
    if result.stability is None:
        return Number(None, 0)
    return Number(result.stability.median, result.stability.resamples, result.stability.interval)


def late(axis: str, result: AnalysisResult) -> tuple[Number, Number]:
    """The influence of the last time before the collision, and how long a part that time is."""
    if not result.before_collision:
        return Number(None, 0), Number(None, 0)
    last, n = result.before_collision[0], len(result.episodes)
    return Number(getattr(last, axis), n), Number(last.time, n)


def replay_table(found: Mapping[str, Proof]) -> PaperTable:
    """Eigenfailures and medoids in the same scenario and its neighbours."""
    rows = (
        Row(f"{name}: {place(scenario)}", replays(scenario), scenario.campaign)
        for name, proof in found.items()
        for scenario in proof.scenarios
    )
    return PaperTable("eigenfailures", "Eigenfailures replayed", REPLAYS, tuple(rows))


def replays(scenario: ProvenScenario) -> tuple[Number, ...]:
    """How many failed again; the paper says of eigenfailures that all did."""
    return (share(scenario.eigenfailures.rate, 1.0), share(scenario.medoids.rate))


def place(scenario: ProvenScenario) -> str:
    """Which scenario."""
    given = scenario.scenario_parameters
    return ", ".join(f"{name} {value:g}" for name, value in given.items()) or "the same scenario"
