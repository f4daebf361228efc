"""Versions of a planner, as a client sees them: their comparison, and results of gates."""

from eigenfail.client.link import Link
from eigenfail.client.references import CampaignLike, find_campaign_id
from eigenfail.gate.report import GateReport
from eigenfail.gate.results import GateResult, GateSummary, shorten_report
from eigenfail.values.records import Page
from eigenfail.values.release import ReleaseQuestion, ReleaseTable
from eigenfail.values.rows import Rows


class Releases:
    """Compare the versions of a planner, failure mode by failure mode.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def list(self, project: str | None = None) -> tuple[ReleaseQuestion, ...]:
        """List the scenarios that versions of a planner were tested in, newest first.

        Args:
            project: project of the campaigns; None: any.
        """
        asked = {} if project is None else {"project": project}
        return self._link.get("/releases", Page[ReleaseQuestion], asked).items

    def get(self, campaign: CampaignLike) -> ReleaseTable:
        """Return the versions tested in a campaign's setup, with the fate of each failure mode.

        Args:
            campaign: a campaign, or its id; it must name the version of its planner.

        Raises:
            NotFound: no such campaign, or it names no version.
        """
        return self._link.get(f"/releases/{find_campaign_id(campaign)}", ReleaseTable)


class Gates:
    """Read the results of gates, and report new ones.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def list(self) -> Rows[GateSummary]:
        """List the results of gates, newest first, without their reports."""
        return self._link.pages("/gates", Page[GateSummary], "before")

    def get(self, gate: int | GateSummary) -> GateResult:
        """Return the result of a gate, with its report.

        Args:
            gate: id of the result, or its line in the list.

        Raises:
            NotFound: no such result.
        """
        # As of campaigns, the line of a list stands for its id.
        number = gate.id if isinstance(gate, GateSummary) else gate
        return self._link.get(f"/gates/{number}", GateResult)

    def record(self, report: GateReport) -> GateSummary:
        """Store the report of a gate, and log its verdict.

        `eigenfail gate` calls it. A report that is sent again is stored once. A report that is too
        large is shortened by `shorten_report`.

        Raises:
            InvalidValue: the verdict does not follow from the members of the report.
            Forbidden: the key does not have the scope runner.
        """
        return self._link.post_once_only("/gates", GateSummary, shorten_report(report))
