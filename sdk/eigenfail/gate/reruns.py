"""Verdicts on campaigns that were run again with the new planner; pure functions."""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from enum import StrEnum
from typing import Annotated

import msgspec

from eigenfail.gate.verdicts import (
    CLOSING,
    GateVerdict,
    Row,
    RunOutcomes,
    describe_pairs,
    describe_rates,
    judge_doubtful,
    judge_pairs,
    judge_rate,
    judge_rate_by_chance,
    subtract_estimates,
)
from eigenfail.intervals import difference, mcnemar, wilson
from eigenfail.methods import traits_of
from eigenfail.presentation.rates import list_doubtful
from eigenfail.settings import Count, Ordinal
from eigenfail.values.campaign import Campaign
from eigenfail.values.comparison import Comparison, Difference, McNemar, PairTotals
from eigenfail.values.estimates import Rate
from eigenfail.values.records import EpisodeRow

LONGEST_NAME, LONGEST_SENTENCE = 200, 10_000
"""Of texts in a report that a service takes, in characters."""

ReportName = Annotated[str, msgspec.Meta(max_length=LONGEST_NAME)]
ReportSentence = Annotated[str, msgspec.Meta(max_length=LONGEST_SENTENCE)]
Seconds = Annotated[float, msgspec.Meta(ge=0.0)]


class GateFinding(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An episode of the new planner, and its verdict.

    Attributes:
        what: the injected noise, in words.
        was: the baseline's episode, as CAMPAIGN/INDEX; empty if there is none.
        mode: the baseline's failure mode that the episode belongs to, as ANALYSIS/NUMBER; empty if
            there is none.
        episode: the new planner's episode, as CAMPAIGN/INDEX; empty if it was never run.
        replay: the command that runs it again.
        link: address of its page.
        problem: why it errored; empty otherwise.
        wall_s: its wall time. [s]
    """

    verdict: GateVerdict
    what: ReportSentence
    was: ReportName = ""
    mode: ReportName = ""
    episode: ReportName = ""
    replay: ReportSentence = ""
    link: ReportSentence = ""
    problem: ReportSentence = ""
    wall_s: Seconds = 0.0


class JudgedBy(StrEnum):
    """Basis for the verdict on campaigns under the same noise.

    `episode`: each episode that fails and did not fail before is new. `rate`: all episodes together
    are new if more episodes began to fail than stopped failing, by more than chance explains.
    """

    EPISODE = "episode"
    RATE = "rate"


class RerunFigures(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The findings of a campaign, in numbers.

    Attributes:
        unresolved: number of safe episodes that are unresolved.
    """

    campaign: Ordinal
    completed: Count
    failures: Count
    errored: Count = msgspec.field(name="failed")
    unresolved: Count = 0


class Rerun(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A campaign that was run again with the new planner.

    Attributes:
        before: figures of the baseline.
        now: figures of the new planner.
        method: method that chose the noise of both.
        verdict: verdict on the whole campaign.
        by: whether its episodes are judged one by one or together.
        words: basis of the verdict, in a sentence.
        unpaired_because: why episodes cannot be compared one by one; empty if they were.
        counts: number of failing episodes by verdict; empty if unpaired.
        findings: some failing episodes, new ones first; if unpaired, errored episodes and the
            likeliest failures.
        difference: difference of the failure rates; None before both completed an episode.
        modes: whether a failure mode is new, in a sentence; empty if that was not analysed.
        new_modes: the failure nearest to the centre of each new mode; new modes count only if
            `judges_modes` is true.
        warnings: limits of the comparison, in sentences.
        wall_s: how long it ran. [s]
        hidden_errored: number of errored episodes that would close the gate if they failed.
        hidden_unresolved: number of unresolved episodes that would close the gate if they failed.
    """

    before: RerunFigures
    now: RerunFigures
    method: ReportName
    verdict: GateVerdict
    by: JudgedBy
    words: ReportSentence
    unpaired_because: ReportSentence = ""
    counts: dict[GateVerdict, Count] = {}
    findings: tuple[GateFinding, ...] = ()
    difference: Difference | None = None
    modes: ReportSentence = ""
    new_modes: tuple[GateFinding, ...] = ()
    warnings: tuple[ReportSentence, ...] = ()
    wall_s: Seconds = 0.0
    hidden_errored: Count = 0
    hidden_unresolved: Count = 0

    @property
    def summary(self) -> str:
        """Return the basis of the verdict, and the findings on modes."""
        return f"{self.words} {self.modes}".rstrip()

    @property
    def doubt(self) -> str:
        """Return which episodes may hide a failure that closes the gate; empty if none does."""
        doubtful = list_doubtful(self.hidden_errored, self.hidden_unresolved)
        return f"{doubtful} of campaign {self.now.campaign}" if doubtful else ""

    @property
    def judges_modes(self) -> bool:
        """True if a new mode closes the gate, which needs independent failures.

        Failures found by a search are correlated: two searches of one planner may find different
        failure modes.
        """
        return traits_of(self.method).draws_from_prior


def make_finding(
    found: GateVerdict, what: str, was: str, row: EpisodeRow | None, pages: str
) -> GateFinding:
    """Return the finding for one episode.

    Args:
        found: the verdict.
        what: the injected noise, in words.
        was: the baseline's episode.
        row: the new planner's episode; None if it was never run.
        pages: address of the service's pages.
    """
    if row is None:
        return GateFinding(verdict=found, what=what, was=was, problem="It was not run.")
    episode = f"{row.campaign}/{row.index}"
    return GateFinding(
        verdict=found,
        what=what,
        was=was,
        episode=episode,
        replay=f"eigenfail episode replay {episode}",
        link=f"{pages}/campaigns/{row.campaign}/episodes/{row.index}",
        problem=row.problem,
        wall_s=row.wall_s,
    )


_MOST_FINDINGS = 20
"""Maximum number of episodes of a rerun that are listed with their replays, for each verdict."""

SAME = "A and B were asked for the same thing"
"""How a comparison warns of campaigns that differ in nothing but what it cannot see."""

WORST_FIRST = (
    GateVerdict.NEW,
    GateVerdict.CANNOT_RUN,
    GateVerdict.UNPROVEN,
    GateVerdict.STILL_FAILING,
    GateVerdict.FIXED,
    GateVerdict.SAFE,
)


class RerunSide(msgspec.Struct, frozen=True):
    """A campaign with the outcomes of its episodes."""

    campaign: Campaign
    outcomes: RunOutcomes[EpisodeRow]

    @property
    def id(self) -> int:
        """Id of the campaign."""
        return self.campaign.id


def judge_rerun(  # noqa: PLR0913, PLR0917 - the two sides, and how they are judged
    before: RerunSide,
    now: RerunSide,
    comparison: Comparison,
    pages: str,
    by: JudgedBy,
    closing: Collection[GateVerdict] = CLOSING,
) -> Rerun:
    """Judge a campaign: by pairs of episodes if the noise was the same, else by its rate.

    A second judgement counts the new planner's episodes in doubt as failures. If it closes the gate
    and the first judgement does not, these episodes may hide a failure that closes the gate.

    Args:
        before: side of the baseline.
        now: side of the new planner.
        comparison: comparison of the two sides, the baseline first.
        pages: address of the service's pages.
        by: basis for the verdict if the noise was the same.
        closing: verdicts that close the gate.
    """
    counts = Counter[GateVerdict]()
    unpaired = ""
    if comparison.pairs is None:
        # Nothing tells which failure is whose: one verdict for all episodes, and any may be new.
        by, unpaired = JudgedBy.RATE, comparison.unpaired_because or "its episodes are not paired."
        verdict = judge_rate(before.campaign, now.campaign, comparison.difference)
        words = describe_rates(verdict, before.campaign, now.campaign, comparison)
        findings = _list_failure_findings(now, pages)
    else:
        verdicts = judge_pairs(before.outcomes, now.outcomes)
        counts.update(verdicts.values())
        by_chance = by is JudgedBy.RATE
        worst = find_worst(counts)
        verdict = judge_rate_by_chance(comparison.pairs, counts) if by_chance else worst
        words = describe_pairs(counts, comparison)
        findings = _list_pair_findings(verdicts, before.id, now, pages)
    sides, campaigns = (before.outcomes, now.outcomes), (before.campaign, now.campaign)
    hidden = find_hidden(*sides, campaigns, comparison.pairs, by, closing)
    errored = len(hidden & now.outcomes.errored.keys())
    return Rerun(
        before=read_figures(before.campaign, len(before.outcomes.unresolved)),
        now=read_figures(now.campaign, len(now.outcomes.unresolved)),
        method=now.campaign.spec.method,
        verdict=verdict,
        by=by,
        words=words,
        unpaired_because=unpaired,
        # Sorted, so that equal gates have equal reports, byte for byte.
        counts={each: counts[each] for each in WORST_FIRST if counts[each]},
        findings=tuple(findings),
        difference=comparison.difference,
        warnings=_list_warnings(comparison),
        wall_s=now.campaign.active_s,
        hidden_errored=errored,
        hidden_unresolved=len(hidden) - errored,
    )


def find_hidden(  # noqa: PLR0913, PLR0917 - the two sides, and how they are judged
    before: RunOutcomes[Row],
    now: RunOutcomes[Row],
    campaigns: tuple[Campaign, Campaign],
    pairs: McNemar | None,
    by: JudgedBy,
    closing: Collection[GateVerdict],
) -> set[int]:
    """Return the episodes in doubt that would close the gate if they failed, by index.

    Args:
        before: outcomes of the baseline.
        now: outcomes of the new planner.
        campaigns: the campaigns of both.
        pairs: McNemar's test on pairs of episodes; None if episodes are not paired.
        by: whether episodes are judged one by one or together.
        closing: verdicts that close the gate.
    """
    # The worst case: every episode in doubt fails with the new planner.
    worst = judge_doubtful(before, now)
    if by is JudgedBy.EPISODE:
        return {index for index, verdict in worst.items() if verdict in closing}
    if pairs is None:
        verdict = _judge_rate_in_worst_case(*campaigns, len(now.unresolved))
    else:
        # A pair that was fixed, and is in doubt now, fails on both sides in the worst case.
        was_fixed = len(before.failures.keys() & now.unresolved.keys())
        counts = Counter(worst.values())
        totals = PairTotals(
            both=pairs.both + counts[GateVerdict.STILL_FAILING],
            only_first=pairs.only_a - was_fixed,
            only_second=pairs.only_b + counts[GateVerdict.NEW],
        )
        verdict = judge_rate_by_chance(mcnemar(totals), {})
    return set(worst) if verdict in closing else set()


def _judge_rate_in_worst_case(before: Campaign, now: Campaign, unresolved: int) -> GateVerdict:
    """Judge a rate as if the new planner's episodes in doubt were failures."""
    was, counts = before.counts, now.counts
    failures = counts.failures + counts.errored + unresolved
    # An estimate cannot be computed again here, so any episode in doubt may raise it.
    if not was.failures or subtract_estimates(before.estimate, now.estimate):
        return GateVerdict.NEW if failures else GateVerdict.SAFE
    new = _make_rate(failures, counts.completed + counts.errored)
    risen = difference(_make_rate(was.failures, was.completed), new).interval.low > 0.0
    return GateVerdict.NEW if risen else GateVerdict.STILL_FAILING


def _make_rate(k: int, n: int) -> Rate:
    """Return a rate as if its episodes were a random sample; for a search it is a threshold."""
    return Rate(k / n, k, n, wilson(k, n))


def find_worst(counts: Mapping[GateVerdict, int]) -> GateVerdict:
    """Return the worst verdict of some episodes; `safe` without episodes."""
    return next((each for each in WORST_FIRST if counts.get(each)), GateVerdict.SAFE)


def _list_pair_findings(
    verdicts: Mapping[int, GateVerdict], before: int, now: RerunSide, pages: str
) -> Iterator[GateFinding]:
    """Yield some episodes of each verdict, the worst verdict first, without fixed ones."""
    rows = now.outcomes.failures | now.outcomes.errored
    for worst in WORST_FIRST:
        alike = [index for index, each in verdicts.items() if each is worst and index in rows]
        for index in alike[:_MOST_FINDINGS]:
            what, was = f"episode {index}", f"{before}/{index}"
            yield make_finding(worst, what, was, rows[index], pages)


def _list_failure_findings(now: RerunSide, pages: str) -> Iterator[GateFinding]:
    """Yield some errored episodes, then the likeliest failures."""
    failures = sorted(
        now.outcomes.failures.values(), key=lambda row: row.log_probability, reverse=True
    )
    for row in [*now.outcomes.errored.values()][:_MOST_FINDINGS]:
        yield make_finding(GateVerdict.CANNOT_RUN, f"episode {row.index}", "", row, pages)
    for row in failures[:_MOST_FINDINGS]:
        yield make_finding(GateVerdict.UNPROVEN, f"episode {row.index}", "", row, pages)


def _list_warnings(comparison: Comparison) -> tuple[str, ...]:
    """Return the limits of a comparison; equal specs are none, as the planner's code may differ."""
    # A new version of the planner has the same name: that the specs are equal is no warning here.
    unseen = () if comparison.distinctions else (SAME,)
    left = (each for each in comparison.warnings if not each.startswith(unseen))
    return tuple(each.replace("A and B", "Baseline and rerun") for each in left)


def read_figures(campaign: Campaign, unresolved: int = 0) -> RerunFigures:
    """Return the findings of a campaign in numbers.

    Args:
        campaign: the campaign in its present state.
        unresolved: number of its safe episodes that are unresolved.
    """
    counts = campaign.counts
    return RerunFigures(
        campaign=campaign.id,
        completed=counts.completed,
        failures=counts.failures,
        errored=counts.errored,
        unresolved=unresolved,
    )
