"""The campaigns of a gate: its baseline, the known failures, and what it runs on a service."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

from eigenfail.cli.connection import Place
from eigenfail.cli.render import run_suite
from eigenfail.client import Client
from eigenfail.client.analyses import OVER
from eigenfail.client.link import wait_until
from eigenfail.errors import Conflict, EigenfailError, InvalidValue, ServiceError
from eigenfail.gate import baselines
from eigenfail.gate.known import (
    KnownReplay,
    RunSettings,
    add_modes,
    drop_unproven,
    is_minimal_search,
    make_known_findings,
    make_minimal_replay,
    make_mode_replays,
    needs_modes,
    read_outcomes,
)
from eigenfail.gate.matched import MatchedModes, match_versions
from eigenfail.gate.report import GateReport, GateRun, MemberReport, build_report
from eigenfail.gate.reruns import GateFinding, Rerun, RerunSide, judge_rerun, read_figures
from eigenfail.gate.verdicts import RunOutcomes
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.methods import traits_of
from eigenfail.progress import announce
from eigenfail.suites import Suite, SuiteMember
from eigenfail.values.analysis import Analysis, AnalysisSettings, AnalysisState, MinimalFailure
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import FAILURES, Outcome, episode_seed
from eigenfail.values.records import PEAK_BRAKING_MPS2, EpisodeRow
from eigenfail.values.release import ReleaseTable
from eigenfail.values.suite import suite_of
from eigenfail.values.variation import KINDS
from eigenfail.worlds import drawn_for

POLL_S = 0.3


def analyze_campaign(client: Client, place: Place, campaign: int) -> Analysis:
    """The first analysis of a campaign's own failures."""
    return _wait_for_analysis(
        client, place, campaign, AnalysisSettings(), lambda each: not each.campaigns
    )


def analyze_pair(client: Client, place: Place, before: int, now: int) -> Analysis:
    """The first analysis of just these two campaigns."""
    settings = AnalysisSettings(campaigns=(now,))
    return _wait_for_analysis(client, place, before, settings, lambda each: each == settings)


def _wait_for_analysis(
    client: Client,
    place: Place,
    campaign: int,
    settings: AnalysisSettings,
    is_alike: Callable[[AnalysisSettings], bool],
) -> Analysis:
    """The first analysis of a kind that did not fail, once it has ended; made if there is none.

    The first, so that a gate that is repeated says the same, whatever was analysed since.

    Args:
        client: client of the service.
        place: where it is.
        campaign: campaign that is analysed.
        settings: settings of a new one.
        is_alike: whether one with these settings will do.
    """
    alike = [each for each in client.analyses.list(campaign) if is_alike(each.settings)]
    kept = [each for each in alike if each.state is not AnalysisState.FAILED]
    analysis = kept[-1] if kept else client.analyses.create(campaign, settings)

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

    The baseline may be named by the file of a suite that was run, by campaigns' ids, by the name of
    a suite or of a run, or by the version of one. If it is not named, it is this run itself.

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
    if IDS.fullmatch(run):
        return _find_by_ids(client, suite, map(int, run.split(",")))
    return _find_by_version(client, suite, run) or _find_by_version(
        client, suite, baselines.name_run(gate.suite, run)
    )


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

    now: KnownReplay
    before: KnownReplay


class BaselineFailures(NamedTuple):
    """The known failures of a member's baseline, and what keeps others from being known."""

    replays: tuple[GateReplay, ...] = ()
    notes: tuple[str, ...] = ()


class Shrunk(NamedTuple):
    """A campaign that shrank a failure, and what it came down to."""

    campaign: Campaign
    failure: MinimalFailure


class KnownFailures:
    """Finds the known failures of campaigns, analysing those that were not.

    Args:
        client: client of the service.
        place: where it is.
    """

    def __init__(self, client: Client, place: Place) -> None:
        self._client = client
        self._place = place

    def of(self, run: str, member: SuiteMember, before: Campaign) -> BaselineFailures:
        """Those of a baseline's campaign.

        Args:
            run: the name of the run in which they are replayed.
            member: whose planner they are injected into.
            before: the campaign.
        """
        if not before.counts.failures:
            return BaselineFailures()
        if _has_varied_parameters(before) and not _find_drawn_parameters(before, 0):
            problem = f"scenario '{before.spec.scenario}' is not installed here."
            return BaselineFailures(notes=(f"Known failures are not replayed: {problem}",))
        analysis = analyze_campaign(self._client, self._place, before.id)
        new = RunSettings(run, member)
        old = RunSettings(baselines.find_run(before, member), SuiteMember(member.name, before.spec))
        shrunk = [*self._shrunk(before, analysis)]
        replays = zip(
            _list_replays(new, before, analysis, shrunk),
            _list_replays(old, before, analysis, shrunk),
            strict=True,
        )
        notes = () if analysis.result else (f"It has no failure modes: {analysis.problem}",)
        return BaselineFailures(tuple(GateReplay(*both) for both in replays), notes)

    def proven(self, replay: GateReplay) -> KnownReplay:
        """Return the replays, with their outcomes for the baseline's version of the planner."""
        (found,) = self._client.suites.find(Suite("", (replay.before.member,)))
        if found is None or found.state is not CampaignState.DONE:
            return replay.now
        return drop_unproven(replay.now, read_outcomes(_index_episodes(self._client, found)))

    def _shrunk(self, before: Campaign, analysis: Analysis) -> Iterator[Shrunk]:
        """Return the minimal failures of a campaign that still fail."""
        for campaign in self._client.campaigns.list(CampaignState.DONE, archived=True):
            if is_minimal_search(campaign, before, analysis):
                with suppress(Conflict):
                    yield Shrunk(campaign, self._client.campaigns.minimal(campaign.id))


def _list_replays(
    under: RunSettings, before: Campaign, analysis: Analysis, shrunk: Sequence[Shrunk]
) -> Iterator[KnownReplay]:
    """Return replays of a campaign's modes and minimal failures for one planner."""
    yield from make_mode_replays(under, before, analysis, partial(_find_drawn_parameters, before))
    for campaign, failure in shrunk:
        yield make_minimal_replay(
            under, campaign, failure.index, partial(_find_drawn_parameters, campaign)
        )


def _index_episodes(client: Client, campaign: Campaign) -> dict[int, EpisodeRow]:
    """The episodes of a campaign that have a result, by index."""
    return {row.index: row for row in client.episodes.list(campaign.id)}


def _has_varied_parameters(campaign: Campaign) -> bool:
    """Whether its episodes draw parameters of their scenario."""
    given = campaign.spec.scenario_parameters.values()
    return any(isinstance(each, dict) and KINDS.keys() & each.keys() for each in given)


def _find_drawn_parameters(campaign: Campaign, index: int) -> Mapping[str, Any]:
    """What an episode drew of its scenario's parameters, by name."""
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
        self._known = KnownFailures(client, place)
        # A service of our own is gone once this is read; one started anew has the usual address.
        self._pages = DEFAULT_URL if place.again else place.url

    def run(self, suite: Suite, gate: GateRun) -> GateReport:
        """Run the missing campaigns, and judge the results.

        Raises:
            InvalidValue: the baseline is not there, or asks something else of its planner.
            Conflict: it is not done.
            ServiceError: a campaign came to nothing.
        """
        gated = baselines.select_version(suite, gate.version)
        if not gate.baseline:
            self._together(gated)
        before = find_baseline(self._client, gated, gate)
        baselines.check_baseline(
            gated, before, gate.baseline or gate.run, make_resolver(self._client)
        )
        judged = tuple(member for member in gated.members if member.name in before)
        known = {each.name: self._known.of(gate.run, each, before[each.name]) for each in judged}
        replays = [replay.now.member for each in known.values() for replay in each.replays]
        now = self._together(Suite(gate.run, (*judged, *replays)))
        members = [self._member(each, before, known, now, gate) for each in gated.members]
        return build_report(gate, members, [*self._match_modes(judged, before, now)])

    def _together(self, suite: Suite) -> Campaigns:
        """The campaigns of a suite by the names of its members, all of them done."""
        ended = run_suite(self._client, suite, self._place.check, self._command)
        for campaign in ended:
            _require_done(campaign)
        return {each.name: found for each, found in zip(suite.members, ended, strict=True)}

    def _member(
        self,
        member: SuiteMember,
        before: Found,
        known: Mapping[str, BaselineFailures],
        now: Campaigns,
        gate: GateRun,
    ) -> MemberReport:
        """What became of a member."""
        if member.name not in before:
            return MemberReport(member=member.name, notes=("It is not in the baseline.",))
        was, is_now, ours = before[member.name], now[member.name], known[member.name]
        return MemberReport(
            member=member.name,
            baseline=read_figures(was),
            known=self._findings(ours, now),
            rerun=None if was.id == is_now.id else self._rerun(was, is_now, gate),
            notes=ours.notes,
        )

    def _match_modes(
        self, members: Sequence[SuiteMember], before: Found, now: Campaigns
    ) -> Iterator[MatchedModes]:
        """The failure modes of both versions, by scenario; members may test the same one."""
        reruns = [
            (each.name, before[each.name], now[each.name])
            for each in members
            if before[each.name].id != now[each.name].id and _may_have_modes(now[each.name])
        ]
        problems = {name: self._analyze_modes(was, campaign) for name, was, campaign in reruns}
        tables: dict[int, ReleaseTable] = {}
        names: dict[tuple[int, str, str], list[str]] = {}
        for name, was, campaign in reruns:
            table = problems[name] or self._compare_releases(campaign)
            if isinstance(table, str):
                yield MatchedModes(members=(name,), campaign=campaign.id, problem=table)
                continue
            tables[table.question.campaign] = table
            versions = was.spec.version, campaign.spec.version
            names.setdefault((table.question.campaign, *versions), []).append(name)
        for (question, old, new), alike in names.items():
            matched = match_versions(alike, tables[question], old, new)
            if matched.modes or matched.problem:
                yield matched

    def _analyze_modes(self, was: Campaign, campaign: Campaign) -> str:
        """Analyse a campaign of the new version; return why that was not possible, or nothing.

        No error ends the gate: its verdict does not depend on the modes.
        """
        if was.spec.version and campaign.counts.failures:
            try:
                analyze_campaign(self._client, self._place, campaign.id)
            except EigenfailError as error:
                return str(error)
        return ""

    def _compare_releases(self, campaign: Campaign) -> ReleaseTable | str:
        """Return the comparison of releases that has a campaign, or why there is none.

        The campaign may be none of the newest ones, to which the comparison is limited.
        """
        try:
            return self._client.releases.get(campaign.id)
        except EigenfailError as error:
            return str(error)

    def _findings(self, known: BaselineFailures, now: Campaigns) -> tuple[GateFinding, ...]:
        """What became of the known failures of a member."""
        return tuple(
            finding
            for replay in known.replays
            for finding in make_known_findings(
                self._known.proven(replay),
                _index_episodes(self._client, now[replay.now.member.name]),
                self._pages,
            )
        )

    def _rerun(self, was: Campaign, now: Campaign, gate: GateRun) -> Rerun:
        """What became of a campaign that was run again."""
        comparison = self._client.campaigns.compare(was.id, now.id)
        side = self._side(now)
        judged = judge_rerun(self._side(was), side, comparison, self._pages, gate.by, gate.closing)
        if not needs_modes(judged):
            return judged
        together = analyze_pair(self._client, self._place, was.id, now.id)
        return add_modes(judged, together, side, self._pages)

    def _side(self, campaign: Campaign) -> RerunSide:
        """Return a campaign with the outcomes of its episodes."""
        counts = campaign.counts
        outcomes = RunOutcomes(
            episodes=counts.completed + counts.errored,
            failures=self._list_outcomes(campaign, *FAILURES),
            errored=self._list_outcomes(campaign, Outcome.ERRORED),
            unresolved=self._list_unresolved(campaign),
        )
        return RerunSide(campaign, outcomes)

    def _list_outcomes(self, campaign: Campaign, *outcomes: Outcome) -> dict[int, EpisodeRow]:
        """Return the episodes that ended like these, by index."""
        return {
            row.index: row
            for outcome in outcomes
            for row in self._client.episodes.list(campaign.id, outcome)
        }

    def _list_unresolved(self, campaign: Campaign) -> dict[int, EpisodeRow]:
        """Return the safe episodes that are unresolved, by index."""
        braking = f"max_drac_mps2 > {PEAK_BRAKING_MPS2}"
        rows = self._client.episodes.list(campaign.id, Outcome.SAFE, filter=braking)
        return {row.index: row for row in rows if row.assessed.unresolved}


def _may_have_modes(campaign: Campaign) -> bool:
    """Whether releases compare the failure modes of campaigns like this one."""
    return traits_of(campaign.spec.method).finds_new


def _require_done(campaign: Campaign) -> None:
    """Raises ServiceError if a campaign ended early, so that no gate may open on it."""
    if campaign.state is not CampaignState.DONE:
        raise ServiceError(
            f"Campaign {campaign.id} is {campaign.state}, so its gate is inconclusive."
            f" {campaign.stopped_because}".rstrip(),
            f"See why: eigenfail campaign show {campaign.id};"
            " to start again, use a different --planner-version.",
        )
