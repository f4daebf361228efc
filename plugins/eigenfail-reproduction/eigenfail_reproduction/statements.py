"""The paper's statements, judged by our numbers; each rests on one seed, so none is final."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from enum import StrEnum
from functools import partial

import msgspec

from eigenfail.client import Client
from eigenfail.errors import Conflict
from eigenfail.presentation.figures import format_count, format_number
from eigenfail.suites import Suite
from eigenfail.values.analysis import AnalysisResult, AnalysisSettings, AnalysisState
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.comparison import Comparison
from eigenfail.values.episode import Outcome
from eigenfail.values.proof import Proof
from eigenfail.values.safety import Safety
from eigenfail.values.summary import Summary
from eigenfail_reproduction import judgements, tables
from eigenfail_reproduction.causes import Causes, judge_causes, leave_causes_open
from eigenfail_reproduction.paper import PaperReproduction, PaperStatement, PaperTable
from eigenfail_reproduction.programme import SWEPT, ScenarioProgramme, find_programme

Summaries = Mapping[str, Summary]


Safeties = Mapping[str, Safety]


Compare = Callable[[str, str], Comparison]
"""From the names of two members A and B to the comparison of B with A."""


NEEDED = (
    "sweep base",
    "sweep alpha=500",
    "sweep c_dist=100",
    "sweep c_dist=5000",
    "sweep batch_size=16",
    "sweep batch_size=256",
    "sweep tau=0.001",
    "sweep tau=0.01",
    "sweep buffer_size=10000",
    "ast evaluation",
    "ast_paper evaluation",
    "difs evaluation",
    "difs_paper evaluation",
)
"""Members whose failures are compared one by one, where the programme has them."""


class Means(StrEnum):
    """Means over the failures of a campaign that a statement is about."""

    LOG_P = "log p per step"
    SEVERITY = "mean severity"


SUFFIXES = ("", "_paper")
"""Of learners with our defaults, and with the paper's settings."""


REVERSED = "In this run the order is reversed."
TOO_FEW = f"There are fewer than {judgements.FEWEST_FAILURES} failures of one of them."
UNCERTAIN = "The difference is uncertain."
NOT_TESTED = "The cause was not tested."
NO_EFFECT = "The setting has no effect in these runs: the campaigns have the same failures."


def judge_campaigns(
    summaries: Summaries, safeties: Safeties, compare: Compare, programme: ScenarioProgramme
) -> Iterator[PaperStatement]:
    """Judge the statements that summaries, failures and comparisons decide.

    Without campaigns of Monte Carlo or of the sweep, the statements about them are left out.
    """
    if "monte_carlo rulebook" in summaries:
        yield _judge_planners(summaries)
        for suffix in SUFFIXES:
            yield _judge_monte_carlo(suffix, summaries)
    if "sweep base" in summaries:
        yield from _judge_sweep(summaries, safeties, compare)
    for suffix in SUFFIXES:
        yield _judge_difs(suffix, summaries, safeties)
    for suffix in SUFFIXES:
        yield _judge_moves(suffix, summaries, programme)


def _judge_sweep(
    summaries: Summaries, safeties: Safeties, compare: Compare
) -> Iterator[PaperStatement]:
    for statement in (
        _judge_batch_size(summaries, safeties, compare),
        _judge_alpha(summaries, safeties, compare),
        _judge_c_dist(summaries, safeties, compare),
    ):
        why = NOT_TESTED if statement.asked else TOO_FEW
        yield msgspec.structs.replace(statement, why=why)
    yield _judge_tau(summaries, safeties)
    yield _judge_buffer(summaries, safeties)


def _judge_planners(summaries: Summaries) -> PaperStatement:
    ours, idm = (summaries[f"monte_carlo {name}"] for name in ("rulebook", "idm"))
    holds = judgements.is_rarer(ours.failure_rate, idm.failure_rate)
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
    without = [name for name in names if not summaries[name].counts.failures]
    figures = _list_figures(summaries, names)
    why = "Monte Carlo found none of the failures that both searches find."
    if without:
        why = f"No failure was found in: {', '.join(without)}."
    if monte_carlo.counts.failures:
        why = "Monte Carlo found failures, too."
    return PaperStatement(
        "Monte Carlo finds no failure where AST and DiFS both do.",
        not monte_carlo.counts.failures and not without,
        f"Monte Carlo: {_count(monte_carlo)}; {figures}",
        why,
        "No failure of Monte Carlo, and at least one in the evaluation of each (otherwise does "
        "not hold)",
        subject=f"ast{suffix}, difs{suffix}",
    )


def _judge_batch_size(summaries: Summaries, safeties: Safeties, compare: Compare) -> PaperStatement:
    small, others = "sweep batch_size=16", ("sweep base", "sweep batch_size=256")
    comparisons = [
        judgements.combine(
            judgements.fails_more_often(compare(other, small)),
            _is_likelier_in_both(summaries, safeties, other, small),
            judgements.is_more_severe(safeties[other], safeties[small]),
        )
        for other in others
    ]
    return PaperStatement(
        "A small batch improves failure rate, log p and severity.",
        judgements.agree(comparisons),
        f"{_list_figures(summaries, (small, *others), Means.LOG_P, Means.SEVERITY)} (the base has "
        f"a batch of {SWEPT['batch_size']:,})",
        rule="16 against the base and against 256: more failures, likelier, more severe",
        asked=judgements.has_enough(*(safeties[name] for name in (small, *others))),
    )


def _judge_alpha(summaries: Summaries, safeties: Safeties, compare: Compare) -> PaperStatement:
    base, small = names = ("sweep base", "sweep alpha=500")
    return PaperStatement(
        "A small alpha makes failures likelier and fewer.",
        judgements.combine(
            judgements.fails_more_often(compare(small, base)),
            _is_likelier_in_both(summaries, safeties, base, small),
        ),
        f"{_list_figures(summaries, names, Means.LOG_P)} (the base has an alpha of "
        f"{SWEPT['alpha']:,})",
        rule="The smallest against the base, which is the largest: likelier, fewer",
        asked=judgements.has_enough(*(safeties[name] for name in names)),
    )


def _judge_c_dist(summaries: Summaries, safeties: Safeties, compare: Compare) -> PaperStatement:
    large, others = "sweep c_dist=5000", ("sweep base", "sweep c_dist=100")
    comparisons = [
        judgements.combine(
            judgements.fails_more_often(compare(other, large)),
            judgements.is_more_severe(safeties[other], safeties[large]),
        )
        for other in others
    ]
    return PaperStatement(
        "A large c_dist makes failures more frequent and more severe.",
        judgements.agree(comparisons),
        f"{_list_figures(summaries, (large, *others), Means.SEVERITY)} (the base has a c_dist of "
        f"{SWEPT['c_dist']:,})",
        rule="5,000 against the base and against 100: more failures, more severe",
        asked=judgements.has_enough(*(safeties[name] for name in (large, *others))),
    )


def _judge_tau(summaries: Summaries, safeties: Safeties) -> PaperStatement:
    return _judge_likelihood(
        "A small tau makes failures likelier.",
        f"0.001 against the base ({SWEPT['tau']:g}) and against 0.01: likelier",
        ("sweep tau=0.001", "sweep base", "sweep tau=0.01"),
        summaries,
        safeties,
    )


def _judge_buffer(summaries: Summaries, safeties: Safeties) -> PaperStatement:
    return _judge_likelihood(
        "A large buffer makes failures likelier.",
        f"The base ({SWEPT['buffer_size']:,}) against 10,000: likelier",
        ("sweep base", "sweep buffer_size=10000"),
        summaries,
        safeties,
    )


def _judge_likelihood(
    paper: str, rule: str, names: Sequence[str], summaries: Summaries, safeties: Safeties
) -> PaperStatement:
    """Judge whether the failures of the first campaign are likelier than those of the others."""
    one, *others = names
    enough = judgements.has_enough(*(safeties[name] for name in names))
    points = safeties[one].scatter.points
    equal = all(safeties[name].scatter.points == points for name in others)
    return PaperStatement(
        paper,
        judgements.agree(
            [_is_likelier_in_both(summaries, safeties, other, one) for other in others]
        ),
        _list_figures(summaries, names, Means.LOG_P),
        NO_EFFECT if equal else NOT_TESTED if enough else TOO_FEW,
        rule,
        asked=enough and not equal,
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
        subject=f"ast{suffix}, difs{suffix}",
        asked=judgements.has_enough(safeties[a], safeties[b]),
    )


def _explain_likelihood(
    holds: judgements.Judgement, safeties: Safeties, names: Sequence[str]
) -> str:
    for name in names:
        if len(safeties[name].scatter.points) < judgements.FEWEST_FAILURES:
            return f"{name}: too few failures (fewer than {judgements.FEWEST_FAILURES}) for a mean."
    return UNCERTAIN if holds is None else REVERSED


def _judge_moves(suffix: str, summaries: Summaries, programme: ScenarioProgramme) -> PaperStatement:
    names = tuple(f"ast{suffix} {place}" for place in ("evaluation", *programme.moved))
    return PaperStatement(
        "AST's policy fails the planner at other distances of the cut-in, too.",
        judgements.combine(
            *(judgements.is_above_half(summaries[name].failure_rate) for name in names)
        ),
        _list_figures(summaries, names),
        "The policy was trained at one place of the scenario only.",
        "Where it was trained and in both similar scenarios the interval of the failure rate lies "
        "above one half (does not hold: in one it lies below)",
        subject=f"ast{suffix}",
    )


def _is_likelier_in_both(
    summaries: Summaries, safeties: Safeties, a: str, b: str
) -> judgements.Judgement:
    """Whether B's failures are likelier per step; None also if their sums have another order.

    The paper sums over the steps; an episode ends at its collision, so that sums are over different
    numbers of steps.
    """
    one, other = (summaries[name].mean_log_probability for name in (a, b))
    per_step = judgements.is_likelier(safeties[a], safeties[b])
    if per_step is None or one is None or other is None:
        return None
    return per_step if (other > one) is per_step else None


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
    """Results by the name of the member; analyses by name and axis, causes by name and episode."""

    summaries: Mapping[str, Summary]
    safeties: Mapping[str, Safety]
    analyses: tables.Analyses
    proofs: Mapping[str, Proof]
    causes: Causes


Begin = Callable[[str], None]
"""Called with what comes next, in words."""


def begin_silently(step: str) -> None:
    """Say nothing of a step."""


def build_reproduction(
    client: Client,
    suite: Suite,
    scale: str,
    scenario: str = "cut_in",
    begin: Begin = begin_silently,
) -> PaperReproduction:
    """Build the paper's tables and statements from campaigns that are done.

    Launches missing analyses and replays, and waits for them.

    Args:
        client: service that has run the campaigns.
        suite: the programme's campaigns.
        scale: name of their scale.
        scenario: name of their scenario.
        begin: called with each step that takes long, such as an analysis.

    Raises:
        Conflict: a campaign is not done, or its failures cannot be analysed.
        UnknownName: there is no programme for that scenario.
    """
    _require_done(suite, client.suites.find(suite))
    programme = find_programme(scenario)
    evidence = _gather_evidence(client, suite, programme, begin)
    begin("Comparing campaigns")
    return PaperReproduction(
        scale=scale,
        seed=suite.members[0].spec.seed,
        tables=tuple(_build_tables(evidence, programme)),
        statements=tuple(_judge_statements(client, evidence, programme)),
        scenario=scenario,
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


def _gather_evidence(
    client: Client, suite: Suite, programme: ScenarioProgramme, begin: Begin
) -> Evidence:
    found = zip(suite.members, client.suites.summaries(suite), strict=True)
    summaries = {member.name: summary for member, summary in found if summary is not None}
    ids = {name: one.campaign for name, one in summaries.items() if one.counts.failures}
    diagnosed = {name: ids[name] for name in ANALYSED if name in ids}
    readings = tables.list_readings(programme)
    causes: dict[str, Mapping[int, str]] = {}
    analyses: dict[tuple[str, str, str], AnalysisResult] = {}
    proofs: dict[str, Proof] = {}
    for name, campaign in diagnosed.items():
        who = f"of campaign {campaign} ({name})"
        begin(f"Reading the failures {who}")
        causes[name] = _list_causes(client, campaign)
        for number, (reading, settings) in enumerate(readings.items(), start=1):
            begin(f"Analysis {number} of {len(readings)} of the failures {who}")
            analyses[name, *reading] = _analyze(client, campaign, settings)[1]
        begin(f"Replaying the failure modes {who}")
        proofs[name] = _prove(client, campaign, readings["joint", "start"])
    begin("Measuring how close episodes came to a collision")
    safeties = {
        name: client.campaigns.safety(summaries[name].campaign)
        for name in NEEDED
        if name in summaries
    }
    known = {name: each for name, each in causes.items() if each}
    return Evidence(summaries, safeties, analyses, proofs, known)


def _list_causes(client: Client, campaign: int) -> Mapping[int, str]:
    """Return the cause of each failure, by episode; nothing if the scenario names none."""
    failures = client.episodes.list(campaign, Outcome.COLLISION)
    return {each.index: each.cause for each in failures if each.cause is not None}


def _prove(client: Client, campaign: int, settings: AnalysisSettings) -> Proof:
    """Return the replays of a campaign's eigenfailures in its scenario and in similar ones."""
    analysis, _ = _analyze(client, campaign, settings)
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


def _build_tables(evidence: Evidence, programme: ScenarioProgramme) -> Iterator[PaperTable]:
    yield from tables.build_campaign_tables(evidence.summaries, programme)
    yield tables.build_safety_table({name: evidence.safeties[name] for name in MEASURED})
    yield tables.build_component_table(evidence.analyses, programme)
    yield tables.build_replay_table(evidence.proofs, programme)


def _judge_statements(
    client: Client, evidence: Evidence, programme: ScenarioProgramme
) -> Iterator[PaperStatement]:
    compare = partial(_compare, client, evidence)
    yield from judge_campaigns(evidence.summaries, evidence.safeties, compare, programme)
    correlated = {name: evidence.safeties[name] for name in CORRELATED}
    yield from judge_causes(
        evidence.analyses, evidence.proofs, correlated, programme, evidence.causes
    )
    for name in ANALYSED:
        if name not in evidence.proofs:
            yield from leave_causes_open(name)


def _compare(client: Client, evidence: Evidence, a: str, b: str) -> Comparison:
    one, other = (evidence.summaries[name].campaign for name in (a, b))
    return client.campaigns.compare(one, other)
