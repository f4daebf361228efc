"""Releases: the versions of a planner in one scenario, and the fate of each failure mode."""

from collections.abc import Iterator
from enum import StrEnum
from typing import NamedTuple

import msgspec

from eigenfail.values.operations import Versions
from eigenfail.values.showing import Brief
from eigenfail.values.triage import TriageState


class ModeStatus(StrEnum):
    """The fate of a failure mode in a version of a planner.

    `FIRST_SEEN`: the mode has failures here, but not in earlier versions. `STILL_THERE`: it has
    failures, as before. `NOT_FOUND_AGAIN`: earlier versions have failures of the mode, but a random
    sample of this version does not. `NOT_MET`: a search with this version did not find failures of
    it, which does not prove that the mode is gone. `REGRESSED`: it has failures again. `UNDECIDED`:
    so few failures or episodes may differ by chance, or an earlier version with the same code and
    settings contradicts.
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
        status: fate of the mode; None in versions before its first failure.
        failures: number of failures in the mode.
        chance: probability that versions without a difference differ at least so much, for all
            modes that are compared together; None if nothing is compared.
        analysis: id of the analysis with most of the mode's failures; None without failures.
        mode: number of the mode in that analysis; None without failures.
        words: reason for the status, in a sentence.
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
        """True if the version is the first one compared, so that its modes cannot be new."""
        return self.status is ModeStatus.FIRST_SEEN and self.chance is None


class ReleaseMode(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode over the versions of a planner.

    Attributes:
        number: its number among the modes of all versions, from 1.
        name: name of the mode in the newest version that has failures of it; with analysis and mode
            if several modes have this name.
        sightings: fate of the mode by version, oldest first.
        state: state of the triage of the mode in that version.
    """

    number: int
    name: str
    sightings: tuple[ModeSighting, ...]

    state: TriageState = TriageState.NEW

    @property
    def newest(self) -> ModeSighting:
        """The mode's fate in the newest version."""
        return self.sightings[-1]


class Release(msgspec.Struct, frozen=True, kw_only=True):
    """The campaigns of a version of a planner with the same question.

    Attributes:
        version: the version.
        campaigns: ids of the campaigns, oldest first.
        episodes: number of their completed episodes.
        failures: number of failures among them.
        analysed: number of failures that belong to a mode of an analysis.
        is_random: whether episodes were drawn from p(x), so that numbers of failures can be
            compared.
        is_distinct: whether all analyses found distinct modes. If an analysis did not, its groups
            cannot be distinguished from chance.
        fingerprints: the code that ran the episodes, as SHA-256 by package; several if campaigns
            of this version had different code.
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
    """A question that versions of a planner were tested with: scenario, requirements and method.

    Attributes:
        campaign: id of the newest campaign, which represents the question.
        planner: name of the planner.
        scenario: name of the scenario.
        requirements: conditions that an episode must satisfy, in words.
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
        modes: the failure modes, in the order of their discovery.
        notes: limits of the comparison, in sentences.
    """

    question: ReleaseQuestion
    releases: tuple[Release, ...]
    modes: tuple[ReleaseMode, ...]
    notes: tuple[str, ...] = ()

    def compare(self, before: str, now: str) -> Iterator[ModeChange]:
        """Yield the failure modes with failures in either of two versions."""
        places = [each.version for each in self.releases]
        old, new = places.index(before), places.index(now)
        for mode in self.modes:
            change = ModeChange(mode, mode.sightings[old], mode.sightings[new])
            if change.before.failures or change.now.failures:
                yield change

    @property
    def is_tested(self) -> bool:
        """True if a test compared the numbers of failures of at least one mode."""
        return any(one.chance is not None for each in self.modes for one in each.sightings)

    @property
    def title(self) -> str:
        """Heading of the modes; they are called groups if no version has distinct modes."""
        analysed = [each for each in self.releases if each.analysed]
        has_modes = not analysed or any(each.is_distinct for each in analysed)
        return "Failure modes" if has_modes else "Groups of failures"
