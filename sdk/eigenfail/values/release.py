"""Releases: the versions of a planner in one scenario, and what became of each failure mode."""

from collections.abc import Iterator
from enum import StrEnum
from typing import NamedTuple

import msgspec

from eigenfail.values.operations import Versions
from eigenfail.values.showing import Brief
from eigenfail.values.triage import TriageState


class ModeStatus(StrEnum):
    """The fate of a failure mode in a version of a planner.

    `FIRST_SEEN`: it has failures, and no earlier version has one. `STILL_THERE`: it has failures,
    as before. `NOT_FOUND_AGAIN`: earlier versions have failures of it, and in a random sample this
    one has none. `NOT_MET`: a search with this version has none, which does not prove that the mode
    is gone. `REGRESSED`: it has failures again. `UNDECIDED`: so few failures or episodes may differ
    by chance, or an earlier version with the same code and settings says otherwise.
    """

    FIRST_SEEN = "first seen"
    STILL_THERE = "still there"
    NOT_FOUND_AGAIN = "not found again"
    NOT_MET = "not met"
    REGRESSED = "regressed"
    UNDECIDED = "undecided"


class ModeSighting(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode in a version of a planner.

    Attributes:
        version: the version.
        status: what became of the mode; None in versions before the one that it was found in.
        failures: number of failures that belong to it.
        chance: probability that versions without a difference differ at least so much, for all
            modes that are compared together; None if nothing is compared.
        analysis: id of the analysis that has most of these failures; None without failures.
        mode: number of the mode in that analysis; None without failures.
        words: why the status is what it is, in a sentence.
    """

    version: str
    status: ModeStatus | None = None
    failures: int = 0
    chance: float | None = None
    analysis: int | None = None
    mode: int | None = None
    words: str = ""

    @property
    def is_baseline(self) -> bool:
        """Whether the version is the first one compared, in which no mode can be new."""
        return self.status is ModeStatus.FIRST_SEEN and self.chance is None


class ReleaseMode(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode over the versions of a planner.

    Attributes:
        number: its number among the modes of all versions, from 1.
        name: name of the mode in the newest version that has failures of it; with analysis and mode
            if several modes have this name.
        sightings: what became of it, by version, oldest first.
        state: state of the triage of the mode in that version.
    """

    number: int
    name: str
    sightings: tuple[ModeSighting, ...]

    state: TriageState = TriageState.NEW

    @property
    def newest(self) -> ModeSighting:
        """Its fate in the newest version."""
        return self.sightings[-1]


class Release(msgspec.Struct, frozen=True, kw_only=True):
    """The campaigns of a version of a planner that ask the same question.

    Attributes:
        version: the version.
        campaigns: ids of the campaigns, oldest first.
        episodes: number of their completed episodes.
        failures: number of the failures among these.
        analysed: number of the failures that belong to a mode of an analysis.
        is_random: whether episodes were drawn from p(x), so that numbers of failures can be
            compared.
        is_distinct: whether all analyses found distinct modes; where one did not, its groups cannot
            be told from chance.
        fingerprints: the code that ran the episodes, as SHA-256 by package; several where the
            campaigns of this version did not have the same code.
        problem: why its failure modes are not compared; empty if they are.
    """

    version: str
    campaigns: tuple[int, ...]
    episodes: int
    failures: int
    is_random: bool
    analysed: int = 0
    is_distinct: bool = True
    fingerprints: tuple[Versions, ...] = ()
    problem: str = ""


class ReleaseQuestion(Brief, msgspec.Struct, frozen=True, kw_only=True):
    """A scenario in which versions of a planner were tested.

    Attributes:
        campaign: id of the newest campaign, which stands for the question.
        planner: name of the planner.
        scenario: name of the scenario.
        requirements: what an episode must satisfy, in words.
        method: name of the search method.
        versions: the versions, in the order of their first campaigns.
        campaigns: number of campaigns.
    """

    campaign: int
    planner: str
    scenario: str
    requirements: str
    method: str
    versions: tuple[str, ...]
    campaigns: int


class ModeChange(NamedTuple):
    """A failure mode in two versions of a planner."""

    mode: ReleaseMode
    before: ModeSighting
    now: ModeSighting


class ReleaseTable(Brief, msgspec.Struct, frozen=True, kw_only=True):
    """The versions of a planner in one scenario, and their failure modes.

    Attributes:
        question: planner, scenario, requirements and method, which all versions share.
        releases: the versions, in the order of their first campaigns.
        modes: the failure modes, in the order in which they were found.
        notes: what limits the comparison, in sentences.
    """

    question: ReleaseQuestion
    releases: tuple[Release, ...]
    modes: tuple[ReleaseMode, ...]
    notes: tuple[str, ...] = ()

    def compare(self, before: str, now: str) -> Iterator[ModeChange]:
        """Yield the failure modes of two versions: those of which either has failures."""
        places = [each.version for each in self.releases]
        old, new = places.index(before), places.index(now)
        for mode in self.modes:
            change = ModeChange(mode, mode.sightings[old], mode.sightings[new])
            if change.before.failures or change.now.failures:
                yield change

    @property
    def is_tested(self) -> bool:
        """Whether numbers of failures of any mode were compared by a test."""
        return any(one.chance is not None for each in self.modes for one in each.sightings)

    @property
    def title(self) -> str:
        """The heading of its modes, which are groups if no version has distinct ones."""
        analysed = [each for each in self.releases if each.analysed]
        has_modes = not analysed or any(each.is_distinct for each in analysed)
        return "Failure modes" if has_modes else "Groups of failures"
