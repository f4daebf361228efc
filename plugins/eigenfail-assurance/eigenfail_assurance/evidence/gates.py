"""The verdicts of a gate, judged again from the episodes of its campaigns.

Two facts come from the gate's report: whether a failure mode is new, and what became of a known
failure in the baseline, unless its episode is in the bundle.
"""

from collections import Counter
from collections.abc import Iterator

from msgspec.structs import replace

from eigenfail.gate import reruns
from eigenfail.gate.report import GateReport, GateRun
from eigenfail.gate.verdicts import (
    GateVerdict,
    RunOutcomes,
    has_new_errors,
    judge_outcome,
    judge_pairs,
    judge_rate,
    judge_rate_by_chance,
)
from eigenfail.intervals import bound_both_sides, difference, mcnemar
from eigenfail.values.campaign import CampaignState
from eigenfail.values.comparison import Difference, McNemar, PairTotals
from eigenfail.values.episode import Outcome
from eigenfail.values.estimates import Rate
from eigenfail_assurance.evidence import counting
from eigenfail_assurance.evidence.records import RecordedEpisode, place_episode


def find_gate_problems(report: GateReport, campaigns: counting.Counted) -> Iterator[str]:
    """Yield the verdicts of a gate that its episodes contradict, in sentences.

    Args:
        report: what the gate printed.
        campaigns: the campaigns that it names, by id.

    Raises:
        InvalidValue: episodes cannot be read, or one is not written as CAMPAIGN/INDEX.
    """
    for member in report.members:
        for finding in member.known:
            yield from _check_known(finding, report.gate, campaigns)
        if member.rerun:
            yield from _check_rerun(member.rerun, report.gate, campaigns)


def _check_known(
    finding: reruns.GateFinding, gate: GateRun, campaigns: counting.Counted
) -> Iterator[str]:
    if not finding.episode:
        yield f"the known failure '{finding.what}' has no episode."
        return
    number, index = place_episode(finding.episode)
    yield from _check_campaign(campaigns[number], gate)
    now = campaigns[number].outcomes.get(index)
    possible = {judge_outcome(before, now) for before in _list_outcomes_before(finding, campaigns)}
    if finding.verdict not in possible:
        yield (
            f"it calls episode {finding.episode} '{finding.verdict}', and the episode says "
            f"{_join(possible)}."
        )


def _list_outcomes_before(
    finding: reruns.GateFinding, campaigns: counting.Counted
) -> tuple[Outcome | None, ...]:
    """Return the possible outcomes of a known failure with the planner of the baseline."""
    if finding.was:
        number, index = place_episode(finding.was)
        if number in campaigns and campaigns[number].outcomes.get(index) is Outcome.SAFE:
            return (Outcome.SAFE,)
    return (Outcome.SAFE, Outcome.COLLISION, None)


def _check_campaign(counted: counting.CountedCampaign, gate: GateRun) -> Iterator[str]:
    """Yield why a campaign of the new planner gives no evidence."""
    yield from _check_done(counted)
    if counted.campaign.spec.version != gate.version:
        yield (
            f"campaign {counted.campaign.id} tests version '{counted.campaign.spec.version}', and "
            f"not '{gate.version}'."
        )


def _check_done(counted: counting.CountedCampaign) -> Iterator[str]:
    campaign = counted.campaign
    if campaign.state is not CampaignState.DONE:
        yield f"campaign {campaign.id} is {campaign.state_word}."
    if problem := counting.explain_gaps([counted]):
        yield problem


def _check_rerun(rerun: reruns.Rerun, gate: GateRun, campaigns: counting.Counted) -> Iterator[str]:
    before, now = (campaigns[each.campaign] for each in (rerun.before, rerun.now))
    name = f"campaign {now.campaign.id}"
    if now.campaign.id == before.campaign.id:
        yield f"{name} is compared with itself."
    yield from _check_done(before)
    yield from _check_campaign(now, gate)
    yield from _compare_counts(rerun.before, before)
    yield from _compare_counts(rerun.now, now)
    if rerun.method != now.campaign.spec.method:
        yield f"{name} is of '{now.campaign.spec.method}', and not of '{rerun.method}'."
    yield from _check_doubt(rerun, gate, before, now)
    if rerun.unpaired_because:
        yield from _check_unpaired(rerun, before, now)
    else:
        yield from _check_paired(rerun, gate, before, now)


def _compare_counts(
    figures: reruns.RerunFigures, counted: counting.CountedCampaign
) -> Iterator[str]:
    said = (figures.completed, figures.failures, figures.errored, figures.unresolved)
    if said != (counted.completed, counted.failures, counted.errored, counted.unresolved):
        yield f"its counts of campaign {figures.campaign} are not those of the episodes."


def _check_doubt(
    rerun: reruns.Rerun,
    gate: GateRun,
    before: counting.CountedCampaign,
    now: counting.CountedCampaign,
) -> Iterator[str]:
    """Yield that a rerun leaves out episodes that may hide a reason to close the gate.

    The episodes do not show which of them are unresolved. Hence only the smallest possible number
    is counted: unresolved episodes without a counterpart that failed or was unresolved.
    """
    outcomes = _read_outcomes(before), _read_outcomes(now)
    safe = [each for each in now.episodes if each.outcome is Outcome.SAFE]
    known = [each for each in safe if outcomes[0].of(each.index) is Outcome.SAFE]
    least = max(now.unresolved - before.unresolved - before.failures, 0)
    unresolved = {each.index: each for each in known[:least]}
    pairs = None if rerun.unpaired_because else _count_pairs(before, now)
    campaigns = before.counted, now.counted
    sides = outcomes[0], replace(outcomes[1], unresolved=unresolved)
    hidden = reruns.find_hidden(*sides, campaigns, pairs, rerun.by, gate.closing)
    if len(hidden) > rerun.hidden_errored + rerun.hidden_unresolved:
        yield f"episodes of campaign {now.campaign.id} in doubt may hide a new failure."


def _check_paired(
    rerun: reruns.Rerun,
    gate: GateRun,
    before: counting.CountedCampaign,
    now: counting.CountedCampaign,
) -> Iterator[str]:
    """Yield the contradictions in a rerun that is judged by pairs of episodes."""
    name = f"campaign {now.campaign.id}"
    if rerun.by is not gate.by:
        yield f"{name} is judged by {rerun.by}, and the gate by {gate.by}."
    if not _count_pairs(before, now).n:
        yield f"no episode of {name} has the seed of one of campaign {before.campaign.id}."
        return
    counts = Counter(judge_pairs(_read_outcomes(before), _read_outcomes(now)).values())
    if rerun.counts != dict(counts):
        yield f"its counts of the pairs of {name} are not those of the episodes."
    by_chance = judge_rate_by_chance(_count_pairs(before, now), counts)
    verdict = reruns.find_worst(counts) if rerun.by is reruns.JudgedBy.EPISODE else by_chance
    yield from _compare_verdict(rerun, {verdict})


def _check_unpaired(
    rerun: reruns.Rerun, before: counting.CountedCampaign, now: counting.CountedCampaign
) -> Iterator[str]:
    """Yield the contradictions in a rerun that is judged by its rate."""
    name = f"campaign {now.campaign.id}"
    if rerun.by is not reruns.JudgedBy.RATE or rerun.counts:
        yield f"{name} has no pairs, and is judged by them."
    if _has_same_noise(before, now) and _count_pairs(before, now).n:
        yield f"{name} has the noise of campaign {before.campaign.id}, and is not judged by pairs."
    verdict = judge_rate(before.counted, now.counted, _subtract_rates(before, now))
    if not (_judges_failures(before, now) and _rests_on_difference(before, now)):
        yield from _compare_verdict(rerun, {verdict})
    elif now.failures:
        yield f"a stop rule judges failures: no interval of the rates of {name} is computed again."
    else:
        yield from _compare_verdict(rerun, {GateVerdict.SAFE, GateVerdict.FIXED})


def _judges_failures(before: counting.CountedCampaign, now: counting.CountedCampaign) -> bool:
    """Return whether a stop rule decides on the interval of a rate."""
    return any(each.campaign.spec.stop.judges_failures for each in (before, now))


def _rests_on_difference(before: counting.CountedCampaign, now: counting.CountedCampaign) -> bool:
    """Return whether the verdict of `judge_rate` rests on the difference of the rates."""
    estimates = [each.campaign.estimate for each in (before, now)]
    if has_new_errors(before.counted.counts, now.counted.counts) or not before.failures:
        return False
    return not all(each and each.interval for each in estimates)


def _compare_verdict(rerun: reruns.Rerun, possible: set[GateVerdict]) -> Iterator[str]:
    """Yield that a verdict does not follow from the episodes; a new mode makes it stricter."""
    if rerun.new_modes:
        possible = possible | {GateVerdict.NEW}
    if rerun.verdict not in possible:
        yield (
            f"it calls campaign {rerun.now.campaign} '{rerun.verdict}', and the episodes say "
            f"{_join(possible)}."
        )


def _join(verdicts: set[GateVerdict]) -> str:
    return " or ".join(f"'{each}'" for each in sorted(verdicts))


def _read_outcomes(counted: counting.CountedCampaign) -> RunOutcomes[RecordedEpisode]:
    episodes = counted.episodes
    return RunOutcomes(
        episodes=len(episodes),
        failures={each.index: each for each in episodes if each.outcome.is_failure},
        errored={each.index: each for each in episodes if each.outcome is Outcome.ERRORED},
    )


def _count_pairs(before: counting.CountedCampaign, now: counting.CountedCampaign) -> McNemar:
    """Return McNemar's exact test on the episodes that both completed with one seed and source."""
    known = {(each.index, each.seed, each.source): each.outcome for each in before.episodes}
    pairs: Counter[tuple[bool, bool]] = Counter()
    for each in now.episodes:
        was = known.get((each.index, each.seed, each.source), Outcome.ERRORED)
        if Outcome.ERRORED not in {was, each.outcome}:
            pairs[was.is_failure, each.outcome.is_failure] += 1
    return mcnemar(
        PairTotals(
            both=pairs[True, True],
            only_first=pairs[True, False],
            only_second=pairs[False, True],
            neither=pairs[False, False],
        )
    )


def _has_same_noise(before: counting.CountedCampaign, now: counting.CountedCampaign) -> bool:
    """Return whether both drew the same noise from p(x); other methods are not compared."""
    one, other = before.campaign.spec, now.campaign.spec
    fields = ("method", "seed", "simulator", "scenario", "scenario_parameters")
    is_alike = all(getattr(one, name) == getattr(other, name) for name in fields)
    return (
        is_alike
        and one.method == counting.MONTE_CARLO
        and one.disturbance.is_like(other.disturbance)
    )


def _subtract_rates(
    before: counting.CountedCampaign, now: counting.CountedCampaign
) -> Difference | None:
    """Return the difference of the failure rates; None before both completed an episode."""
    sides = (before, now)
    if not all(each.completed for each in sides):
        return None
    rates = []
    for each in sides:
        share = each.failures / each.completed
        counts = (each.failures, each.completed)
        rate = Rate(share, *counts, None, errored=each.errored, unresolved=each.unresolved)
        rates.append(replace(rate, interval=bound_both_sides(rate)))
    return difference(*rates)
