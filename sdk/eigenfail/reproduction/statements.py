"""The paper's statements, judged by our numbers; each rests on one seed, so none is final."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from enum import StrEnum
from functools import partial
from math import hypot
from statistics import fmean, stdev

import msgspec

from eigenfail.client import Client
from eigenfail.errors import Conflict
from eigenfail.intervals import Z, find_interval
from eigenfail.presentation.figures import (
    format_count,
    format_interval,
    format_number,
    format_share,
)
from eigenfail.reproduction.programme import MOVED_M, STEP_S, SWEPT, USUAL_DISTANCE_M
from eigenfail.reproduction.tables import (
    MODES,
    READINGS,
    Analyses,
    PaperReproduction,
    PaperStatement,
    PaperTable,
    build_campaign_tables,
    build_component_table,
    build_replay_table,
    build_safety_table,
)
from eigenfail.suites import Suite
from eigenfail.values import (
    AnalysisResult,
    AnalysisSettings,
    AnalysisState,
    Campaign,
    CampaignState,
    Comparison,
    Proof,
    Rate,
    Safety,
    Summary,
)
from eigenfail.values.safety import Scatter

Summaries = Mapping[str, Summary]


Safeties = Mapping[str, Safety]


Compare = Callable[[str, str], Comparison]
"""From the names of two members A and B to the comparison of B with A."""


Judgement = bool | None
"""Whether a statement or a part of it holds; None where an interval includes no difference."""


NEEDED = (
    *("sweep base", "sweep alpha=500", "sweep c_dist=100", "sweep c_dist=5000"),
    *("sweep batch_size=16", "sweep batch_size=256"),
    *("ast evaluation", "ast_paper evaluation", "difs evaluation", "difs_paper evaluation"),
)
"""Members whose failures are compared one by one."""


class Means(StrEnum):
    """Means over the failures of a campaign that a statement is about."""

    LOG_P = "log p per step"
    SEVERITY = "mean severity"


FEWEST_FAILURES = 10
"""Means over fewer failures are not compared, as the interval below needs large samples; fewer have
no rank correlation, either."""

SUFFIXES = ("", "_paper")
"""Of learners with our defaults, and with the paper's settings."""

AXES = ("longitudinal", "lateral")
ALIGNMENTS = ("collision", "start")
WORDS = {"longitudinal": "longitudinal", "lateral": "lateral", "joint": "both axes"}
"""What the axes of an analysis are called in figures."""

JUST_BEFORE_S = 1.0
"""What counts as just before the collision; the paper gives no number."""


def judge_campaigns(
    summaries: Summaries, safeties: Safeties, compare: Compare
) -> Iterator[PaperStatement]:
    """Judge the statements that summaries, failures and comparisons decide."""
    yield _judge_planners(summaries)
    for suffix in SUFFIXES:
        yield _judge_monte_carlo(suffix, summaries)
    yield _judge_batch_size(summaries, safeties, compare)
    yield _judge_alpha(summaries, safeties, compare)
    yield _judge_c_dist(summaries, safeties, compare)
    yield _leave_target_and_buffer_open()
    for suffix in SUFFIXES:
        yield _judge_difs(suffix, summaries, safeties)
    for suffix in SUFFIXES:
        yield _judge_distances(suffix, summaries)


def judge_causes(
    analyses: Analyses, proofs: Mapping[str, Proof], safeties: Safeties
) -> Iterator[PaperStatement]:
    """Judge the statements that analyses, proofs and safety measures decide, by evaluation."""
    for judge in (_judge_components, _judge_largest_entries, _judge_modes):
        for name in proofs:
            yield judge(name, {reading: analyses[name, *reading] for reading in READINGS})
    for name, proof in proofs.items():
        yield _judge_replays(name, proof)
    for name, safety in safeties.items():
        yield _judge_severity(name, safety)


def _judge_planners(summaries: Summaries) -> PaperStatement:
    ours, idm = (summaries[f"monte_carlo {name}"] for name in ("rulebook", "idm"))
    holds = is_rarer(ours.failure_rate, idm.failure_rate)
    return PaperStatement(
        "Under Monte Carlo the planner fails less often than IDM.",
        holds,
        f"rulebook: {_count(ours)}; idm: {_count(idm)}",
        "The intervals overlap." if holds is None else REVERSED,
        "The interval of `rulebook`'s failure rate lies below that of `idm` (does not hold: above)",
    )


def _judge_monte_carlo(suffix: str, summaries: Summaries) -> PaperStatement:
    monte_carlo = summaries["monte_carlo rulebook"]
    names = (f"ast{suffix} evaluation", f"difs{suffix} evaluation")
    found = all(summaries[name].counts.failures for name in names)
    figures = _list_figures(summaries, names)
    why = (
        "A possible cause, not tested: `difs_paper` trains twice, on 500 draws from p(x) and on "
        "500 conditioned ones, with few failures or none among them; `difs` trains after each of "
        "many small rounds."
        if suffix
        else "Monte Carlo found a failure, or one of the evaluations found none."
    )
    return PaperStatement(
        "Monte Carlo finds no failure where AST and DiFS both do.",
        not monte_carlo.counts.failures and found,
        f"Monte Carlo: {_count(monte_carlo)}; {figures}",
        why,
        "No failure of Monte Carlo, and at least one in the evaluation of each (otherwise does "
        "not hold)",
    )


def _judge_batch_size(summaries: Summaries, safeties: Safeties, compare: Compare) -> PaperStatement:
    small, others = "sweep batch_size=16", ("sweep base", "sweep batch_size=256")
    comparisons = [
        _combine(
            fails_more_often(compare(other, small)),
            _is_likelier_in_both(summaries, safeties, other, small),
            is_more_severe(safeties[other], safeties[small]),
        )
        for other in others
    ]
    return PaperStatement(
        "A small batch improves failure rate, log p and severity.",
        _agree(comparisons),
        f"{_list_figures(summaries, (small, *others), Means.LOG_P, Means.SEVERITY)} (the base has "
        f"a batch of {SWEPT['batch_size']:,})",
        "A possible cause, not tested: 300 episodes have at most 3,000 decisions here, and "
        "gradients over 16 of them are noisy.",
        "16 against the base and against 256: more failures, likelier, more severe",
    )


def _judge_alpha(summaries: Summaries, safeties: Safeties, compare: Compare) -> PaperStatement:
    base, small = names = ("sweep base", "sweep alpha=500")
    return PaperStatement(
        "A small alpha makes failures likelier and fewer.",
        _combine(
            fails_more_often(compare(small, base)),
            _is_likelier_in_both(summaries, safeties, base, small),
        ),
        f"{_list_figures(summaries, names, Means.LOG_P)} (the base has an alpha of "
        f"{SWEPT['alpha']:,})",
        "A possible cause, not tested: the paper's log p is thousands below zero, beside which an "
        "alpha of 500 is small; here it is a few hundred below zero, so that this alpha may still "
        "dominate.",
        "The smallest against the base, which is the largest: likelier, fewer",
    )


def _judge_c_dist(summaries: Summaries, safeties: Safeties, compare: Compare) -> PaperStatement:
    large, others = "sweep c_dist=5000", ("sweep base", "sweep c_dist=100")
    comparisons = [
        _combine(
            fails_more_often(compare(other, large)),
            is_more_severe(safeties[other], safeties[large]),
        )
        for other in others
    ]
    return PaperStatement(
        "A large c_dist makes failures more frequent and more severe.",
        _agree(comparisons),
        f"{_list_figures(summaries, (large, *others), Means.SEVERITY)} (the base has a c_dist of "
        f"{SWEPT['c_dist']:,})",
        "A possible cause, not tested: c_dist scales the returns, and critics with the same "
        "learning rate learn larger returns more slowly.",
        "5,000 against the base and against 100: more failures, more severe",
    )


def _leave_target_and_buffer_open() -> PaperStatement:
    return PaperStatement(
        "A small tau and a large buffer make failures likelier.",
        None,
        "not run",
        "Neither setting has an effect here: an episode has at most 10 decisions (100 steps, "
        "`hold` 10), and the rewards of 10 decisions are summed (`n_step`), so that the target "
        "critics are never used; 300 episodes have at most 3,000 decisions, so that a buffer of "
        "10,000 never drops one.",
        "Not judged",
    )


def _judge_difs(suffix: str, summaries: Summaries, safeties: Safeties) -> PaperStatement:
    a, b = names = (f"ast{suffix} evaluation", f"difs{suffix} evaluation")
    holds = _is_likelier_in_both(summaries, safeties, a, b)
    return PaperStatement(
        "DiFS finds likelier failures than AST.",
        holds,
        _list_figures(summaries, names, Means.LOG_P),
        _explain_likelihood(holds, safeties, names),
        "Evaluations: the failures of DiFS are likelier (does not hold: less likely)",
    )


def _explain_likelihood(holds: Judgement, safeties: Safeties, names: Sequence[str]) -> str:
    for name in names:
        if len(safeties[name].scatter.points) < FEWEST_FAILURES:
            return f"{name}: too few failures (fewer than {FEWEST_FAILURES}) for a mean."
    return "The difference is uncertain." if holds is None else REVERSED


def _judge_distances(suffix: str, summaries: Summaries) -> PaperStatement:
    names = tuple(f"ast{suffix} {place}" for place in ("evaluation", *MOVED_M))
    return PaperStatement(
        "AST's policy fails the planner at other distances of the cut-in, too.",
        _combine(*(is_above_half(summaries[name].failure_rate) for name in names)),
        _list_figures(summaries, names),
        "The policy was trained at one distance only.",
        "At each of the three distances the interval of the failure rate lies above one half "
        "(does not hold: at one it lies below)",
    )


Readings = Mapping[tuple[str, str], AnalysisResult]
"""Of one evaluation, by axes and alignment."""

REVERSED = "In this run the order is reversed."
OF_ONE_POLICY = "All failures come from one policy; another may give another verdict."
CHOICES_DIFFER = "The choices that the paper leaves open give different answers."


def _explain_choices(holds: Judgement) -> str:
    return CHOICES_DIFFER if holds is None else f"{OF_ONE_POLICY} The cause was not tested."


def _judge_components(name: str, readings: Readings) -> PaperStatement:
    explained = {
        align: [float(readings[axis, align].explained.sum()) for axis in AXES]
        for align in ALIGNMENTS
    }
    holds = _agree([along < across for along, across in explained.values()])
    figures = "; ".join(
        f"aligned at the {align}: {format_share(along)} of the longitudinal variance, "
        f"{format_share(across)} of the lateral"
        for align, (along, across) in explained.items()
    )
    return PaperStatement(
        "Longitudinal noise needs more components than lateral noise.",
        holds,
        f"{name}, {figures}",
        _explain_choices(holds),
        "The first three components explain less of the longitudinal than of the lateral variance, "
        "aligned at the collision and at the start (does not hold: more with both)",
    )


def _judge_largest_entries(name: str, readings: Readings) -> PaperStatement:
    before_s = {axis: _time_largest_entries(readings[axis, "collision"], axis) for axis in AXES}
    late = [time <= JUST_BEFORE_S for times in before_s.values() for time in times]
    figures = "; ".join(
        f"{axis} {', '.join(f'{time:g}' for time in times)} s" for axis, times in before_s.items()
    )
    holds = _agree(late)
    return PaperStatement(
        "The largest entries of the components lie just before the collision.",
        holds,
        f"{name}: {sum(late)} of {len(late)} components ({figures} before the collision)"
        if late
        else f"{name}: there is no component",
        _explain_choices(holds),
        "The largest entry (by its absolute value) of each of the first three components of either "
        f"axis, aligned at the collision, lies in the last {JUST_BEFORE_S:g} s, our choice (does "
        "not hold: none does). Aligned at the start, entries have no one time before the collision",
    )


def _time_largest_entries(result: AnalysisResult, axis: str) -> list[float]:
    """Return how long before the collision each component is largest. [s]"""
    entries = abs(result.components[:, :, result.channels.index(axis)])
    steps = entries.shape[1]
    return [round((steps - int(course.argmax())) * STEP_S, 9) for course in entries if course.any()]


def _judge_modes(name: str, readings: Readings) -> PaperStatement:
    holds = _agree([result.distinct and len(result.modes) == MODES for result in readings.values()])
    counts = "; ".join(
        f"aligned at the {align}: "
        + ", ".join(f"{WORDS[axes]} {_count_modes(readings[axes, align])}" for axes in WORDS)
        for align in ALIGNMENTS
    )
    return PaperStatement(
        f"There are {MODES} distinct failure modes.",
        holds,
        f"{name}, {counts}",
        _explain_choices(holds),
        f"{MODES} distinct modes in each of six analyses: of the noise of each axis and of both, "
        "aligned at the collision and at the start (does not hold: in none)",
    )


def _count_modes(result: AnalysisResult) -> str:
    return str(len(result.modes)) if result.distinct else "none distinct"


def _judge_replays(name: str, proof: Proof) -> PaperStatement:
    rate = proof.eigenfailures.rate
    figures = "none was replayed"
    if rate:
        distances = ", ".join(
            f"{one.scenario_parameters.get('distance_m', USUAL_DISTANCE_M):g}"
            for one in proof.scenarios
        )
        each = rate.n // len(proof.scenarios)
        figures = (
            f"{rate.k} of {rate.n} replays collided, of {each} eigenfailures in `cut_in` with each "
            f"distance_m of {distances}"
        )
    return PaperStatement(
        "Eigenfailures reproduce failures in all scenarios tested.",
        None if rate is None else rate.k == rate.n,
        f"{name}: {figures}",
        "Not every replay collided." if rate else "There was no eigenfailure to replay.",
        "Every replay of an eigenfailure in the table above collides (otherwise does not hold)",
    )


def _judge_severity(name: str, safety: Safety) -> PaperStatement:
    correlation = safety.scatter.rank_correlation
    interval = correlation and correlation.interval
    holds = None
    if correlation and interval and not interval.low <= 0.0 <= interval.high:
        holds = correlation.value < 0.0
    return PaperStatement(
        "Severe collisions are rarer than minor ones.",
        holds,
        f"{name}: {_describe_correlation(safety.scatter)}",
        _explain_severity(safety.scatter, holds),
        "The interval of Spearman's rank correlation of log p per step and severity, over the "
        "failures of one evaluation, lies below 0 (does not hold: above)",
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
        return "There are fewer than ten failures."
    return "All failures have the same likelihood or the same severity."


def _is_likelier_in_both(summaries: Summaries, safeties: Safeties, a: str, b: str) -> Judgement:
    """Whether B's failures are likelier per step; None also if their sums have another order.

    The paper sums over the steps; an episode ends at its collision, so that sums are over different
    numbers of steps.
    """
    one, other = (summaries[name].mean_log_probability for name in (a, b))
    per_step = is_likelier(safeties[a], safeties[b])
    if per_step is None or one is None or other is None:
        return None
    return per_step if (other > one) is per_step else None


def is_likelier(a: Safety, b: Safety) -> Judgement:
    """Whether the failures of B have a higher mean log p per step; None if that is uncertain."""
    one, other = ([p.log_probability_per_step for p in s.scatter.points] for s in (a, b))
    return is_greater(one, other)


def is_more_severe(a: Safety, b: Safety) -> Judgement:
    """Whether the failures of B have a higher mean severity; None if that is uncertain."""
    one, other = ([point.severity for point in s.scatter.points] for s in (a, b))
    return is_greater(one, other)


def is_greater(a: Sequence[float], b: Sequence[float]) -> Judgement:
    """Whether the mean of B is greater; None where the 95 % interval includes 0.

    The interval is Welch's (1947) for large samples: two normal means, each with its own variance.
    """
    if min(len(a), len(b)) < FEWEST_FAILURES:
        return None
    difference = fmean(b) - fmean(a)
    error = hypot(*(stdev(values) / len(values) ** 0.5 for values in (a, b)))
    return None if abs(difference) <= Z * error else difference > 0.0


def is_rarer(a: Rate | None, b: Rate | None) -> Judgement:
    """Whether A's rate is the lower one; None where the intervals overlap."""
    if a is None or b is None:
        return None
    one, other = (find_interval(rate.k, rate.n) for rate in (a, b))
    below, above = one.high < other.low, one.low > other.high
    return below if below or above else None


def is_above_half(rate: Rate | None) -> Judgement:
    """Whether more than half of the draws fail; None where the interval includes one half."""
    if rate is None:
        return None
    interval = find_interval(rate.k, rate.n)
    return None if interval.low <= 0.5 <= interval.high else rate.share > 0.5


def fails_more_often(comparison: Comparison) -> Judgement:
    """Whether B fails more often than A, by Newcombe's interval."""
    difference = comparison.difference
    if difference is None or difference.interval.low <= 0.0 <= difference.interval.high:
        return None
    return difference.value > 0.0


def _combine(*parts: Judgement) -> Judgement:
    """Judge a statement of several parts: false if one is, open if one is open and none false."""
    open_or_true = None if None in parts else True
    return False if False in parts else open_or_true


def _agree(choices: Sequence[Judgement]) -> Judgement:
    """Return what all choices that the paper leaves open give; None where they differ."""
    first, *others = choices or (None,)
    return first if all(other is first for other in others) else None


def _list_figures(summaries: Summaries, names: Sequence[str], *means: Means) -> str:
    return "; ".join(f"{name}: {_describe(summaries[name], means)}" for name in names)


def _count(summary: Summary) -> str:
    counts = summary.counts
    return f"{format_count(counts.failures)} of {format_count(counts.completed)} failed"


def _describe(summary: Summary, means: Collection[Means]) -> str:
    words = [_count(summary)]
    if Means.LOG_P in means and summary.log_probability_per_step is not None:
        total = format_number(summary.mean_log_probability)
        words.append(
            f"{Means.LOG_P} {format_number(summary.log_probability_per_step)} (mean log p {total})"
        )
    if Means.SEVERITY in means and summary.mean_severity is not None:
        words.append(f"{Means.SEVERITY} {format_number(summary.mean_severity)} m²/s²")
    return ", ".join(words)


ANALYSED = ("ast evaluation", "ast_paper evaluation")


MEASURED = ("ast evaluation", "difs evaluation", "difs_paper evaluation")
"""Evaluations in the table of safety measures."""

CORRELATED = ("ast evaluation", "ast_paper evaluation", "difs evaluation", "difs_paper evaluation")


class Evidence(msgspec.Struct, frozen=True):
    """Results by the name of the member; analyses by name and axis."""

    summaries: Mapping[str, Summary]
    safeties: Mapping[str, Safety]
    analyses: Analyses
    proofs: Mapping[str, Proof]


def build_reproduction(client: Client, suite: Suite, scale: str) -> PaperReproduction:
    """Build the paper's tables and statements from campaigns that are done.

    Launches missing analyses and replays, and waits for them.

    Raises:
        Conflict: a campaign is not done, or its failures cannot be analysed.
    """
    _require_done(suite, client.suites.find(suite))
    evidence = _gather_evidence(client, suite)
    return PaperReproduction(
        scale=scale,
        seed=suite.members[0].spec.seed,
        tables=tuple(_build_tables(evidence)),
        statements=tuple(_judge_statements(client, evidence)),
    )


def _require_done(suite: Suite, campaigns: Sequence[Campaign | None]) -> None:
    """Refuse a programme that is not done.

    Raises:
        Conflict: a campaign is missing, or ended otherwise.
    """
    for member, campaign in zip(suite.members, campaigns, strict=True):
        if campaign is None or campaign.state is not CampaignState.DONE:
            state = campaign.state if campaign else "not there"
            raise Conflict(
                f"The campaign '{member.spec.name}' is {state}, so that its tables would be wrong.",
                "Resume it, or run the programme again with another seed.",
            )


def _gather_evidence(client: Client, suite: Suite) -> Evidence:
    found = zip(suite.members, client.suites.summaries(suite), strict=True)
    summaries = {member.name: summary for member, summary in found if summary is not None}
    ids = {name: one.campaign for name, one in summaries.items() if one.counts.failures}
    diagnosed = {name: ids[name] for name in ANALYSED if name in ids}
    return Evidence(
        summaries,
        {name: client.campaigns.safety(summaries[name].campaign) for name in NEEDED},
        {
            (name, *reading): _analyze(client, campaign, settings)[1]
            for name, campaign in diagnosed.items()
            for reading, settings in READINGS.items()
        },
        {name: _prove(client, campaign) for name, campaign in diagnosed.items()},
    )


def _prove(client: Client, campaign: int) -> Proof:
    """Return the replays of a campaign's eigenfailures in its scenario and in similar ones."""
    analysis, _ = _analyze(client, campaign, READINGS["joint", "start"])
    # Asked for again after their end, they are followed by a search that no statement needs.
    if not client.analyses.proof(analysis).done:
        client.analyses.prove(analysis)
    return client.analyses.wait_for_proof(analysis)


def _analyze(
    client: Client, campaign: int, settings: AnalysisSettings
) -> tuple[int, AnalysisResult]:
    """Return id and result of the analysis with these settings; run it if there is none.

    Raises:
        Conflict: the failures cannot be analysed.
    """
    known = (one for one in client.analyses.list(campaign) if one.settings == settings)
    done = next((one for one in known if one.state is AnalysisState.DONE), None)
    found = client.analyses.wait((done or client.analyses.create(campaign, settings)).id)
    if found.result is None:
        raise Conflict(f"The failures of campaign {campaign} were not analysed: {found.problem}")
    return found.id, found.result


def _build_tables(evidence: Evidence) -> Iterator[PaperTable]:
    yield from build_campaign_tables(evidence.summaries)
    yield build_safety_table({name: evidence.safeties[name] for name in MEASURED})
    yield build_component_table(evidence.analyses)
    yield build_replay_table(evidence.proofs)


def _judge_statements(client: Client, evidence: Evidence) -> Iterator[PaperStatement]:
    compare = partial(_compare, client, evidence)
    yield from judge_campaigns(evidence.summaries, evidence.safeties, compare)
    correlated = {name: evidence.safeties[name] for name in CORRELATED}
    yield from judge_causes(evidence.analyses, evidence.proofs, correlated)


def _compare(client: Client, evidence: Evidence, a: str, b: str) -> Comparison:
    one, other = (evidence.summaries[name].campaign for name in (a, b))
    return client.campaigns.compare(one, other)
