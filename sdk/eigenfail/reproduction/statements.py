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
from eigenfail.presentation.figures import format_interval, format_number, format_share
from eigenfail.reproduction.programme import SWEPT, USUAL_DISTANCE_M
from eigenfail.reproduction.tables import (
    AXES,
    MODES,
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


def judge_campaigns(
    summaries: Summaries, safeties: Safeties, compare: Compare
) -> Iterator[PaperStatement]:
    """Judge the statements that summaries, failures and comparisons decide."""
    yield _judge_planners(summaries)
    yield _judge_monte_carlo(summaries)
    yield _judge_batch_size(summaries, safeties, compare)
    yield _judge_alpha(summaries, safeties, compare)
    yield _judge_c_dist(summaries, safeties, compare)
    yield _leave_target_and_buffer_open()
    for suffix in ("", "_paper"):
        yield _judge_difs(suffix, summaries, safeties)
    yield _judge_distances(summaries)


def judge_causes(
    analyses: Analyses, proofs: Mapping[str, Proof], safeties: Safeties
) -> Iterator[PaperStatement]:
    """Judge the statements that analyses, proofs and safety measures decide, by evaluation."""
    for name, proof in proofs.items():
        longitudinal, lateral = (analyses[name, axis] for axis in AXES)
        yield _judge_components(name, longitudinal, lateral)
        yield _judge_late_influence(name, longitudinal, lateral)
        yield _judge_modes(name, longitudinal)
        yield _judge_replays(name, proof)
    for name, safety in safeties.items():
        yield _judge_severity(name, safety)


def _judge_planners(summaries: Summaries) -> PaperStatement:
    ours, idm = (summaries[f"monte_carlo {name}"] for name in ("rulebook", "idm"))
    holds = None
    if ours.failure_rate and idm.failure_rate:
        one, other = (find_interval(r.k, r.n) for r in (ours.failure_rate, idm.failure_rate))
        holds = one.high < other.low
    return PaperStatement(
        "Under Monte Carlo the planner fails less often than IDM.",
        holds,
        f"rulebook: {_count(ours)}; idm: {_count(idm)}",
        "The intervals of both rates overlap in this run, or their order is reversed.",
    )


def _judge_monte_carlo(summaries: Summaries) -> PaperStatement:
    monte_carlo = summaries["monte_carlo rulebook"]
    searches = {
        name: summaries[f"{name} evaluation"] for name in ("ast_paper", "difs_paper", "difs")
    }
    holds = not monte_carlo.counts.failures and all(s.counts.failures for s in searches.values())
    figures = "; ".join(
        f"{name} evaluation: {_count(summary)}" for name, summary in searches.items()
    )
    return PaperStatement(
        "Monte Carlo finds no failure where AST and DiFS both do.",
        holds,
        f"Monte Carlo: {_count(monte_carlo)}; {figures}",
        "Judged by the evaluations. A possible cause, not tested: `difs_paper` trains twice, on "
        "500 draws from p(x) and on 500 conditioned ones, with few failures or none among them; "
        "`difs` trains every few episodes.",
    )


def _judge_batch_size(summaries: Summaries, safeties: Safeties, compare: Compare) -> PaperStatement:
    a, b = names = ("sweep batch_size=256", "sweep batch_size=16")
    parts = (
        fails_more_often(compare(a, b)),
        is_likelier(safeties[a], safeties[b]),
        is_more_severe(safeties[a], safeties[b]),
    )
    return _combine(
        "A small batch improves failure rate, log p and severity.",
        _list_figures(summaries, names, Means.LOG_P, Means.SEVERITY),
        parts,
        "A possible cause, not tested: 300 episodes have at most 3,000 decisions here, and "
        "gradients over 16 of them are noisy.",
    )


def _judge_alpha(summaries: Summaries, safeties: Safeties, compare: Compare) -> PaperStatement:
    a, b = names = ("sweep base", "sweep alpha=500")
    parts = (fails_more_often(compare(b, a)), is_likelier(safeties[a], safeties[b]))
    figures = _list_figures(summaries, names, Means.LOG_P)
    return _combine(
        "A small alpha makes failures likelier and fewer.",
        f"{figures} (the base has an alpha of {SWEPT['alpha']:,})",
        parts,
        "A possible cause, not tested: the paper's log p is thousands below zero, beside which an "
        "alpha of 500 is small; here it is a few hundred below zero, so that this alpha may still "
        "dominate.",
    )


def _judge_c_dist(summaries: Summaries, safeties: Safeties, compare: Compare) -> PaperStatement:
    a, b = names = ("sweep c_dist=100", "sweep c_dist=5000")
    parts = (fails_more_often(compare(a, b)), is_more_severe(safeties[a], safeties[b]))
    return _combine(
        "A large c_dist makes failures more frequent and more severe.",
        _list_figures(summaries, names, Means.SEVERITY),
        parts,
        "A possible cause, not tested: c_dist scales the returns, and critics with the same "
        "learning rate learn larger returns more slowly.",
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
    )


def _judge_difs(suffix: str, summaries: Summaries, safeties: Safeties) -> PaperStatement:
    a, b = names = (f"ast{suffix} evaluation", f"difs{suffix} evaluation")
    return _combine(
        "DiFS finds likelier failures than AST.",
        _list_figures(summaries, names, Means.LOG_P),
        (is_likelier(safeties[a], safeties[b]),),
        f"`difs{suffix}` found too few failures for a comparison of means.",
    )


def _judge_distances(summaries: Summaries) -> PaperStatement:
    names = tuple(f"ast {place}" for place in ("evaluation", "plus5", "minus5"))
    return _combine(
        "AST's policy fails the planner at other distances of the cut-in, too.",
        _list_figures(summaries, names),
        tuple(is_above_half(summaries[name].failure_rate) for name in names),
        "The policy was trained at one distance only.",
    )


def _judge_components(
    name: str, longitudinal: AnalysisResult, lateral: AnalysisResult
) -> PaperStatement:
    along, across = (float(one.explained.sum()) for one in (longitudinal, lateral))
    return PaperStatement(
        "Longitudinal noise needs more components than lateral noise.",
        along < across,
        f"{name}: the first three explain {format_share(along)} of the variance of the noise along "
        f"the road, {format_share(across)} of that across it",
        "All failures come from one policy: other searchers may find the opposite. The cause was "
        "not tested.",
    )


def _judge_late_influence(
    name: str, longitudinal: AnalysisResult, lateral: AnalysisResult
) -> PaperStatement:
    claim = "The largest entries of the components lie just before the collision."
    along, across = (
        one.before_collision[0] if one.before_collision else None for one in (longitudinal, lateral)
    )
    if not along or not across or along.longitudinal is None or across.lateral is None:
        return PaperStatement(claim, None, f"{name}: there is no influence")
    above = {along.longitudinal > along.time, across.lateral > across.time}
    holds = None if len(above) > 1 else above.pop()
    why = (
        "On one axis the influence there is above its share of the time, on the other below."
        if holds is None
        else "A possible cause, not tested: `rulebook` collides after its tracker has lost the "
        "other car, and the noise that causes this comes earlier."
    )
    return PaperStatement(
        claim,
        holds,
        f"{name}: the last {along.seconds:g} s hold {format_share(along.longitudinal)} of the "
        f"longitudinal and {format_share(across.lateral)} of the lateral influence in "
        f"{format_share(along.time)} of the time",
        why,
    )


def _judge_modes(name: str, result: AnalysisResult) -> PaperStatement:
    return PaperStatement(
        f"There are {MODES} distinct failure modes.",
        result.distinct and len(result.modes) == MODES,
        f"{name}, longitudinal noise: {_count_modes(result)}",
        "All failures come from one policy: another searcher or seed may find another number. The "
        "cause was not tested.",
    )


def _count_modes(result: AnalysisResult) -> str:
    return f"{len(result.modes)} distinct modes" if result.distinct else result.verdict


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
            f"{rate.k} of {rate.n} replays failed, of {each} eigenfailures in `cut_in` with each "
            f"distance_m of {distances}"
        )
    return PaperStatement(
        "Eigenfailures reproduce failures in all scenarios tested.",
        None if rate is None else rate.k == rate.n,
        f"{name}: {figures}",
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
    )


def _describe_correlation(scatter: Scatter) -> str:
    correlation, over = scatter.rank_correlation, f"over {len(scatter.points)} failures"
    if correlation is None:
        return f"no rank correlation {over}"
    bounds = f" {format_interval(correlation.interval)}" if correlation.interval else ""
    return (
        "Spearman's rank correlation of log p per step and severity, "
        f"{format_number(correlation.value)}{bounds} {over} (below 0: the severe ones are the "
        "rarer)"
    )


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


def _combine(
    paper: str, figures: str, parts: tuple[Judgement, ...], why: str = ""
) -> PaperStatement:
    """Judge a statement of several parts: false if one is, open if one is open and none false."""
    open_or_true = None if None in parts else True
    holds = False if False in parts else open_or_true
    return PaperStatement(paper, holds, figures, why)


def _list_figures(summaries: Summaries, names: Sequence[str], *means: Means) -> str:
    return "; ".join(f"{name}: {_describe(summaries[name], means)}" for name in names)


def _count(summary: Summary) -> str:
    counts = summary.counts
    return f"{counts.failures} of {counts.completed} failed"


def _describe(summary: Summary, means: Collection[Means]) -> str:
    words = [_count(summary)]
    if Means.LOG_P in means and summary.log_probability_per_step is not None:
        words.append(f"{Means.LOG_P} {format_number(summary.log_probability_per_step)}")
    if Means.SEVERITY in means and summary.mean_severity is not None:
        words.append(f"{Means.SEVERITY} {format_number(summary.mean_severity)} m²/s²")
    return ", ".join(words)


ANALYSED = ("ast evaluation", "ast_paper evaluation")


MEASURED = ("ast evaluation", "difs evaluation", "difs_paper evaluation")


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
            (name, axis): _analyze(client, campaign, settings)[1]
            for name, campaign in diagnosed.items()
            for axis, settings in AXES.items()
        },
        {name: _prove(client, campaign) for name, campaign in diagnosed.items()},
    )


def _prove(client: Client, campaign: int) -> Proof:
    """Return the replays of a campaign's eigenfailures in its scenario and in similar ones."""
    analysis, _ = _analyze(client, campaign, AnalysisSettings(centre="mean"))
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
    measured = {name: evidence.safeties[name] for name in MEASURED}
    yield from judge_causes(evidence.analyses, evidence.proofs, measured)


def _compare(client: Client, evidence: Evidence, a: str, b: str) -> Comparison:
    one, other = (evidence.summaries[name].campaign for name in (a, b))
    return client.campaigns.compare(one, other)
