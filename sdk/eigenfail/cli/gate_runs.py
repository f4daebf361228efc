"""What a gate runs on a service, and how it reads what came of it."""

from collections.abc import Mapping

from eigenfail.cli.gate_analyses import analysed_together
from eigenfail.cli.gate_baseline import Found, find_baseline
from eigenfail.cli.gate_known import Known, KnownFailures, rows
from eigenfail.cli.options import DEFAULT_URL
from eigenfail.cli.places import Place
from eigenfail.cli.together import run_together
from eigenfail.client import Client
from eigenfail.errors import ServiceError
from eigenfail.gate.found import By, Finding, Rerun
from eigenfail.gate.known import of_known
from eigenfail.gate.modes import asks_for_modes, with_modes
from eigenfail.gate.report import Gate, GateReport, MemberReport, report
from eigenfail.gate.reruns import Side, figures, rerun
from eigenfail.gate.verdicts import Outcomes
from eigenfail.gate.versions import at_version, check_baseline
from eigenfail.suites import Member, Suite
from eigenfail.values import Campaign, CampaignState, Outcome
from eigenfail.values.records import EpisodeRow

Campaigns = Mapping[str, Campaign]


class Runner:
    """Runs gates on a service.

    Args:
        client: of the service.
        place: where it is.
        command: what goes on with the gate after Ctrl-C.
    """

    def __init__(self, client: Client, place: Place, command: str) -> None:
        self._client = client
        self._place = place
        self._command = command
        self._known = KnownFailures(client, place)
        # A service of our own is gone once this is read; one started anew has the usual address.
        self._pages = DEFAULT_URL if place.again else place.url

    def run(self, suite: Suite, gate: Gate) -> GateReport:
        """Run what is missing, and judge it.

        Raises:
            InvalidValue: the baseline is not there, or asks something else of its planner.
            Conflict: it is not done.
            ServiceError: a campaign came to nothing.
        """
        gated = at_version(suite, gate.version)
        if not gate.baseline:
            self._together(gated)
        before = find_baseline(self._client, gated, gate)
        check_baseline(gated, before, gate.baseline or gate.run)
        judged = tuple(member for member in gated.members if member.name in before)
        known = {each.name: self._known.of(gate.run, each, before[each.name]) for each in judged}
        replays = [replay.now.member for each in known.values() for replay in each.replays]
        now = self._together(Suite(gate.run, (*judged, *replays)))
        members = [self._member(each, before, known, now, gate.by) for each in gated.members]
        return report(gate, members)

    def _together(self, suite: Suite) -> Campaigns:
        """The campaigns of a suite by the names of its members, all of them done."""
        ended = run_together(self._client, suite, self._place.check, self._command)
        for campaign in ended:
            require_done(campaign)
        return {each.name: found for each, found in zip(suite.members, ended, strict=True)}

    def _member(
        self, member: Member, before: Found, known: Mapping[str, Known], now: Campaigns, by: By
    ) -> MemberReport:
        """What became of a member."""
        if member.name not in before:
            return MemberReport(member=member.name, notes=("It is not in the baseline.",))
        was, is_now, ours = before[member.name], now[member.name], known[member.name]
        return MemberReport(
            member=member.name,
            baseline=figures(was),
            known=self._findings(ours, now),
            rerun=None if was.id == is_now.id else self._rerun(was, is_now, by),
            notes=ours.notes,
        )

    def _findings(self, known: Known, now: Campaigns) -> tuple[Finding, ...]:
        """What became of the known failures of a member."""
        return tuple(
            finding
            for replay in known.replays
            for finding in of_known(
                self._known.proven(replay),
                rows(self._client, now[replay.now.member.name]),
                self._pages,
            )
        )

    def _rerun(self, was: Campaign, now: Campaign, by: By) -> Rerun:
        """What became of a campaign that was run again."""
        comparison = self._client.campaigns.compare(was.id, now.id)
        side = self._side(now)
        judged = rerun(self._side(was), side, comparison, self._pages, by)
        if not asks_for_modes(judged):
            return judged
        together = analysed_together(self._client, self._place, was.id, now.id)
        return with_modes(judged, together, side, self._pages)

    def _side(self, campaign: Campaign) -> Side:
        """A campaign with what came of its episodes."""
        counts = campaign.counts
        outcomes = Outcomes(
            episodes=counts.completed + counts.failed,
            collisions=self._of_outcome(campaign, Outcome.COLLISION),
            failed=self._of_outcome(campaign, Outcome.FAILED),
        )
        return Side(campaign, outcomes)

    def _of_outcome(self, campaign: Campaign, outcome: Outcome) -> dict[int, EpisodeRow]:
        """The episodes that ended like this, by index."""
        return {row.index: row for row in self._client.episodes.list(campaign.id, outcome)}


def require_done(campaign: Campaign) -> None:
    """Raises ServiceError if a campaign ended early, so that no gate may open on it."""
    if campaign.state is not CampaignState.DONE:
        raise ServiceError(
            f"Campaign {campaign.id} is {campaign.state}, so its gate proves nothing."
            f" {campaign.stopped_because}".rstrip(),
            f"See why: eigenfail campaign show {campaign.id};"
            " to start anew, give another --planner-version.",
        )
