"""Known failures of a baseline, and the campaigns that inject them into another planner."""

from collections.abc import Iterator, Mapping, Sequence
from math import exp, lgamma
from typing import Any, NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace

from eigenfail.gate import reruns
from eigenfail.gate.verdicts import GateVerdict, judge_outcome
from eigenfail.suites import SuiteMember
from eigenfail.values.analysis import Analysis, AnalysisResult, FailureMode
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail.values.episode import Outcome
from eigenfail.values.records import EpisodeRow

REPLAY = "replay"
MINIMAL = "minimal"
"""The method whose campaigns shrink a failure; its settings name a campaign and an episode."""


class KnownFailure(msgspec.Struct, frozen=True):
    """Noise under which the baseline failed, or is assumed to fail: one of three kinds.

    An eigenfailure is the centre of a failure mode. A medoid is the real failure nearest to the
    centre. A minimal failure is the rest of a failure that was shrunk.

    Attributes:
        what: description in words.
        was: the baseline's episode, as CAMPAIGN/INDEX; empty for an eigenfailure.
        before: outcome with the baseline's planner; None if that was never tried.
        mode: failure mode that it represents, as ANALYSIS/NUMBER; empty for a minimal failure.
    """

    what: str
    was: str = ""
    before: Outcome | None = None
    mode: str = ""


class KnownReplay(msgspec.Struct, frozen=True):
    """A campaign that injects known failures.

    Attributes:
        member: member of a suite, named after the member whose baseline had these failures.
        known: the known failure of each episode, by index; other episodes are ignored.
    """

    member: SuiteMember
    known: dict[int, KnownFailure]


class RunSettings(msgspec.Struct, frozen=True):
    """The planner that known failures are injected into, and the run of the replays.

    Attributes:
        run: name of the run.
        member: member that has the planner.
    """

    run: str
    member: SuiteMember

    def replay(self, title: str, like: CampaignSpec, **varied: Any) -> SuiteMember:
        """Return a campaign that replays noise in another campaign's world, with this planner."""
        name = f"{self.member.name}: {title}"
        spec = replace(
            like,
            name=f"{self.run}: {name}",
            method=REPLAY,
            planner=self.member.spec.planner,
            planner_settings=self.member.spec.planner_settings,
            planner_version=self.member.spec.planner_version,
            # Every known failure is replayed, and kept for its page.
            stop=StopRules(),
            scene_every=1,
            **varied,
        )
        return SuiteMember(name, spec)


def _set_scenario(spec: CampaignSpec, drawn: Mapping[str, Any]) -> CampaignSpec:
    """Return the campaign with the scenario that one of its episodes drew."""
    return replace(spec, scenario_parameters={**spec.scenario_parameters, **drawn})


def make_minimal_replay(
    under: RunSettings, minimal: Campaign, index: int, drawn: Mapping[str, Any]
) -> KnownReplay:
    """Return the replay of the minimal failure that a campaign has found.

    Args:
        under: planner to replay with.
        minimal: the campaign that shrank a failure.
        index: index of its minimal failure.
        drawn: scenario parameters that this failure drew, by name.
    """
    was = f"{minimal.id}/{index}"
    again = under.replay(
        f"minimal failure {was}",
        _set_scenario(minimal.spec, drawn),
        settings={"campaign": minimal.id, "episodes": [index]},
        episodes=1,
    )
    return KnownReplay(again, {0: KnownFailure(f"minimal failure {was}", was, Outcome.COLLISION)})


def is_minimal_search(campaign: Campaign, before: Campaign, analysis: Analysis) -> bool:
    """Return whether a campaign shrank a failure of another campaign, or a mode of its analysis.

    The planners must be equal: otherwise the rest is not a failure of the baseline's planner.
    """
    spec, planner = campaign.spec, (before.spec.planner, before.spec.planner_settings)
    named = {"campaign": before.id, "analysis": analysis.id}
    return (
        spec.method == MINIMAL
        and (spec.planner, spec.planner_settings) == planner
        and any(spec.settings.get(name) == number for name, number in named.items())
    )


def drop_unproven(replay: KnownReplay, outcomes: Mapping[int, Outcome]) -> KnownReplay:
    """Return a replay with the baseline planner's outcomes as its earlier outcomes."""
    known = {
        index: replace(failure, before=outcomes.get(index, failure.before))
        for index, failure in replay.known.items()
    }
    return replace(replay, known=known)


def make_known_findings(
    replay: KnownReplay, rows: Mapping[int, EpisodeRow], pages: str
) -> tuple[reruns.GateFinding, ...]:
    """Return the verdict on each known failure of a replay.

    Args:
        replay: the injected failures.
        rows: episodes of the new planner, by index.
        pages: address of the service's pages.
    """
    found = []
    for index, known in replay.known.items():
        row = rows.get(index)
        became = judge_outcome(known.before, row.outcome if row else None)
        finding = reruns.make_finding(became, known.what, known.was, row, pages)
        found.append(replace(finding, mode=known.mode))
    return tuple(found)


def map_outcomes(rows: Mapping[int, EpisodeRow]) -> dict[int, Outcome]:
    """Return the outcomes of completed episodes, by index."""
    return {index: row.outcome for index, row in rows.items() if row.outcome is not Outcome.ERRORED}


def make_mode_replays(
    under: RunSettings, before: Campaign, analysis: Analysis
) -> Iterator[KnownReplay]:
    """Yield replays of the eigenfailures and medoids of an analysis, each in its own scenario.

    If the scenario's parameters vary, an eigenfailure takes the scenario of its medoid. Modes whose
    medoids drew the same scenario share a campaign.

    Args:
        under: planner to replay with.
        before: the analysed campaign.
        analysis: finished analysis with at least one mode.
    """
    modes, name = analysis.result.modes if analysis.result else (), f"analysis {analysis.id}"
    for parameters, places in _group_by_scenario(modes):
        world = _set_scenario(before.spec, parameters)
        where = f" as in {before.id}/{modes[places[0]].medoid}" if parameters else ""
        eigenfailures = under.replay(
            f"eigenfailures of {name}{where}",
            world,
            settings={"analysis": analysis.id},
            episodes=len(modes),
        )
        # An eigenfailure is a mean: whether it fails at all is not known until it is replayed.
        centres = {
            n: KnownFailure(f"eigenfailure {n + 1} of {name}", mode=f"{analysis.id}/{n + 1}")
            for n in places
        }
        yield KnownReplay(eigenfailures, centres)
        medoids = [modes[place].medoid for place in places]
        again = under.replay(
            f"medoids of {name}{where}",
            world,
            settings={"campaign": before.id, "episodes": medoids},
            episodes=len(medoids),
        )
        known: dict[int, KnownFailure] = {}
        for n, place in enumerate(places):
            was, mode = f"{before.id}/{medoids[n]}", f"{analysis.id}/{place + 1}"
            what = f"medoid {place + 1}, {was}"
            known[n] = KnownFailure(what, was, Outcome.COLLISION, mode)
        yield KnownReplay(again, known)


def _group_by_scenario(
    modes: Sequence[FailureMode],
) -> Iterator[tuple[Mapping[str, Any], list[int]]]:
    """Yield the modes grouped by the scenario that their medoids drew, in order."""
    groups: dict[bytes, tuple[Mapping[str, Any], list[int]]] = {}
    for place, mode in enumerate(modes):
        # Parameters may be lists or tables, which are no keys of a dict: their text is.
        key = msgspec.json.encode(mode.drawn, order="sorted")
        groups.setdefault(key, (mode.drawn, []))[1].append(place)
    yield from groups.values()


NEW_MODE = 0.025
"""How often failures of the baseline's kind have a mode that is called new, at most: all modes of a
campaign together, each tested at an equal part of it (Bonferroni)."""

RARER = 10
"""Factor by which a mode's share of failures must have grown for the mode to be called new."""

NOT_JUDGED = (
    "Reported, not judged: failures of {} are not independent of each other, so that two runs"
    " of one planner may dwell in different modes."
)

ASKING = frozenset({GateVerdict.STILL_FAILING, GateVerdict.FIXED})


class NewMode(NamedTuple):
    """A mode with failures of the new planner, and none or hardly any of the baseline.

    Attributes:
        number: number of the mode, from 1.
        episode: the new planner's failure that is nearest to the centre of the mode.
        now: number of the new planner's failures in the mode, out of `of_now`.
        before: number of the baseline's failures in the mode, out of `of_before`.
        p_value: p-value of Fisher's exact test, one-sided.
    """

    number: int
    episode: int
    now: int
    of_now: int
    before: int
    of_before: int
    p_value: float

    def words(self, judged: bool, name: str = "") -> str:
        """Return the numbers behind the mode; the p-value holds only for independent failures.

        Args:
            judged: whether failures are independent; the p-value is left out otherwise.
            name: name of the mode; empty to leave it out.
        """
        chance = f" (p = {self.p_value:.2g})" if judged else ""
        named = f" ({name})" if name else ""
        return (
            f"new mode {self.number}{named}: {self.now} of {self.of_now} failures are in it, before"
            f" {self.before} of {self.of_before}{chance}"
        )


def needs_modes(judged: reruns.Rerun) -> bool:
    """Return whether new modes matter, since the method's rate does not reveal new failures."""
    failed = judged.before.failures and judged.now.failures
    return bool(judged.by is reruns.JudgedBy.RATE and judged.verdict in ASKING and failed)


def add_modes(
    judged: reruns.Rerun, together: Analysis, now: reruns.RerunSide, pages: str
) -> reruns.Rerun:
    """Return a rerun with its new failure modes; if these count, its verdict is new.

    Args:
        judged: rerun of a campaign that is judged by its rate.
        together: finished analysis of the baseline's campaign and the rerun.
        now: the new planner's side.
        pages: address of the service's pages.
    """
    result = together.result
    if result is None or not result.distinct:
        reason = result.verdict if result else together.problem
        return replace(judged, modes=f"Whether a failure mode is new cannot be decided: {reason}")
    new = [*find_new_modes(result, judged.before, judged.now)]
    if not new:
        return replace(judged, modes=f"None of {len(result.modes)} failure modes is new.")
    counts, rows = judged.judges_modes, now.outcomes.failures
    became = GateVerdict.NEW if counts else GateVerdict.UNPROVEN
    described = [(one.words(counts), rows.get(one.episode)) for one in new]
    names = {mode.number: mode.name for mode in result.list_modes(together.id) if result.words}
    told = "; ".join(one.words(counts, names.get(one.number, "")) for one in new)
    sentence = f"{told[:1].upper()}{told[1:]}."
    return replace(
        judged,
        verdict=GateVerdict.NEW if counts else judged.verdict,
        modes=sentence if counts else f"{sentence} {NOT_JUDGED.format(judged.method)}",
        new_modes=tuple(
            reruns.make_finding(became, words, "", row, pages) for words, row in described
        ),
    )


def find_new_modes(
    result: AnalysisResult, before: reruns.RerunFigures, now: reruns.RerunFigures
) -> Iterator[NewMode]:
    """Yield modes with more failures of the new planner than chance and the baseline explain.

    These modes must also hold more failures per completed episode than chance explains, by the same
    test. Otherwise a mode would be new because its share grows when another mode disappears.

    The analysis ignores which campaign a failure belongs to. So if the failures of both campaigns
    are independent draws of one kind, each mode has a random part of each campaign's failures.
    Fisher's exact test (1935, The Design of Experiments) then holds its error, for any modes.

    Args:
        result: result of the analysis of both campaigns' failures together.
        before: figures of the baseline's campaign.
        now: figures of the new planner's campaign.
    """
    labels, campaigns = np.array(result.labels), np.array(result.campaigns)
    ours, theirs = campaigns == now.campaign, campaigns == before.campaign
    of_now, of_before = int(ours.sum()), int(theirs.sum())
    for place, mode in enumerate(result.modes):
        inside = labels == place
        k_now, k_before = int((inside & ours).sum()), int((inside & theirs).sum())
        p_value = bound_probability(k_now, of_now, k_now + k_before, of_now + of_before)
        # A tested difference may still be too small to matter: the mode must grow by a factor.
        is_rare = RARER * k_before * of_now <= k_now * of_before
        episodes = now.completed + before.completed
        by_episode = bound_probability(k_now, now.completed, k_now + k_before, episodes)
        if is_rare and max(p_value, by_episode) < NEW_MODE / len(result.modes):
            rows = np.flatnonzero(inside & ours)
            away = np.linalg.norm(result.scores[rows] - mode.centre, axis=1)
            episode = result.episodes[rows[np.argmin(away)]]
            yield NewMode(place + 1, episode, k_now, of_now, k_before, of_before, p_value)


def bound_probability(k: int, drawn: int, marked: int, total: int) -> float:
    """Return the probability of k or more marked items among items drawn without replacement."""
    most = min(drawn, marked)
    whole = _log_binomial(total, marked)
    logs = (
        _log_binomial(drawn, x) + _log_binomial(total - drawn, marked - x) - whole
        for x in range(max(k, marked - (total - drawn)), most + 1)
    )
    return min(1.0, sum(map(exp, logs)))


def _log_binomial(n: int, k: int) -> float:
    """Return the logarithm of the number of ways to choose k of n."""
    return lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)
