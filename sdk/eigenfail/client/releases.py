"""Releases, as a client sees them: versions of a planner and their failure modes."""

from eigenfail.client.link import Link
from eigenfail.client.references import CampaignLike, find_campaign_id
from eigenfail.values.records import Page
from eigenfail.values.release import ReleaseQuestion, ReleaseTable


class Releases:
    """Compare the versions of a planner, failure mode by failure mode.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def list(self, project: str | None = None) -> tuple[ReleaseQuestion, ...]:
        """The scenarios in which versions of a planner were tested, the newest first.

        Args:
            project: project that the campaigns belong to; None: any.
        """
        asked = {} if project is None else {"project": project}
        return self._link.get("/releases", Page[ReleaseQuestion], asked).items

    def get(self, campaign: CampaignLike) -> ReleaseTable:
        """The versions tested as in a campaign, with what became of each failure mode.

        Args:
            campaign: a campaign, or its id, that names the version of its planner.

        Raises:
            NotFound: no such campaign, or it names no version.
        """
        return self._link.get(f"/releases/{find_campaign_id(campaign)}", ReleaseTable)
