"""Campaigns run again with the new planner, judged: pure."""

from collections import Counter
from collections.abc import Iterator, Mapping

import msgspec

from eigenfail.gate.found import By, Figures, Finding, Rerun, finding
from eigenfail.gate.verdicts import Outcomes, Verdict, by_chance, by_rate, paired
from eigenfail.gate.words import of_pairs, of_rates
from eigenfail.values import Campaign, Comparison

TOLD = 20
"""How many episodes of a rerun are told with their replays, of each verdict."""

SAME = "A and B were asked for the same thing"
"""How a comparison warns of campaigns that differ in nothing but what it cannot see."""

WORST_FIRST = (
    Verdict.NEW,
    Verdict.CANNOT_RUN,
    Verdict.UNPROVEN,
    Verdict.STILL_FAILING,
    Verdict.FIXED,
    Verdict.SAFE,
)


class Side(msgspec.Struct, frozen=True):
    """A campaign with what came of its episodes."""

    campaign: Campaign
    outcomes: Outcomes

    @property
    def id(self) -> int:
        """Of the campaign."""
        return self.campaign.id


def rerun(before: Side, now: Side, comparison: Comparison, pages: str, by: By) -> Rerun:
    """What became of a campaign: episode by episode where noise was the same, else by its rate.

    Args:
        before: the baseline's.
        now: the new planner's.
        comparison: of the two, the baseline first.
        pages: address of the service's pages.
        by: by what to judge where noise was the same.
    """
    if comparison.pairs is None:
        return as_a_whole(before, now, comparison, pages)
    return by_pairs(before, now, comparison, pages, by)


def by_pairs(before: Side, now: Side, comparison: Comparison, pages: str, by: By) -> Rerun:
    """Every failing episode has a verdict of its own; that of all is the worst, or by chance."""
    verdicts = paired(before.outcomes, now.outcomes)
    counts = Counter(verdicts.values())
    worst = next((each for each in WORST_FIRST if counts[each]), Verdict.SAFE)
    return Rerun(
        before=figures(before.campaign),
        now=figures(now.campaign),
        method=now.campaign.spec.method,
        verdict=worst if by is By.EPISODE else by_chance(comparison, counts),
        by=by,
        words=of_pairs(counts, comparison),
        counts={each: counts[each] for each in WORST_FIRST if counts[each]},
        findings=tuple(told_pairs(verdicts, before.id, now, pages)),
        difference=comparison.difference,
        warnings=warnings_of(comparison),
        wall_s=now.campaign.active_s,
    )


def told_pairs(
    verdicts: Mapping[int, Verdict], before: int, now: Side, pages: str
) -> Iterator[Finding]:
    """Some episodes of each verdict, the worst verdict first; fixed ones have no failure to see."""
    rows = now.outcomes.collisions | now.outcomes.failed
    for worst in WORST_FIRST:
        alike = [index for index, each in verdicts.items() if each is worst and index in rows]
        for index in alike[:TOLD]:
            what, was = f"episode {index}", f"{before}/{index}"
            yield finding(worst, what, was, rows[index], pages)


def as_a_whole(before: Side, now: Side, comparison: Comparison, pages: str) -> Rerun:
    """One verdict for all of it, and its likeliest failures: whether each is new nobody knows."""
    became = by_rate(before.campaign, now.campaign, comparison)
    return Rerun(
        before=figures(before.campaign),
        now=figures(now.campaign),
        method=now.campaign.spec.method,
        verdict=became,
        by=By.RATE,
        words=of_rates(became, before.campaign, now.campaign, comparison),
        unpaired_because=comparison.unpaired_because or "its episodes are not paired.",
        findings=tuple(told_of_all(now, pages)),
        difference=comparison.difference,
        warnings=warnings_of(comparison),
        wall_s=now.campaign.active_s,
    )


def told_of_all(now: Side, pages: str) -> Iterator[Finding]:
    """Those that could not be run, then the likeliest failures."""
    failures = sorted(
        now.outcomes.collisions.values(), key=lambda row: row.log_probability, reverse=True
    )
    for row in [*now.outcomes.failed.values()][:TOLD]:
        yield finding(Verdict.CANNOT_RUN, f"episode {row.index}", "", row, pages)
    for row in failures[:TOLD]:
        yield finding(Verdict.UNPROVEN, f"episode {row.index}", "", row, pages)


def warnings_of(comparison: Comparison) -> tuple[str, ...]:
    """What keeps it from saying more; not that nothing differs, since the planner's code may."""
    unseen = () if comparison.distinctions else (SAME,)
    left = (each for each in comparison.warnings if not each.startswith(unseen))
    return tuple(each.replace("A and B", "Baseline and rerun") for each in left)


def figures(campaign: Campaign) -> Figures:
    """What a campaign found."""
    counts = campaign.counts
    return Figures(
        campaign=campaign.id,
        completed=counts.completed,
        failures=counts.failures,
        failed=counts.failed,
    )
