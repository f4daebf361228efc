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
        """A new campaign, queued.

        Args:
            spec: all of it; or give its fields by name.
            fields: fields of a CampaignSpec, as values or plain data; type checkers know them.

        Raises:
            UnknownName: a field, plug-in, setting or parameter that does not exist.
            InvalidValue: a value outside its bounds, or fields beside a whole specification.
        """
        refuse_fields_beside("spec", spec, fields)
        wanted = spec or http.read_fields(fields, CampaignSpec)
        return self._link.post_once_only("/campaigns", Campaign, wanted)

    def create_many(
        self, specs: Sequence[CampaignSpec | Mapping[str, Any]], key: str | None = None
    ) -> tuple[Campaign, ...]:
        """Many new campaigns, queued in this order: all of them, or none.

        Args:
            specs: at most `MOST_AT_ONCE`.
            key: idempotency key of this request, for ever; None makes one for this call.

        Raises:
            UnknownName: one has a field, plug-in or setting that does not exist: `[2].settings`.
            InvalidValue: one has a value that cannot be; or there are none, or too many.
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
        """What a campaign would be, or everything that is wrong with it; nothing is launched.

        Args:
            spec: all of it; or give its fields by name.
            fields: fields of a CampaignSpec, as structs or plain data.

        Raises:
            InvalidValue: fields are given beside a whole specification.
        """
        refuse_fields_beside("spec", spec, fields)
        return self._link.post(
            "/campaigns/check", http.CampaignCheck, spec or http.make_plain(fields)
        )

    def clone(self, campaign: CampaignLike, **changes: Unpack[CampaignChanges]) -> Campaign:
        """A new campaign like an earlier one, queued.

        Args:
            campaign: the earlier one, or its id.
            changes: fields of a CampaignSpec that are to be other than there. Settings and
                parameters are put over the earlier ones, unless their plug-in is another one.

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
        """A new campaign that finds out how little noise a failure needs; see `minimal`.

        It runs in the scenario that the episode drew, where its campaign drew one.

        Args:
            campaign: campaign of the failure, or its id; or the failure itself.
            episode: the failure, or its index; None if `campaign` is the failure.
            episodes: the budget of replays.

        Raises:
            NotFound: no such campaign, or the episode has no result.
            InvalidValue: the episode did not end in a collision.
        """
        path = f"{locate_episode(*find_episode_id(campaign, episode))}/shrink"
        return self._link.post_once_only(path, Campaign, http.ShrinkRequest(episodes))

    def get(self, campaign: CampaignLike) -> Campaign:
        """The campaign as it stands.

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
            state: state in which the campaigns are.
            suite: suite to which the campaigns belong.
            method: name of the method.
            search: text that their names hold, in small or large letters.
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
        """Let it rest once the rounds at work are in.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has ended.
        """
        return self._link.post(f"{locate_campaign(campaign)}/pause", Campaign)

    def resume(self, campaign: CampaignLike) -> Campaign:
        """Let it go on.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it is not paused.
        """
        return self._link.post(f"{locate_campaign(campaign)}/resume", Campaign)

    def cancel(self, campaign: CampaignLike) -> Campaign:
        """End it; finished episodes are kept.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has ended otherwise.
        """
        return self._link.post(f"{locate_campaign(campaign)}/cancel", Campaign)

    def archive(self, campaign: CampaignLike) -> Campaign:
        """Archive a campaign that has ended: lists omit it, and nothing of it is deleted.

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
        """Give it another priority, low, normal or high, from now on; its episodes stay the same.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has ended.
            InvalidValue: there is no such priority.
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
        """The campaign once it has ended or is paused.

        A campaign of which every episode errored ends, too; its `is_errored` is then true.

        Args:
            campaign: the campaign, or its id.
            on_progress: called with the campaign after every poll, the last one included.
            poll_s: time between two looks.
            timeout_s: give up after this time; None waits for ever.
            progress: show failures, rate and the time to go: a bar in a terminal or a notebook,
                plain lines on standard error elsewhere.

        Raises:
            NotFound: no such campaign.
            WaitTimeout: it did not end in time; it goes on all the same.
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
        """Failures, rate, likelihood and cost so far.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"{locate_campaign(campaign)}/summary", Summary)

    def summaries(self, *, archived: bool = False) -> Rows[Summary]:
        """The summaries of all campaigns, newest first.

        Args:
            archived: whether archived campaigns are among them.
        """
        asked = {"archived": _ask_archived(archived)}
        extent = Extent(partial(self._link.count, "/campaigns", asked))
        return self._link.pages("/campaigns/summaries", Page[Summary], "before", asked, extent)

    def course(self, campaign: CampaignLike, per: int | None = None) -> Course:
        """Failure rate, likelihood and robustness by blocks of episodes, so far.

        Args:
            campaign: the campaign, or its id.
            per: episodes of a block; None chooses by the budget.

        Raises:
            NotFound: no such campaign.
            InvalidValue: so short blocks would be too many.
        """
        return self._link.get(f"{locate_campaign(campaign)}/course", Course, {"per": per})

    def safety(self, campaign: CampaignLike, level: float = TAIL_LEVEL) -> Safety:
        """Collisions, near misses, MinTTC, DRAC and severity of the episodes so far.

        Args:
            campaign: the campaign, or its id.
            level: level of VaR and CVaR of severity, between 0 and 1.

        Raises:
            NotFound: no such campaign.
            InvalidValue: the level is outside its bounds.
        """
        return self._link.get(f"{locate_campaign(campaign)}/safety", Safety, {"level": str(level)})

    def prunings(self, campaign: CampaignLike) -> tuple[Pruning, ...]:
        """Return the prunings of its noise: by which rule, when, by whom, how much.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"{locate_campaign(campaign)}/prunings", Page[Pruning]).items

    def workers(self, campaign: CampaignLike) -> tuple[WorkerShare, ...]:
        """Who ran its episodes; who ran most comes first.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"{locate_campaign(campaign)}/workers", Page[WorkerShare]).items

    def costs_by_method(self) -> tuple[PeerCosts, ...]:
        """What a failure costs by method, over all campaigns of one planner and scenario.

        Those groups that have the newest campaigns come first.
        """
        return self._link.get("/costs", Page[PeerCosts]).items

    def cost(self, campaign: CampaignLike) -> CampaignCost:
        """What failures and modes cost so far, by when, and what the time went into.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"{locate_campaign(campaign)}/cost", CampaignCost)

    def compare(self, a: CampaignsLike, b: CampaignsLike) -> Comparison:
        """Two campaigns side by side, or two groups of them that differ in their seeds alone.

        Raises:
            NotFound: no such campaign.
            InvalidValue: a side without a campaign, or a campaign that is named twice.
        """
        return self._link.get("/comparisons", Comparison, {"a": _join_ids(a), "b": _join_ids(b)})

    def over_seeds(self, campaigns: CampaignsLike) -> tuple[SeedSpread, ...]:
        """Mean and spread of campaigns that differ in their seeds alone.

        Args:
            campaigns: campaigns or ids; those that differ in more are several groups, and a group
                with one seed or without a completed episode is left out.

        Raises:
            NotFound: no such campaign.
        """
        asked = {"campaigns": _join_ids(campaigns)}
        return self._link.get("/seeds", Page[SeedSpread], asked).items

    def minimal(self, campaign: CampaignLike) -> MinimalFailure:
        """How little noise a failure needs, so far: of a campaign of the method `minimal`.

        Raises:
            NotFound: no such campaign.
            Conflict: it shrinks no failure, or no replay of it has failed.
        """
        return self._link.get(f"{locate_campaign(campaign)}/minimal", MinimalFailure)

    def mixing(self, campaign: CampaignLike) -> ChainMixing:
        """How far the chains of a campaign of the method `chains` have mixed.

        Raises:
            NotFound: no such campaign.
            Conflict: it has no chains, or none has started.
        """
        return self._link.get(f"{locate_campaign(campaign)}/mixing", ChainMixing)

    def digest(self, campaign: CampaignLike) -> str:
        """SHA-256 over the results that are in: equal for equal campaigns.

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
