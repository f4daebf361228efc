"""Proof by replay: eigenfailures and medoids injected again, here and in other scenarios."""

from collections.abc import Iterator
from typing import NamedTuple

from eigenfail.values import Proof, ReplayedNoise, Reproduction
from eigenfail.values.report import Cell, ReportSection
from eigenfail_services.campaigns.proofs import proof
from eigenfail_services.reports import formats
from eigenfail_services.reports.analysed import Analysed, analysed
from eigenfail_services.reports.material import Material
from eigenfail_services.reports.parts import Grid, Part, table

SCENARIOS, REPLAYS = "proof", "replays"
SCENARIO_COLUMNS = (
    ("campaign", "Campaign"),
    ("scenario", "Scenario"),
    ("replay", "Replay campaign"),
    ("what", "What was injected"),
    ("reproduced", "Failed again"),
    ("tried", "Tried"),
    ("share", "Share", "share"),
    ("share_low", "from", "share"),
    ("share_high", "to", "share"),
    ("smallest_robustness_m", "Smallest robustness", "m"),
)
REPLAY_COLUMNS = (
    ("campaign", "Campaign"),
    ("replay", "Replay campaign"),
    ("episode", "Episode"),
    ("what", "What was injected"),
    ("mode", "Mode"),
    ("reproduced", "Failed again"),
    ("robustness_m", "Robustness", "m"),
    ("log_p", "log p", "nat"),
    ("expected_log_p", "Mean log p of p(x)", "nat"),
)
WORDS = (
    "An eigenfailure is proven by injecting it again: it must end in a collision in the scenario "
    "in which its failures were found, and says more if it does so in others. Medoids are real "
    "failures, injected in the same way. Intervals are of 95 %."
)
HEADER = ("Campaign", "Scenario", "Eigenfailures that failed again", "Medoids that failed again")


class Proven(NamedTuple):
    """A campaign whose analysis was replayed."""

    found: Analysed
    proof: Proof


def part(material: Material) -> Part | None:
    """The replays of every analysis that was replayed."""
    proofs = (Proven(each, proof(material.store, each.analysis)) for each in analysed(material))
    proven = [each for each in proofs if each.proof.scenarios]
    if not proven:
        return None
    section = ReportSection(
        name="proof",
        title="Proof by replay",
        words=(WORDS, *map(told, proven)),
        tables=(
            table(SCENARIOS, "Replays by scenario", SCENARIO_COLUMNS, [*scenario_rows(proven)]),
            table(REPLAYS, "Each replay", REPLAY_COLUMNS, [*replay_rows(proven)]),
        ),
    )
    rows = tuple(row for each in proven for row in lines(each))
    return Part(section, {SCENARIOS: (Grid(HEADER, rows),)}, folded=frozenset({REPLAYS}))


def told(proven: Proven) -> str:
    """Whether the eigenfailures of a campaign fail again."""
    here, everywhere = proven.proof.reproduced, proven.proof.eigenfailures
    unfinished = "" if proven.proof.done else " Replays are still running."
    return (
        f"Campaign {proven.found.subject.id}: of its eigenfailures {in_line(here)} failed "
        f"again in the same scenario, and {in_line(everywhere)} over all scenarios."
        f"{unfinished}"
    )


def of(found: Reproduction) -> formats.Lines:
    """How many failed again, of those tried."""
    if found.rate is None:
        return ("none tried",)
    bounds = formats.bounds(found.rate.interval, 100.0)
    return (f"{found.rate.k} of {found.rate.n}", f"95 %: {bounds} %")


def in_line(found: Reproduction) -> str:
    """The same within a sentence."""
    count, *bounds = of(found)
    return f"{count} ({', '.join(bounds)})" if bounds else count


def lines(proven: Proven) -> Iterator[tuple[formats.Lines, ...]]:
    """A row for each scenario, in words."""
    for each in proven.proof.scenarios:
        who = ((str(proven.found.subject.id),), (each.words,))
        yield (*who, of(each.eigenfailures), of(each.medoids))


def scenario_rows(proven: list[Proven]) -> Iterator[tuple[Cell, ...]]:
    """Two rows for each scenario."""
    for found, proof_of in proven:
        for each in proof_of.scenarios:
            who = (found.subject.id, each.words, each.campaign)
            yield (*who, "eigenfailures", *counted(each.eigenfailures))
            yield (*who, "medoids", *counted(each.medoids))


def counted(found: Reproduction) -> tuple[Cell, ...]:
    """How many failed again, and how near the others came."""
    rate, nearest = found.rate, found.smallest_robustness_m
    if rate is None:
        return (0, 0, None, None, None, nearest)
    return (rate.k, rate.n, rate.value, rate.interval.low, rate.interval.high, nearest)


def replay_rows(proven: list[Proven]) -> Iterator[tuple[Cell, ...]]:
    """A row for each replay that has a result."""
    for found, proof_of in proven:
        for scenario in proof_of.scenarios:
            yield from (row(found, each) for each in scenario.replays if each.outcome is not None)


def row(found: Analysed, each: ReplayedNoise) -> tuple[Cell, ...]:
    """One replay."""
    who = (found.subject.id, each.campaign, each.index, each.what.value, each.mode + 1)
    likely = (each.log_probability, each.expected_log_probability)
    return (*who, each.reproduced, each.robustness_m, *likely)
