"""Campaigns, as a client sees them."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import msgspec

from eigenfail.client.link import Link
from eigenfail.client.waiting import wait_until
from eigenfail.errors import InvalidValue
from eigenfail.values import (
    FINAL_STATES,
    Campaign,
    CampaignCost,
    CampaignSpec,
    CampaignState,
    Comparison,
    Course,
    MinimalFailure,
    Page,
    Region,
    Safety,
    StopRules,
    Summary,
)
from eigenfail.values.records import EpisodeDetail
from eigenfail.values.safety import LEVEL
from eigenfail.variations import drawn_for
from eigenfail.wire.http import Digest, read_fields

AT_REST = FINAL_STATES | {CampaignState.PAUSED}

SHRINK_WITHIN = 2_000
"""Replays that are enough to shrink a failure of a hundred steps, as a rule."""

MAX_NAME = 200


class Campaigns:
    """Create, follow and steer campaigns.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def create(self, spec: CampaignSpec | None = None, **fields: Any) -> Campaign:
        """A new campaign, queued.

        Args:
            spec: all of it; or give its fields by name.
            fields: of a CampaignSpec, as structs or plain data.

        Raises:
            UnknownName: a field, plug-in, setting or parameter that does not exist.
            InvalidValue: a value outside its bounds.
        """
        wanted = spec or read_fields(fields, CampaignSpec)
        return self._link.post_once_only("/campaigns", Campaign, wanted)

    def get(self, campaign: int) -> Campaign:
        """The campaign as it stands.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"/campaigns/{campaign}", Campaign)

    def list(self, state: CampaignState | str | None = None) -> Iterator[Campaign]:
        """All campaigns, or those in a state; newest first."""
        return self._link.pages("/campaigns", Page[Campaign], "before", {"state": state})

    def pause(self, campaign: int) -> Campaign:
        """Let it rest once the rounds at work are in.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has ended.
        """
        return self._link.post(f"/campaigns/{campaign}/pause", Campaign)

    def resume(self, campaign: int) -> Campaign:
        """Let it go on.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it is not paused.
        """
        return self._link.post(f"/campaigns/{campaign}/resume", Campaign)

    def cancel(self, campaign: int) -> Campaign:
        """End it; finished episodes are kept.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has ended otherwise.
        """
        return self._link.post(f"/campaigns/{campaign}/cancel", Campaign)

    def wait(
        self,
        campaign: int,
        on_progress: Callable[[Campaign], None] | None = None,
        poll_s: float = 0.3,
        timeout_s: float | None = None,
    ) -> Campaign:
        """The campaign once it has ended or is paused.

        Args:
            campaign: its id.
            on_progress: told of the campaign at every look, the last one included.
            poll_s: time between two looks.
            timeout_s: give up after this time; None waits for ever.

        Raises:
            NotFound: no such campaign.
            ServiceError: it did not end in time; it goes on all the same.
        """

        def look() -> Campaign:
            seen = self.get(campaign)
            if on_progress is not None:
                on_progress(seen)
            return seen

        return wait_until(look, lambda seen: seen.state in AT_REST, poll_s, timeout_s)

    def summary(self, campaign: int) -> Summary:
        """Failures, rate, likelihood and cost so far.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"/campaigns/{campaign}/summary", Summary)

    def summaries(self) -> Iterator[Summary]:
        """The summaries of all campaigns, newest first."""
        return self._link.pages("/campaigns/summaries", Page[Summary], "before")

    def course(self, campaign: int, per: int | None = None) -> Course:
        """Failure rate, likelihood and robustness by blocks of episodes, so far.

        Args:
            campaign: its id.
            per: episodes of a block; None chooses by the budget.

        Raises:
            NotFound: no such campaign.
            InvalidValue: so short blocks would be too many.
        """
        return self._link.get(f"/campaigns/{campaign}/course", Course, {"per": per})

    def safety(self, campaign: int, level: float = LEVEL) -> Safety:
        """Collisions, near misses, MinTTC, DRAC and severity of the episodes so far.

        Args:
            campaign: its id.
            level: of VaR and CVaR of severity, between 0 and 1.

        Raises:
            NotFound: no such campaign.
            InvalidValue: the level is outside its bounds.
        """
        return self._link.get(f"/campaigns/{campaign}/safety", Safety, {"level": str(level)})

    def cost(self, campaign: int) -> CampaignCost:
        """What failures and modes cost so far, by when, and what the time went into.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"/campaigns/{campaign}/cost", CampaignCost)

    def region(self, campaigns: int | Sequence[int]) -> Region:
        """Where among the scenario's parameters the episodes so far fail.

        Args:
            campaigns: one whose parameters vary, or several on one scenario, such as a grid's.

        Raises:
            NotFound: no such campaign.
            InvalidValue: none is named, one twice, or they are on different scenarios.
            UnknownName: the service does not have their scenario.
        """
        return self._link.get("/campaigns/region", Region, {"campaigns": listed(campaigns)})

    def compare(self, a: int | Sequence[int], b: int | Sequence[int]) -> Comparison:
        """Two campaigns side by side, or two groups of them that differ in their seeds alone.

        Raises:
            NotFound: no such campaign.
            InvalidValue: a side without a campaign, or a campaign that is named twice.
        """
        return self._link.get("/comparisons", Comparison, {"a": listed(a), "b": listed(b)})

    def shrink(self, campaign: int, episode: int, episodes: int = SHRINK_WITHIN) -> Campaign:
        """A new campaign that finds out how little noise a failure needs; see `minimal`.

        It runs in the scenario that the episode drew, where its campaign drew one.

        Args:
            campaign: of the failure.
            episode: its index.
            episodes: the budget of replays.

        Raises:
            NotFound: no such campaign, or the episode has no result.
            InvalidValue: the episode did not end in a collision.
        """
        spec = self.get(campaign).spec
        failure = self._link.get(f"/campaigns/{campaign}/episodes/{episode}", EpisodeDetail)
        wanted = msgspec.structs.replace(
            spec,
            name=f"{spec.name}: minimal failure of {campaign}/{episode}"[-MAX_NAME:],
            method="minimal",
            settings={"campaign": campaign, "episode": episode},
            episodes=episodes,
            stop=StopRules(),
            scenario_parameters={**spec.scenario_parameters, **drawn_for(spec, failure.seed)},
        )
        return self.create(wanted)

    def minimal(self, campaign: int) -> MinimalFailure:
        """How little noise a failure needs, so far: of a campaign of the method `minimal`.

        Raises:
            NotFound: no such campaign.
            Conflict: it shrinks no failure, or no replay of it has failed.
        """
        return self._link.get(f"/campaigns/{campaign}/minimal", MinimalFailure)

    def digest(self, campaign: int) -> str:
        """SHA-256 over the results that are in: equal for equal campaigns.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"/campaigns/{campaign}/digest", Digest).digest


def listed(campaigns: int | Sequence[int]) -> str:
    """Ids as a request names them.

    Raises:
        InvalidValue: there is none.
    """
    ids = [campaigns] if isinstance(campaigns, int) else campaigns
    if not ids:
        raise InvalidValue("campaigns", "none is named.", "Name at least one.")
    return ",".join(map(str, ids))
