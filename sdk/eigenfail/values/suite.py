"""Suites as a service knows them: campaigns whose names begin alike, "SUITE: member"."""

import re
from collections.abc import Mapping

import msgspec

from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import Settings
from eigenfail.values.episode import ERRORED
from eigenfail.values.seeds import SeedSpread
from eigenfail.values.showing import Brief, Shown
from eigenfail.values.summary import Summary

SEPARATOR = ": "

OFFSPRING = re.compile(
    r": (replay of (analysis \d+|\d+/\d+)|minimal failure of \d+/\d+)(,.*)?$", re.DOTALL
)
"""How campaigns are named that the service makes of others: they are no members of a suite."""


def suite_of(name: str) -> str | None:
    """The suite that a campaign of this name belongs to, if it belongs to one.

    It is what stands before the first ": "; replays and minimal failures that were made of another
    campaign belong to none.
    """
    suite, separator, member = name.partition(SEPARATOR)
    if not (suite and separator and member) or OFFSPRING.search(name):
        return None
    return suite.replace("\x00", "�")  # which no database takes


def member_of(name: str) -> str:
    """The name of a campaign in its suite."""
    return name.partition(SEPARATOR)[2]


class SuiteStanding(msgspec.Struct, frozen=True, kw_only=True):
    """A suite in a list.

    Attributes:
        newest: id of its newest campaign.
        campaigns: number of campaigns of the suite, including earlier runs.
        states: number of campaigns by state.
        planned: episodes of all of them; `completed` likewise.
        failures: failures among the completed ones.
        errored: how many of the campaigns that are done are errored: no episode was completed.
    """

    name: str
    newest: int
    campaigns: int
    states: Mapping[CampaignState, int]
    planned: int
    completed: int
    failures: int
    errored: int = 0

    @property
    def state_words(self) -> dict[str, int]:
        """How many campaigns are in each state as people read it, errored ones apart."""
        states = {**self.states}
        done = states.pop(CampaignState.DONE, 0) - self.errored
        words = {state.value: count for state, count in states.items()}
        split = {CampaignState.DONE.value: done, ERRORED: self.errored}
        return dict(sorted((words | {name: n for name, n in split.items() if n > 0}).items()))


class SuiteRow(msgspec.Struct, frozen=True, kw_only=True):
    """A member of a suite and its newest campaign.

    Attributes:
        member: name of the member in the suite.
        settings: what it has in the columns of its table; what it leaves to the default is absent.
    """

    member: str
    campaign: int
    state: CampaignState
    stopped_because: str
    settings: Settings
    summary: Summary


class SuiteTable(Brief, Shown, msgspec.Struct, frozen=True, kw_only=True):
    """A suite, one row for each member.

    Attributes:
        columns: the fields of a campaign in which members differ, by their last word where that
            tells them apart, else by their whole path.
        members: members in the order in which they were first created.
        earlier: number of earlier campaigns that are replaced by a newer one of the same name.
        left_out: members beyond the most that a table holds, the oldest ones.
        over_seeds: mean and spread of the members that differ in their seeds alone, group by group.
    """

    suite: str
    columns: tuple[str, ...]
    members: tuple[SuiteRow, ...]
    earlier: int = 0
    left_out: int = 0
    over_seeds: tuple[SeedSpread, ...] = ()
