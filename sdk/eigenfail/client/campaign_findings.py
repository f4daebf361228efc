"""What came of campaigns: failures, likelihood, safety and cost."""

from collections.abc import Sequence

from eigenfail.client.link import Link
from eigenfail.errors import InvalidValue
from eigenfail.rows import Rows
from eigenfail.values import (
    CampaignCost,
    Comparison,
    Course,
    MinimalFailure,
    Page,
    Region,
    Safety,
    Summary,
)
from eigenfail.values.pool import PeerCosts
from eigenfail.values.retention import Pruning
from eigenfail.values.safety import LEVEL
from eigenfail.values.worker import WorkerShare
from eigenfail.wire.http import Digest


class CampaignFindings:
    """The verbs of `Campaigns` that tell what came of one, or of several."""

    _link: Link

    def summary(self, campaign: int) -> Summary:
        """Failures, rate, likelihood and cost so far.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"/campaigns/{campaign}/summary", Summary)

    def summaries(self) -> Rows[Summary]:
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

    def prunings(self, campaign: int) -> tuple[Pruning, ...]:
        """What noise was taken from it to make room: by which rule, when, by whom, how much.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"/campaigns/{campaign}/prunings", Page[Pruning]).items

    def workers(self, campaign: int) -> tuple[WorkerShare, ...]:
        """Who ran its episodes; who ran most comes first.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"/campaigns/{campaign}/workers", Page[WorkerShare]).items

    def costs_by_method(self) -> tuple[PeerCosts, ...]:
        """What a failure costs by method, over all campaigns of one planner and scenario.

        Those groups that have the newest campaigns come first.
        """
        return self._link.get("/costs", Page[PeerCosts]).items

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
