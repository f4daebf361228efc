"""Campaigns as they are made: from a spec, many at once, or of an earlier one."""

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from eigenfail.client.link import Link
from eigenfail.values import Campaign, CampaignSpec, Page, StopRules
from eigenfail.values.campaign import LONGEST_NAME
from eigenfail.values.records import EpisodeDetail
from eigenfail.variations import drawn_for
from eigenfail.wire.drafts import CampaignCheck
from eigenfail.wire.http import read_fields

SHRINK_WITHIN = 2_000
"""Replays that are enough to shrink a failure of a hundred steps, as a rule."""


class CampaignMaking:
    """The verbs of `Campaigns` that make one."""

    _link: Link

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

    def create_many(
        self, specs: Sequence[CampaignSpec | Mapping[str, Any]], key: str | None = None
    ) -> tuple[Campaign, ...]:
        """Many new campaigns, queued in this order: all of them, or none.

        Args:
            specs: at most `MOST_AT_ONCE`.
            key: what tells this request from others, for ever; None makes one for this call.

        Raises:
            UnknownName: one has a field, plug-in or setting that does not exist: `[2].settings`.
            InvalidValue: one has a value that cannot be; or there are none, or too many.
        """
        return self._link.post_once_only("/campaigns/bulk", Page[Campaign], list(specs), key).items

    def check(self, spec: CampaignSpec | None = None, **fields: Any) -> CampaignCheck:
        """What a campaign would be, or everything that is wrong with it; nothing is launched.

        Args:
            spec: all of it; or give its fields by name.
            fields: of a CampaignSpec, as structs or plain data.
        """
        return self._link.post("/campaigns/check", CampaignCheck, spec or fields)

    def clone(self, campaign: int, **changes: Any) -> Campaign:
        """A new campaign like an earlier one, queued.

        Args:
            campaign: the earlier one.
            changes: fields of a CampaignSpec that are to be other than there. Settings and
                parameters are put over the earlier ones, unless their plug-in is another one.

        Raises:
            NotFound: no such campaign.
            UnknownName: a field, plug-in, setting or parameter that does not exist.
            InvalidValue: a value outside its bounds.
        """
        return self._link.post_once_only(f"/campaigns/{campaign}/clone", Campaign, changes)

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
        spec = self._link.get(f"/campaigns/{campaign}", Campaign).spec
        failure = self._link.get(f"/campaigns/{campaign}/episodes/{episode}", EpisodeDetail)
        wanted = msgspec.structs.replace(
            spec,
            name=f"{spec.name}: minimal failure of {campaign}/{episode}"[-LONGEST_NAME:],
            method="minimal",
            settings={"campaign": campaign, "episode": episode},
            episodes=episodes,
            stop=StopRules(),
            scenario_parameters={**spec.scenario_parameters, **drawn_for(spec, failure.seed)},
        )
        return self.create(wanted)
