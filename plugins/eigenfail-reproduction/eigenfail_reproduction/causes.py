"""The paper's statements on the causes of failures, judged by analyses, replays and causes."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import comb

from eigenfail.presentation.figures import format_interval, format_number, format_share
from eigenfail.values.analysis import AnalysisResult
from eigenfail.values.proof import Proof
from eigenfail.values.safety import Safety, Scatter
from eigenfail_reproduction.judgements import FEWEST_FAILURES, Judgement, agree
from eigenfail_reproduction.paper import MODES, PaperStatement
from eigenfail_reproduction.programme import ScenarioProgramme
from eigenfail_reproduction.tables import Analyses, list_readings

AXES = ("longitudinal", "lateral")
ALIGNMENTS = ("collision", "start")
WORDS = {"longitudinal": "longitudinal", "lateral": "lateral", "joint": "both axes"}
"""What the axes of an analysis are called in figures."""

JUST_BEFORE_S = 1.0
"""What counts as just before the collision; the paper gives no number."""

MORE_INFLUENCE = 2.0
"""Influence just before the collision that counts as large, as a multiple of the mean over time;
the paper gives no number."""

RECOVERED = 0.65
"""Adjusted Rand index from which modes count as the causes: below it a partition is recovered
poorly (Steinley 2004, Psychological Methods 9, 386-396)."""

MORE_COMPONENTS = "Longitudinal noise needs more components than lateral noise."
LARGEST_LAST = "The largest entries of the components lie just before the collision."
DISTINCT_MODES = f"There are {MODES} distinct failure modes."
REPRODUCED = "Eigenfailures reproduce failures in all scenarios tested."
SEVERE_RARER = "Severe collisions are rarer than minor ones."

Causes = Mapping[str, Mapping[int, str]]
"""Cause of each failure of an evaluation, by the name of its member and the episode; without an
evaluation where the scenario names no causes."""


def judge_causes(
    analyses: Analyses,
    proofs: Mapping[str, Proof],
    safeties: Mapping[str, Safety],
    programme: ScenarioProgramme,
    causes: Causes,
) -> Iterator[PaperStatement]:
    """Judge the statements that analyses, proofs and safety measures decide, by evaluation.

    If the scenario names the causes of its failures, influence and modes are judged by one
    analysis each, of both axes and aligned at the collision, and the modes against the causes.
    """
    readings = {
        name: {reading: analyses[name, *reading] for reading in list_readings(programme)}
        for name in proofs
    }
    for name, found in readings.items():
        yield _judge_components(name, found)
    for name, found in readings.items():
        if name in causes:
            yield _judge_influence(name, found["joint", "collision"])
        else:
            yield _judge_largest_entries(name, found, programme.step_s)
    for name, found in readings.items():
        if name in causes:
            yield _judge_modes_by_cause(name, found["joint", "collision"], causes[name])
        else:
            yield _judge_modes(name, found)
    for name, proof in proofs.items():
        yield _judge_replays(name, proof, programme)
    for name, safety in safeties.items():
        yield _judge_severity(name, safety)


def leave_causes_open(name: str) -> Iterator[PaperStatement]:
    """Leave the statements open for an evaluation without a failure to analyse."""
    for paper in (MORE_COMPONENTS, LARGEST_LAST, DISTINCT_MODES, REPRODUCED):
        yield PaperStatement(
            paper,
            None,
            f"{name}: no failure",
            "There is no failure to analyse.",
            "Not judged",
            subject=find_subject(name),
            asked=False,
        )


def find_subject(name: str) -> str:
    """Return the learner that an evaluation is of."""
    return name.removesuffix(" evaluation")


Readings = Mapping[tuple[str, str], AnalysisResult]
"""Of one evaluation, by axes and alignment."""

OF_ONE_POLICY = "All failures come from one policy; another may give another verdict."
FEW = "There are fewer than ten failures."
CHOICES_DIFFER = "The choices that the paper leaves open give different answers."


def _has_enough(results: Iterable[AnalysisResult]) -> bool:
    return all(len(each.episodes) >= FEWEST_FAILURES for each in results)


def _explain_choices(holds: Judgement) -> str:
    return CHOICES_DIFFER if holds is None else f"{OF_ONE_POLICY} The cause was not tested."


def _judge_components(name: str, readings: Readings) -> PaperStatement:
    explained = {
        align: [float(readings[axis, align].explained.sum()) for axis in AXES]
        for align in ALIGNMENTS
        if (AXES[0], align) in readings
    }
    enough = _has_enough(readings.values())
    holds = agree([along < across for along, across in explained.values()]) if enough else None
    figures = "; ".join(
        f"aligned at the {align}: {format_share(along)} of the longitudinal variance, "
        f"{format_share(across)} of the lateral"
        for align, (along, across) in explained.items()
    )
    return PaperStatement(
        MORE_COMPONENTS,
        holds,
        f"{name}, {figures}",
        _explain_choices(holds) if enough else FEW,
        "The first three components explain less of the longitudinal than of the lateral variance, "
        f"{_describe_alignments(list(explained))}",
        subject=find_subject(name),
        asked=enough,
    )


def _describe_alignments(alignments: Sequence[str]) -> str:
    where = f"aligned {' and '.join(f'at the {align}' for align in alignments)}"
    both = len(alignments) > 1
    return f"{where} (does not hold: more with both)" if both else f"{where} (does not hold: more)"


def _judge_largest_entries(name: str, readings: Readings, step_s: float) -> PaperStatement:
    before_s = {
        axis: _time_largest_entries(readings[axis, "collision"], axis, step_s) for axis in AXES
    }
    late = [time <= JUST_BEFORE_S for times in before_s.values() for time in times]
    figures = "; ".join(
        f"{axis} {', '.join(f'{time:g}' for time in times)} s" for axis, times in before_s.items()
    )
    holds = agree(late)
    return PaperStatement(
        LARGEST_LAST,
        holds,
        f"{name}: {sum(late)} of {len(late)} components ({figures} before the collision)"
        if late
        else f"{name}: there is no component",
        _explain_choices(holds),
        "The largest entry (by its absolute value) of each of the first three components of either "
        f"axis, aligned at the collision, lies in the last {JUST_BEFORE_S:g} s, our choice (does "
        "not hold: none does). Aligned at the start, entries have no one time before the collision",
        subject=find_subject(name),
        asked=bool(late),
    )


def _judge_influence(name: str, result: AnalysisResult) -> PaperStatement:
    last = next((one for one in result.before_collision if one.seconds == JUST_BEFORE_S), None)
    share = None if last is None else last.both
    holds, figures = None, f"{name}: {len(result.episodes)} failures"
    if last is not None and share is not None and _has_enough([result]):
        holds = share >= MORE_INFLUENCE * last.time
        figures = (
            f"{name}: the last {JUST_BEFORE_S:g} s have {format_share(share)} of the influence and "
            f"{format_share(last.time)} of the time"
        )
    return PaperStatement(
        LARGEST_LAST,
        holds,
        figures,
        FEW if holds is None else f"{OF_ONE_POLICY} The cause was not tested.",
        f"Aligned at the collision, the share of the influence (entries of the first three "
        f"components, weighted by the variance that they explain) in the last {JUST_BEFORE_S:g} s "
        f"is {MORE_INFLUENCE:g} times their share of the time or more, our choice (otherwise does "
        "not hold)",
        subject=find_subject(name),
        asked=holds is not None,
    )


def _time_largest_entries(result: AnalysisResult, axis: str, step_s: float) -> list[float]:
    """Return how long before the collision each component is largest. [s]"""
    entries = abs(result.components[:, :, result.channels.index(axis)])
    steps = entries.shape[1]
    return [round((steps - int(course.argmax())) * step_s, 9) for course in entries if course.any()]


def _judge_modes(name: str, readings: Readings) -> PaperStatement:
    holds = agree([result.distinct and len(result.modes) == MODES for result in readings.values()])
    counts = "; ".join(
        f"aligned at the {align}: "
        + ", ".join(f"{WORDS[axes]} {_count_modes(readings[axes, align])}" for axes in WORDS)
        for align in ALIGNMENTS
    )
    return PaperStatement(
        DISTINCT_MODES,
        holds,
        f"{name}, {counts}",
        _explain_choices(holds),
        f"{MODES} distinct modes in each of six analyses: of the noise of each axis and of both, "
        "aligned at the collision and at the start (does not hold: in none)",
        subject=find_subject(name),
    )


def _judge_modes_by_cause(
    name: str, result: AnalysisResult, causes: Mapping[int, str]
) -> PaperStatement:
    truth = [causes.get(episode, "not named") for episode in result.episodes]
    enough = _has_enough([result])
    index = compute_rand_index(truth, result.labels)
    counts = ", ".join(f"{n} of '{cause}'" for cause, n in Counter(truth).most_common())
    holds = result.distinct and len(result.modes) == MODES and index >= RECOVERED
    return PaperStatement(
        DISTINCT_MODES,
        holds if enough else None,
        f"{name}: {_count_modes(result)}; adjusted Rand index with the causes "
        f"{format_number(index)}; failures: {counts}",
        OF_ONE_POLICY if enough else FEW,
        f"{MODES} distinct modes of the noise of both axes, aligned at the collision, and an "
        f"adjusted Rand index of the modes with the causes of {RECOVERED:g} or more (otherwise "
        "does not hold)",
        subject=find_subject(name),
        asked=enough,
    )


def compute_rand_index(first: Sequence[object], second: Sequence[object]) -> float:
    """Return the adjusted Rand index of two partitions (Hubert and Arabie 1985).

    1 if they are the same, 0 as by chance; 1 if both have one group, or each element is one
    of its own in both.

    Args:
        first: group of each element.
        second: group of each element in the other partition, in the same order.
    """
    together = sum(comb(n, 2) for n in Counter(zip(first, second, strict=True)).values())
    in_first, in_second = (
        sum(comb(n, 2) for n in Counter(groups).values()) for groups in (first, second)
    )
    by_chance = in_first * in_second / max(comb(len(first), 2), 1)
    most = 0.5 * (in_first + in_second)
    return 1.0 if most == by_chance else (together - by_chance) / (most - by_chance)


def _count_modes(result: AnalysisResult) -> str:
    return str(len(result.modes)) if result.distinct else "none distinct"


def _judge_replays(name: str, proof: Proof, programme: ScenarioProgramme) -> PaperStatement:
    rate = proof.eigenfailures.rate
    figures = "none was replayed"
    if rate:
        each = rate.n // len(proof.scenarios)
        figures = (
            f"{rate.k} of {rate.n} replays collided, of {each} eigenfailures in "
            f"{_describe_scenarios(proof, programme)}"
        )
    return PaperStatement(
        REPRODUCED,
        None if rate is None else rate.k == rate.n,
        f"{name}: {figures}",
        "Not every replay collided." if rate else "There was no eigenfailure to replay.",
        "Every replay of an eigenfailure collides (otherwise does not hold)",
        subject=find_subject(name),
        asked=rate is not None,
    )


def _describe_scenarios(proof: Proof, programme: ScenarioProgramme) -> str:
    moved = dict.fromkeys(name for one in proof.scenarios for name in one.scenario_parameters)
    parts = (f"{name} of {_list_values(name, proof, programme)}" for name in moved)
    return f"`{programme.scenario}` with each {' and '.join(parts)}"


def _list_values(name: str, proof: Proof, programme: ScenarioProgramme) -> str:
    usual = programme.parameters
    given = ({**usual, **one.scenario_parameters} for one in proof.scenarios)
    return ", ".join(f"{values[name]:g}" for values in given if name in values)


def _judge_severity(name: str, safety: Safety) -> PaperStatement:
    correlation = safety.scatter.rank_correlation
    interval = correlation and correlation.interval
    holds = None
    if correlation and interval and not interval.low <= 0.0 <= interval.high:
        holds = correlation.value < 0.0
    return PaperStatement(
        SEVERE_RARER,
        holds,
        f"{name}: {_describe_correlation(safety.scatter)}",
        _explain_severity(safety.scatter, holds),
        "The interval of Spearman's rank correlation of log p per step and severity, over the "
        "failures of one evaluation, lies below 0 (does not hold: above)",
        subject=find_subject(name),
        asked=correlation is not None,
    )


def _describe_correlation(scatter: Scatter) -> str:
    correlation, over = scatter.rank_correlation, f"over {len(scatter.points)} failures"
    if correlation is None:
        return f"no rank correlation {over}"
    bounds = f" {format_interval(correlation.interval)}" if correlation.interval else ""
    return f"rank correlation {format_number(correlation.value)}{bounds} {over}"


def _explain_severity(scatter: Scatter, holds: Judgement) -> str:
    if holds is not None:
        return (
            "A possible cause, not tested: a policy that needs less noise to blind the tracker "
            "does so earlier, so that the planner brakes less."
        )
    if scatter.rank_correlation is not None:
        return "The interval includes 0."
    if len(scatter.points) < FEWEST_FAILURES:
        return FEW
    return "All failures have the same likelihood or the same severity."
