"""The campaigns of a gate: its baseline, the known failures, and what it runs on a service."""

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from itertools import chain
from typing import Any, NamedTuple

from eigenfail.cli.connection import Place
from eigenfail.cli.render import run_suite
from eigenfail.client import Client
from eigenfail.client.analyses import OVER
from eigenfail.client.link import wait_until
from eigenfail.errors import Conflict, InvalidValue, ServiceError
from eigenfail.gate import baselines
from eigenfail.gate import known as known_failures
from eigenfail.gate.report import GateReport, GateRun, MemberReport, build_report
from eigenfail.gate.reruns import Rerun, RerunSide, judge_rerun, read_figures
from eigenfail.gate.verdicts import RunOutcomes
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.progress import announce
from eigenfail.suites import Suite, SuiteMember
from eigenfail.values.analysis import Analysis, AnalysisSettings, AnalysisState
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import FAILURES, Outcome, episode_seed
from eigenfail.values.records import EpisodeRow
from eigenfail.values.scene import PEAK_BRAKING_MPS2
from eigenfail.values.suite import suite_of
from eigenfail.values.variation import KINDS
from eigenfail.worlds import drawn_for

POLL_S = 0.3


def find_or_run_analysis(client: Client, place: Place, campaign: int, *others: int) -> Analysis:
    """Return the first analysis of a campaign's failures that did not fail, once it has ended.

    Args:
        client: client of the service.
        place: where it is.
        campaign: campaign that is analysed.
        others: exactly the campaigns that are analysed with it.
    """
    wanted = AnalysisSettings(campaigns=others)
    alike = [
        each
        for each in client.analyses.list(campaign)
        # Alone, an analysis with other settings will do: its modes are replayed, not compared.
        if each.state is not AnalysisState.FAILED
        and (each.settings == wanted if others else not each.settings.campaigns)
    ]
    # The list begins with the newest. The first one is taken, so that a gate that is repeated says
    # the same, whatever was analysed since.
    analysis = alike[-1] if alike else client.analyses.create(campaign, wanted)

    def look() -> Analysis:
        place.check()
        return client.analyses.get(analysis.id)

    with announce(f"Analysing the failures of campaign {campaign}"):
        return wait_until(look, lambda each: each.state in OVER, POLL_S, None)


IDS = re.compile(r"[1-9]\d*(,[1-9]\d*)*")
FILE = ".toml"

Found = Mapping[str, Campaign]


def find_baseline(client: Client, suite: Suite, gate: GateRun) -> Found:
    """The campaign of each member of the suite, by the member's name; those that there are.

    The baseline may be named by the file of a suite that was run, by the name of a suite or of a
    run, by the version of one, or by campaigns' ids. If it is not named, it is this run itself.

    Raises:
        NotFound: no such campaign.
        InvalidValue: no such file, more than one campaign that could be a member's, or the very run
            that is to be judged.
    """
    run = gate.baseline
    if run in {gate.run, gate.version}:
        problem = f"'{run}' is the version under test itself."
        raise InvalidValue("baseline", problem, "Give another --planner-version, or no --baseline.")
    if not run:
        return _find_in_file(client, suite, suite)
    if run.endswith(FILE):
        return _find_in_file(client, suite, Suite.read(run))
    versions = run, baselines.name_run(gate.suite, run)
    found = next(filter(None, (_find_by_version(client, suite, each) for each in versions)), {})
    # A version may be a build number, a date or a hash without letters: versions are tried first.
    if not found and IDS.fullmatch(run):
        return _find_by_ids(client, suite, map(int, run.split(",")))
    return found


def _find_in_file(client: Client, suite: Suite, before: Suite) -> Found:
    """The campaigns of a suite with exactly this content."""
    wanted = {member.name for member in suite.members}
    pairs = zip(before.members, client.suites.find(before), strict=True)
    return {each.name: found for each, found in pairs if found and each.name in wanted}


def _find_by_ids(client: Client, suite: Suite, ids: Iterable[int]) -> Found:
    """Campaigns that were named one by one."""
    campaigns = [client.campaigns.get(campaign) for campaign in ids]
    found = {
        member.name: baselines.find_counterpart(member, campaigns, make_resolver(client))
        for member in suite.members
    }
    return {name: campaign for name, campaign in found.items() if campaign}


def _find_by_version(client: Client, suite: Suite, run: str) -> Found:
    """The newest campaigns of a run's name."""
    wanted = {f"{run}: {member.name}": member.name for member in suite.members}
    found: dict[str, Campaign] = {}
    for campaign in client.campaigns.list(suite=suite_of(next(iter(wanted))), archived=True):
        if name := wanted.pop(campaign.spec.name, None):
            found[name] = campaign
        if not wanted:
            break
    return found


def make_resolver(client: Client) -> baselines.Resolve:
    """Return what has the service write out the defaults of a spec, which it knows by its plug-ins.

    A spec that the service would refuse today is not changed.
    """

    def resolve(spec: CampaignSpec) -> CampaignSpec:
        return client.campaigns.check(spec).spec or spec

    return resolve


class GateReplay(NamedTuple):
    """Known failures injected into the new planner, and into the baseline's own."""

    now: known_failures.KnownReplay
    before: known_failures.KnownReplay


class BaselineFailures(NamedTuple):
    """The known failures of a member's baseline, and what keeps others from being known."""

    replays: tuple[GateReplay, ...] = ()
    notes: tuple[str, ...] = ()


def find_known_failures(
    client: Client, place: Place, run: str, member: SuiteMember, before: Campaign
) -> BaselineFailures:
    """Return the known failures of a baseline's campaign, which is analysed if it was not yet.

    Args:
        client: client of the service.
        place: where it is.
        run: the name of the run in which they are replayed.
        member: whose planner they are injected into.
        before: the campaign.
    """
    if not before.counts.failures:
        return BaselineFailures()
    given = before.spec.scenario_parameters.values()
    is_varied = any(isinstance(each, dict) and KINDS.keys() & each.keys() for each in given)
    if is_varied and not _find_drawn_parameters(before, 0):
        problem = f"scenario '{before.spec.scenario}' is not installed here."
        return BaselineFailures(notes=(f"Known failures are not replayed: {problem}",))
    analysis = find_or_run_analysis(client, place, before.id)
    shrunk: list[tuple[Campaign, int]] = []
    for campaign in client.campaigns.list(CampaignState.DONE, archived=True):
        if known_failures.is_minimal_search(campaign, before, analysis):
            with suppress(Conflict):  # what it shrank did not fail again
                shrunk.append((campaign, client.campaigns.minimal(campaign.id).index))

    def list_replays(under: known_failures.RunSettings) -> Iterator[known_failures.KnownReplay]:
        yield from known_failures.make_mode_replays(under, before, analysis)
        for campaign, index in shrunk:
            drawn = _find_drawn_parameters(campaign, index)
            yield known_failures.make_minimal_replay(under, campaign, index, drawn)

    old = known_failures.RunSettings(
        baselines.find_run(before, member), SuiteMember(member.name, before.spec)
    )
    both = zip(
        list_replays(known_failures.RunSettings(run, member)), list_replays(old), strict=True
    )
    notes = () if analysis.result else (f"It has no failure modes: {analysis.problem}",)
    return BaselineFailures(tuple(GateReplay(*each) for each in both), notes)


def _index_episodes(client: Client, campaign: Campaign) -> dict[int, EpisodeRow]:
    """The episodes of a campaign that have a result, by index."""
    return {row.index: row for row in client.episodes.list(campaign.id)}


def _find_drawn_parameters(campaign: Campaign, index: int) -> Mapping[str, Any]:
    """The scenario parameters that an episode drew, by name."""
    return drawn_for(campaign.spec, episode_seed(campaign.spec.seed, index))


Campaigns = Mapping[str, Campaign]


class Runner:
    """Runs gates on a service.

    Args:
        client: client of the service.
        place: where it is.
        command: what goes on with the gate after Ctrl-C.
    """

    def __init__(self, client: Client, place: Place, command: str) -> None:
        self._client = client
        self._place = place
        self._command = command
        # A service of our own is gone once this is read; one started anew has the usual address.
        self._pages = DEFAULT_URL if place.again else place.url

    def run(self, suite: Suite, gate: GateRun) -> GateReport:
        """Run the missing campaigns, and judge the results.

        Raises:
            InvalidValue: the baseline is not there, or asks something else of its planner.
            Conflict: it is not done.
            ServiceError: a campaign came to nothing.
        """
        client, place = self._client, self._place
        gated = baselines.select_version(suite, gate.version)
        if not gate.baseline:
            self._run_together(gated)
        before = find_baseline(client, gated, gate)
        baselines.check_baseline(gated, before, gate.baseline or gate.run, make_resolver(client))
        judged = tuple(member for member in gated.members if member.name in before)
        known = {
            each.name: find_known_failures(client, place, gate.run, each, before[each.name])
            for each in judged
        }
        replays = [replay.now.member for each in known.values() for replay in each.replays]
        now = self._run_together(Suite(gate.run, (*judged, *replays)))
        members = [
            self._judge_member(each, before[each.name], known[each.name], now, gate)
            if each.name in before
            else MemberReport(member=each.name, notes=("It is not in the baseline.",))
            for each in gated.members
        ]
        return build_report(gate, members)

    def _run_together(self, suite: Suite) -> Campaigns:
        """Return the campaigns of a suite by the names of its members, all of them done.

        Raises:
            ServiceError: a campaign ended early, so that no gate may open on it.
        """
        ended = run_suite(self._client, suite, self._place.check, self._command)
        for campaign in ended:
            if campaign.state is not CampaignState.DONE:
                raise ServiceError(
                    f"Campaign {campaign.id} is {campaign.state}, so its gate is inconclusive."
                    f" {campaign.stopped_because}".rstrip(),
                    f"See why: eigenfail campaign show {campaign.id};"
                    " to start again, use a different --planner-version.",
                )
        return {each.name: found for each, found in zip(suite.members, ended, strict=True)}

    def _judge_member(
        self,
        member: SuiteMember,
        before: Campaign,
        known: BaselineFailures,
        now: Campaigns,
        gate: GateRun,
    ) -> MemberReport:
        """The verdict on a member that the baseline has."""
        findings = (
            known_failures.make_known_findings(
                self._find_proof(replay),
                _index_episodes(self._client, now[replay.now.member.name]),
                self._pages,
            )
            for replay in known.replays
        )
        campaign = now[member.name]
        return MemberReport(
            member=member.name,
            baseline=read_figures(before),
            known=tuple(chain.from_iterable(findings)),
            rerun=None if before.id == campaign.id else self._judge_rerun(before, campaign, gate),
            notes=known.notes,
        )

    def _find_proof(self, replay: GateReplay) -> known_failures.KnownReplay:
        """Return the replays, with their outcomes for the baseline's version of the planner."""
        (found,) = self._client.suites.find(Suite("", (replay.before.member,)))
        if found is None or found.state is not CampaignState.DONE:
            return replay.now
        return known_failures.drop_unproven(
            replay.now, known_failures.map_outcomes(_index_episodes(self._client, found))
        )

    def _judge_rerun(self, was: Campaign, now: Campaign, gate: GateRun) -> Rerun:
        """The verdict on a campaign that was run again."""
        comparison = self._client.campaigns.compare(was.id, now.id)
        side = self._read_side(now)
        before = self._read_side(was)
        judged = judge_rerun(before, side, comparison, self._pages, gate.by, gate.closing)
        if not known_failures.needs_modes(judged):
            return judged
        together = find_or_run_analysis(self._client, self._place, was.id, now.id)
        return known_failures.add_modes(judged, together, side, self._pages)

    def _read_side(self, campaign: Campaign) -> RerunSide:
        """Return a campaign with the outcomes of its episodes."""
        counts, list_episodes = campaign.counts, self._client.episodes.list
        # The safe episodes that may be unresolved, by the paper's brakes or by weaker ones.
        peak = PEAK_BRAKING_MPS2
        ends = (f"final_drac_mps2 > {peak}", f"peak_braking_mps2 < {peak} and final_drac_mps2 > 0")
        found = (list_episodes(campaign.id, Outcome.SAFE, filter=each) for each in ends)
        may_collide = chain.from_iterable(found)
        failures = chain.from_iterable(list_episodes(campaign.id, each) for each in FAILURES)
        outcomes = RunOutcomes(
            episodes=counts.completed + counts.errored,
            failures={row.index: row for row in failures},
            errored={row.index: row for row in list_episodes(campaign.id, Outcome.ERRORED)},
            unresolved={row.index: row for row in may_collide if row.assessed.unresolved},
        )
        return RerunSide(campaign, outcomes)
