"""Campaigns, as a client sees them: created, followed, steered and judged."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Unpack, overload

from eigenfail.client.fields import CampaignChanges, CampaignFields, refuse_fields_beside
from eigenfail.client.link import Extent, Link, report_progress, reverse_order, wait_until
from eigenfail.client.references import (
    CampaignLike,
    CampaignsLike,
    EpisodeLike,
    find_campaign_ids,
    find_episode_id,
    locate_campaign,
    locate_episode,
)
from eigenfail.filters import NEWEST_FIRST, parse_campaign_sort
from eigenfail.values.analysis import MinimalFailure
from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec, Priority, PriorityChange
from eigenfail.values.comparison import Comparison, PeerCosts
from eigenfail.values.estimates import ChainMixing
from eigenfail.values.operations import Pruning, WorkerShare
from eigenfail.values.records import Page
from eigenfail.values.rows import Rows
from eigenfail.values.safety import TAIL_LEVEL, Safety
from eigenfail.values.seeds import SeedSpread
from eigenfail.values.summary import CampaignCost, Course, Summary
from eigenfail.wire import http

# A paused campaign goes on only if somebody says so: a wait for its end would be without end.
AT_REST = FINAL_STATES | {CampaignState.PAUSED}


class Campaigns:
    """Create, follow, steer and judge campaigns.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    @overload
    def create(self, spec: CampaignSpec) -> Campaign: ...

    @overload
    def create(self, **fields: Unpack[CampaignFields]) -> Campaign: ...

    def create(self, spec: CampaignSpec | None = None, **fields: Any) -> Campaign:
        """Queue and return a new campaign.

        Args:
            spec: the whole specification; or give its fields by name.
            fields: fields of a CampaignSpec, as values or plain data; type checkers check them.

        Raises:
            UnknownName: a field, plug-in, setting or parameter that does not exist.
            InvalidValue: a value outside its bounds, or fields together with `spec`.
        """
        refuse_fields_beside("spec", spec, fields)
        wanted = spec or http.read_fields(fields, CampaignSpec)
        return self._link.post_once_only("/campaigns", Campaign, wanted)

    def create_many(
        self, specs: Sequence[CampaignSpec | Mapping[str, Any]], key: str | None = None
    ) -> tuple[Campaign, ...]:
        """Queue many new campaigns in this order, all of them or none, and return them.

        Args:
            specs: at most `MOST_AT_ONCE`.
            key: permanent idempotency key of this request; None makes one for this call.

        Raises:
            UnknownName: one has a field, plug-in or setting that does not exist: `[2].settings`.
            InvalidValue: one has an invalid value, or `specs` is empty or too long.
        """
        wanted = [
            # Plain data is sent as it is: the service alone knows the defaults of its plug-ins.
            http.make_plain(spec, f"[{place}].") if isinstance(spec, Mapping) else spec
            for place, spec in enumerate(specs)
        ]
        return self._link.post_once_only("/campaigns/bulk", Page[Campaign], wanted, key).items

    def check(
        self, spec: CampaignSpec | None = None, **fields: Unpack[CampaignChanges]
    ) -> http.CampaignCheck:
        """Return the full specification of a campaign, or all of its problems, without a launch.

        Args:
            spec: the whole specification; or give its fields by name.
            fields: fields of a CampaignSpec, as structs or plain data.

        Raises:
            InvalidValue: fields are given together with `spec`.
        """
        refuse_fields_beside("spec", spec, fields)
        return self._link.post(
            "/campaigns/check", http.CampaignCheck, spec or http.make_plain(fields)
        )

    def clone(self, campaign: CampaignLike, **changes: Unpack[CampaignChanges]) -> Campaign:
        """Queue and return a new campaign like an earlier one.

        Args:
            campaign: the earlier campaign, or its id.
            changes: fields of a CampaignSpec that differ from the earlier campaign. Settings and
                parameters are merged into the earlier ones, unless their plug-in changes.

        Raises:
            NotFound: no such campaign.
            UnknownName: a field, plug-in, setting or parameter that does not exist.
            InvalidValue: a value outside its bounds.
        """
        return self._link.post_once_only(
            f"{locate_campaign(campaign)}/clone", Campaign, http.make_plain(changes)
        )

    def shrink(
        self,
        campaign: CampaignLike,
        episode: EpisodeLike | None = None,
        episodes: int = http.SHRINK_WITHIN,
    ) -> Campaign:
        """Queue and return a new campaign that minimises the noise of a failure; see `minimal`.

        It runs in the scenario that the episode drew, if its campaign draws scenarios.

        Args:
            campaign: campaign of the failure, or its id; or the failure itself.
            episode: the failure, or its index; None if `campaign` is the failure.
            episodes: the budget of replays.

        Raises:
            NotFound: no such campaign, or no result of the episode.
            InvalidValue: the episode did not end in a collision.
        """
        path = f"{locate_episode(*find_episode_id(campaign, episode))}/shrink"
        return self._link.post_once_only(path, Campaign, http.ShrinkRequest(episodes))

    def get(self, campaign: CampaignLike) -> Campaign:
        """Return the campaign in its present state.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(locate_campaign(campaign), Campaign)

    def list(  # noqa: PLR0913 - each of them is a filter that users know by its name
        self,
        state: CampaignState | str | None = None,
        suite: str | None = None,
        method: str | None = None,
        search: str | None = None,
        *,
        sort: str = str(NEWEST_FIRST),
        project: str | None = None,
        tag: str | None = None,
        planner_version: str | None = None,
        archived: bool = False,
    ) -> Rows[Campaign]:
        """List campaigns that match all given filters, in an order.

        Args:
            state: state of the campaigns.
            suite: suite of the campaigns.
            method: name of the method.
            search: text that their names contain, in small or large letters.
            sort: id, name, planner, method, state, failures, completed or cost_per_failure_usd;
                with a minus, the largest first.
            project: project of the campaigns.
            tag: one of the tags of the campaigns.
            planner_version: version of the planner under test, as the campaigns state it.
            archived: whether archived campaigns are listed, too.

        Raises:
            UnknownName: campaigns cannot be sorted by it.
        """
        order = str(parse_campaign_sort(sort))
        asked = {
            "state": state,
            "suite": suite,
            "method": method,
            "search": search,
            "sort": order,
            "project": project,
            "tag": tag,
            "planner_version": planner_version,
            "archived": _ask_archived(archived),
        }
        reverse = reverse_order(asked, parse_campaign_sort(sort), "id")
        # `len()` and the last rows of a list need no page of it in between.
        extent = Extent(partial(self._link.count, "/campaigns", asked), reverse)
        return self._link.pages("/campaigns", Page[Campaign], "before", asked, extent)

    def pause(self, campaign: CampaignLike) -> Campaign:
        """Pause a campaign as soon as its running rounds have ended.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has ended.
        """
        return self._link.post(f"{locate_campaign(campaign)}/pause", Campaign)

    def resume(self, campaign: CampaignLike) -> Campaign:
        """Resume a paused campaign.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it is not paused.
        """
        return self._link.post(f"{locate_campaign(campaign)}/resume", Campaign)

    def cancel(self, campaign: CampaignLike) -> Campaign:
        """Cancel a campaign; finished episodes are kept.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has ended in another way.
        """
        return self._link.post(f"{locate_campaign(campaign)}/cancel", Campaign)

    def archive(self, campaign: CampaignLike) -> Campaign:
        """Archive a campaign that has ended: lists omit it, but nothing is deleted.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has not ended.
        """
        return self._link.post(f"{locate_campaign(campaign)}/archive", Campaign)

    def restore(self, campaign: CampaignLike) -> Campaign:
        """List an archived campaign again.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.post(f"{locate_campaign(campaign)}/restore", Campaign)

    def prioritise(self, campaign: CampaignLike, priority: Priority | str) -> Campaign:
        """Change the priority to low, normal or high; the episodes stay the same.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has ended.
            InvalidValue: unknown priority.
        """
        change = http.read_fields({"priority": priority}, PriorityChange)
        return self._link.post(f"{locate_campaign(campaign)}/priority", Campaign, change)

    def wait(
        self,
        campaign: CampaignLike,
        on_progress: Callable[[Campaign], None] | None = None,
        poll_s: float = 0.3,
        timeout_s: float | None = None,
        progress: bool = False,
    ) -> Campaign:
        """Wait until a campaign has ended or is paused, and return it.

        A campaign also ends if every episode errored; its `is_errored` is then true.

        Args:
            campaign: the campaign, or its id.
            on_progress: called with the campaign after every poll, including the last.
            poll_s: time between two polls.
            timeout_s: time limit; None waits forever.
            progress: show failures, rate and remaining time: as a bar in a terminal or a notebook,
                as plain lines on standard error elsewhere.

        Raises:
            NotFound: no such campaign.
            WaitTimeout: it did not end in time; it continues to run.
        """
        with report_progress(on_progress, progress) as tell:

            def look() -> Campaign:
                seen = self.get(campaign)
                tell(seen)
                return seen

            return wait_until(
                look, lambda seen: seen.state in AT_REST, poll_s, timeout_s, _describe_progress
            )

    def summary(self, campaign: CampaignLike) -> Summary:
        """Return failures, rate, likelihood and cost so far.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"{locate_campaign(campaign)}/summary", Summary)

    def summaries(self, *, archived: bool = False) -> Rows[Summary]:
        """List the summaries of all campaigns, newest first.

        Args:
            archived: whether archived campaigns are included.
        """
        asked = {"archived": _ask_archived(archived)}
        extent = Extent(partial(self._link.count, "/campaigns", asked))
        return self._link.pages("/campaigns/summaries", Page[Summary], "before", asked, extent)

    def course(self, campaign: CampaignLike, per: int | None = None) -> Course:
        """Return failure rate, likelihood and robustness so far, by blocks of episodes.

        Args:
            campaign: the campaign, or its id.
            per: episodes per block; None chooses by the budget.

        Raises:
            NotFound: no such campaign.
            InvalidValue: blocks of this length would be too many.
        """
        return self._link.get(f"{locate_campaign(campaign)}/course", Course, {"per": per})

    def safety(self, campaign: CampaignLike, level: float = TAIL_LEVEL) -> Safety:
        """Return collisions, near misses, MinTTC, DRAC and severity of the episodes so far.

        Args:
            campaign: the campaign, or its id.
            level: level of VaR and CVaR of severity, between 0 and 1.

        Raises:
            NotFound: no such campaign.
            InvalidValue: the level is outside its bounds.
        """
        return self._link.get(f"{locate_campaign(campaign)}/safety", Safety, {"level": str(level)})

    def prunings(self, campaign: CampaignLike) -> tuple[Pruning, ...]:
        """Return each pruning of the campaign's noise: its rule, time, user and amount.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"{locate_campaign(campaign)}/prunings", Page[Pruning]).items

    def workers(self, campaign: CampaignLike) -> tuple[WorkerShare, ...]:
        """Return the workers that ran the campaign's episodes, the busiest first.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"{locate_campaign(campaign)}/workers", Page[WorkerShare]).items

    def costs_by_method(self) -> tuple[PeerCosts, ...]:
        """Return the cost per failure by method, for each group of one planner and scenario.

        Groups with the newest campaigns come first.
        """
        return self._link.get("/costs", Page[PeerCosts]).items

    def cost(self, campaign: CampaignLike) -> CampaignCost:
        """Return the cost of failures and modes so far, its course, and the use of the time.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"{locate_campaign(campaign)}/cost", CampaignCost)

    def compare(self, a: CampaignsLike, b: CampaignsLike) -> Comparison:
        """Compare two campaigns, or two groups of campaigns that differ only in their seeds.

        Raises:
            NotFound: no such campaign.
            InvalidValue: a side without a campaign, or a campaign that is named twice.
        """
        return self._link.get("/comparisons", Comparison, {"a": _join_ids(a), "b": _join_ids(b)})

    def over_seeds(self, campaigns: CampaignsLike) -> tuple[SeedSpread, ...]:
        """Return mean and spread of campaigns that differ only in their seeds.

        Args:
            campaigns: campaigns or ids. Campaigns that differ in more form several groups; a group
                with one seed or without a completed episode is left out.

        Raises:
            NotFound: no such campaign.
        """
        asked = {"campaigns": _join_ids(campaigns)}
        return self._link.get("/seeds", Page[SeedSpread], asked).items

    def minimal(self, campaign: CampaignLike) -> MinimalFailure:
        """Return the least noise found so far that still fails, for the method `minimal`.

        Raises:
            NotFound: no such campaign.
            Conflict: the campaign does not shrink a failure, or none of its replays has failed.
        """
        return self._link.get(f"{locate_campaign(campaign)}/minimal", MinimalFailure)

    def mixing(self, campaign: CampaignLike) -> ChainMixing:
        """Return how far the chains of a campaign have mixed, for the method `chains`.

        Raises:
            NotFound: no such campaign.
            Conflict: the campaign is without chains, or none has started.
        """
        return self._link.get(f"{locate_campaign(campaign)}/mixing", ChainMixing)

    def digest(self, campaign: CampaignLike) -> str:
        """Return the SHA-256 over the results so far; equal campaigns have equal digests.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"{locate_campaign(campaign)}/digest", http.Digest).digest


def _describe_progress(campaign: Campaign) -> str:
    counts = campaign.counts
    done = f"{counts.completed} of {counts.planned} episodes completed"
    return f"Campaign {campaign.id} ({campaign.spec.name}; {campaign.state}, {done})"


def _ask_archived(archived: bool) -> str | None:
    return "true" if archived else None


def _join_ids(campaigns: CampaignsLike) -> str:
    return ",".join(map(str, find_campaign_ids(campaigns)))
