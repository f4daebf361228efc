"""A campaign: a budgeted search for failures of one planner, with one method, from one seed."""

from enum import StrEnum

import msgspec

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import ERRORED
from eigenfail.values.estimates import Estimate
from eigenfail.values.operations import Versions
from eigenfail.values.showing import Shown


class CampaignState(StrEnum):
    """State of a campaign."""

    QUEUED = "queued"
    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"
    CANCELLING = "cancelling"
    CANCELLED = "cancelled"
    DONE = "done"
    DEAD = "dead"


FINAL_STATES = frozenset({CampaignState.CANCELLED, CampaignState.DONE, CampaignState.DEAD})


class Counts(msgspec.Struct, frozen=True):
    """Counts of episodes: planned = completed + errored + cancelled + open, at every commit.

    `failures` counts the failures among the completed episodes. `errored` counts the episodes
    that could not be completed, which rates leave out; it is stored and sent as "failed".
    `cancelled` counts the episodes left unrun when the campaign ended, whatever the cause: a user,
    a stop rule, or a method with nothing more to propose. `duplicates` counts results that arrived
    a second time.
    """

    planned: int
    completed: int = 0
    failures: int = 0
    errored: int = msgspec.field(name="failed", default=0)
    cancelled: int = 0
    duplicates: int = 0

    @property
    def all_errored(self) -> bool:
        """True if episodes have errored and none was completed."""
        return self.errored > 0 and not self.completed

    @property
    def open(self) -> int:
        """Number of episodes still to come."""
        return self.planned - self.completed - self.errored - self.cancelled


def state_word(state: CampaignState, counts: Counts) -> str:
    """Return the state as shown to users: "errored" if every episode of the campaign errored.

    The stored state of such a campaign is `done`: its search ran to its end.
    """
    return ERRORED if state is CampaignState.DONE and counts.all_errored else state.value


class Overhead(msgspec.Struct, frozen=True):
    """Time that a campaign spent outside simulation, as the hub measured it.

    Attributes:
        learning_s: time of the learner's work, its start included, while no worker held an episode
            of the campaign.
        waiting_s: time while no worker held an episode of the campaign and the learner did not
            work: the campaign waited for workers or for the database.
        discarded_s: worker time in discarded results: second results of an episode, and results
            that the store did not accept.
    """

    learning_s: float = 0.0
    waiting_s: float = 0.0
    discarded_s: float = 0.0


BUDGET_SPENT = "The budget of {} episodes was spent."
"""Why a campaign ended as planned."""


def describe_early_end(because: str, planned: int) -> str:
    """Return why a campaign ended; empty if it ended as planned, with its budget spent."""
    return "" if because == BUDGET_SPENT.format(planned) else because


class RunPart(msgspec.Struct, frozen=True, kw_only=True):
    """A part of a campaign that services with the same versions ran.

    Attributes:
        versions: versions by name, as the learner ran: Python, processor, packages.
        began_ms: when these services took the campaign over.
        results: number of results that the campaign had by then; later ones belong to this part.
    """

    versions: Versions
    began_ms: int
    results: int


class EpisodeForm(msgspec.Struct, frozen=True):
    """The form that all full episodes of a campaign share.

    The default is the form of a campaign whose world was unknown to the service that created it.

    Attributes:
        steps: number of steps of the longest episode.
        step_s: duration of a step; None if it is undefined. [s]
        channels: names of the channels of the noise, in the order of the columns of z.
    """

    steps: int = 0
    step_s: float | None = None
    channels: tuple[str, ...] = ()

    @property
    def horizon_s(self) -> float | None:
        """Duration of the longest episode; None if the duration of a step is undefined. [s]"""
        return None if self.step_s is None else self.steps * self.step_s


class Campaign(Shown, msgspec.Struct, frozen=True, kw_only=True):
    """Current state of a campaign.

    Attributes:
        stopped_because: why the campaign is in its final state, or why the service paused it;
            empty otherwise.
        active_s: time during which the campaign was running; pauses do not count.
        digest: digest of all results in index order, once the campaign is done.
        estimate: estimate of the failure probability; None if the method does not give one, or
            has not yet.
        overhead: the part of `active_s` that was not a simulation.
        trained_episodes: number of episodes that its learner was trained with so far; None if the
            method does not report it.
        parts: the versions of the services that ran the campaign, in order of time; empty until a
            service has taken it over.
        code: fingerprints of the code that workers ran its episodes with, by package; several if
            workers had different code, none if the code is not in a package with plug-ins.
        archived_ms: when the campaign was archived; None if it is not archived, and appears in
            lists. [ms since 1970]
        form: length and channels of its episodes, as they were when the campaign was created.
    """

    id: int
    spec: CampaignSpec
    state: CampaignState
    counts: Counts
    created_ms: int
    started_ms: int | None = None
    ended_ms: int | None = None
    active_s: float = 0.0
    stopped_because: str = ""
    digest: str | None = None
    estimate: Estimate | None = None
    overhead: Overhead = Overhead()
    trained_episodes: int | None = None
    parts: tuple[RunPart, ...] = ()
    code: tuple[Versions, ...] = ()
    archived_ms: int | None = None
    form: EpisodeForm = EpisodeForm()

    @property
    def is_mixed(self) -> bool:
        """True if services of other versions took the campaign over after its first results."""
        return any(part.results for part in self.parts)

    @property
    def is_errored(self) -> bool:
        """True if the campaign is done and every episode of it errored."""
        return self.state_word == ERRORED

    @property
    def state_word(self) -> str:
        """The state as shown to users: "errored" if the campaign is done without a result."""
        return state_word(self.state, self.counts)


class CampaignFilter(msgspec.Struct, frozen=True):
    """Conditions on a campaign; None for no condition.

    Attributes:
        method: name of the method.
        search: text that its name contains; case does not matter.
        besides: a method whose campaigns are left out.
        state: its state.
        suite: the suite that it belongs to.
        project: the project that it belongs to.
        tag: one of its tags.
        planner_version: version of its planner.
        archived: whether it is archived.
    """

    method: str | None = None
    search: str | None = None
    besides: str | None = None
    state: CampaignState | None = None
    suite: str | None = None
    project: str | None = None
    tag: str | None = None
    planner_version: str | None = None
    archived: bool | None = None


ANY_CAMPAIGN = CampaignFilter()
