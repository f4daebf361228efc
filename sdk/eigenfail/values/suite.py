"""Suites on a service: campaigns whose names have the same beginning, "SUITE: member"."""

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
"""Names of campaigns that the service makes from others, which are not members of a suite."""


def suite_of(name: str) -> str | None:
    """Return the suite of a campaign with this name; None if it does not belong to a suite.

    The suite is the text before the first ": ". Replays and minimal failures, which are made from
    another campaign, do not belong to a suite.
    """
    suite, separator, member = name.partition(SEPARATOR)
    if not (suite and separator and member) or OFFSPRING.search(name):
        return None
    return suite.replace("\x00", "�")  # which no database takes


def member_of(name: str) -> str:
    """Return the name of a campaign in its suite."""
    return name.partition(SEPARATOR)[2]


class SuiteStanding(msgspec.Struct, frozen=True, kw_only=True):
    """A suite in a list.

    Attributes:
        newest: id of its newest campaign.
        campaigns: number of campaigns of the suite, including earlier runs.
        states: number of campaigns by state.
        planned: number of planned episodes of all campaigns; `completed` likewise.
        failures: number of failures among the completed episodes.
        errored: number of errored campaigns: they are done, but did not complete an episode.
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
        """Number of campaigns by state as shown to users, with errored ones counted separately."""
        states = {**self.states}
        done = states.pop(CampaignState.DONE, 0) - self.errored
        words = {state.value: count for state, count in states.items()}
        split = {CampaignState.DONE.value: done, ERRORED: self.errored}
        return dict(sorted((words | {name: n for name, n in split.items() if n > 0}).items()))


class SuiteRow(msgspec.Struct, frozen=True, kw_only=True):
    """A member of a suite and its newest campaign.

    Attributes:
        member: name of the member in the suite.
        settings: its values in the columns of the table; default values are absent.
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
        columns: campaign fields that differ between members, named by the last word of their path
            if it is unique, else by the whole path.
        members: members in the order of their first creation.
        earlier: number of earlier campaigns that are replaced by a newer one of the same name.
        left_out: number of members beyond the maximum of a table, which are the oldest ones.
        over_seeds: mean and spread of the members that differ only in their seeds, group by group.
    """

    suite: str
    columns: tuple[str, ...]
    members: tuple[SuiteRow, ...]
    earlier: int = 0
    left_out: int = 0
    over_seeds: tuple[SeedSpread, ...] = ()
