"""What the paper says of the causes of failures, held against what we found."""

from collections.abc import Iterator, Mapping

from eigenfail.reproduction import published
from eigenfail.reproduction.diagnosis import AXES, Analyses
from eigenfail.reproduction.results import Statement
from eigenfail.reproduction.words import UNKNOWN
from eigenfail.values import AnalysisResult, Proof, Safety


def of_causes(
    analyses: Analyses, proofs: Mapping[str, Proof], safeties: Mapping[str, Safety]
) -> Iterator[Statement]:
    """The statements that analyses, proofs and safety measures decide, for each evaluation."""
    for name, proof in proofs.items():
        longitudinal, lateral = (analyses[name, axis] for axis in AXES)
        yield spread_out(name, longitudinal, lateral)
        yield late(name, longitudinal)
        yield distinct(name, longitudinal)
        yield reproduced(name, proof)
    for name, safety in safeties.items():
        yield severe_are_rare(name, safety)


def spread_out(name: str, longitudinal: AnalysisResult, lateral: AnalysisResult) -> Statement:
    """Which axis needs more components."""
    along, across = (100.0 * float(one.explained.sum()) for one in (longitudinal, lateral))
    return Statement(
        "Longitudinal noise needs more components than lateral noise.",
        along < across,
        f"{name}: the first three explain {along:.0f} % along the road, {across:.0f} % across",
    )


def late(name: str, result: AnalysisResult) -> Statement:
    """When noise matters."""
    claim = "The largest entries of the components lie just before the collision."
    for last in result.before_collision[:1]:
        if last.longitudinal is not None:
            return Statement(
                claim,
                last.longitudinal > last.time,
                f"{name}: the last {last.seconds:g} s hold {100.0 * last.longitudinal:.0f} % of "
                f"the longitudinal influence in {100.0 * last.time:.0f} % of the time",
            )
    return Statement(claim, None, f"{name}: there is no influence")


def distinct(name: str, result: AnalysisResult) -> Statement:
    """How many modes there are."""
    return Statement(
        f"There are {published.MODES} distinct failure modes.",
        result.distinct and len(result.modes) == published.MODES,
        f"{name}: {result.verdict}",
    )


def reproduced(name: str, proof: Proof) -> Statement:
    """Whether eigenfailures fail again."""
    rate = proof.eigenfailures.rate
    return Statement(
        "Eigenfailures reproduce failures in all scenarios tested.",
        None if rate is None else rate.k == rate.n,
        f"{name}: {rate.k} of {rate.n} replays" if rate else f"{name}: none was replayed",
    )


def severe_are_rare(name: str, safety: Safety) -> Statement:
    """Whether severe failures are the less likely ones."""
    found = safety.scatter.rank_correlation
    ends = found and found.interval
    holds = None
    if found and ends and not ends.low <= 0.0 <= ends.high:
        holds = found.value < 0.0
    told = UNKNOWN if found is None else f"{found.value:.2f}"
    return Statement(
        "Severe collisions are rarer than minor ones.",
        holds,
        f"{name}: rank correlation of likelihood and severity {told} over {safety.scatter.of}",
    )
