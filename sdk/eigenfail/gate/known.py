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
    """Noise under which the baseline failed, or is thought to have: one of three kinds.

    An eigenfailure is the centre of a failure mode; a medoid is the real failure nearest to it; a
    minimal failure is the rest of a failure that was shrunk.

    Attributes:
        what: it is, in words.
        was: the baseline's episode, as CAMPAIGN/INDEX; empty of an eigenfailure.
        before: what came of it with the baseline's planner; None if that was never tried.
        mode: failure mode that it stands for, as ANALYSIS/NUMBER; empty of a minimal failure.
    """

    what: str
    was: str = ""
    before: Outcome | None = None
    mode: str = ""


class KnownReplay(msgspec.Struct, frozen=True):
    """A campaign that injects known failures.

    Attributes:
        member: member of a suite; named after the member whose baseline's failures these are.
        known: the known failure of each episode, by index; others are of no interest.
    """

    member: SuiteMember
    known: dict[int, KnownFailure]


class RunSettings(msgspec.Struct, frozen=True):
    """The planner that known failures are injected into, and the run that this belongs to.

    Attributes:
        run: name of the run.
        member: whose planner it is.
    """

    run: str
    member: SuiteMember

    def replay(self, title: str, like: CampaignSpec, **varied: Any) -> SuiteMember:
        """A campaign that replays noise in the world of another, with this planner."""
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
    """The campaign in the scenario that one of its episodes drew."""
    return replace(spec, scenario_parameters={**spec.scenario_parameters, **drawn})


def make_minimal_replay(
    under: RunSettings, minimal: Campaign, index: int, drawn: Mapping[str, Any]
) -> KnownReplay:
    """The failure to which a campaign shrank its own.

    Args:
        under: the planner.
        minimal: the campaign.
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
    """Whether a campaign shrank a failure of another, or a mode of its analysis.

    With the same planner: otherwise the rest is not a failure of the baseline's planner.
    """
    spec, planner = campaign.spec, (before.spec.planner, before.spec.planner_settings)
    named = {"campaign": before.id, "analysis": analysis.id}
    return (
        spec.method == MINIMAL
        and (spec.planner, spec.planner_settings) == planner
        and any(spec.settings.get(name) == number for name, number in named.items())
    )


def drop_unproven(replay: KnownReplay, outcomes: Mapping[int, Outcome]) -> KnownReplay:
    """Return a replay whose earlier outcomes are those of the baseline's own planner."""
    known = {
        index: replace(failure, before=outcomes.get(index, failure.before))
        for index, failure in replay.known.items()
    }
    return replace(replay, known=known)


def make_known_findings(
    replay: KnownReplay, rows: Mapping[int, EpisodeRow], pages: str
) -> tuple[reruns.GateFinding, ...]:
    """The fate of each known failure of a replay.

    Args:
        replay: what was injected.
        rows: what came of it with the new planner, by index.
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
    """The eigenfailures and medoids of an analysis, each in its own scenario.

    If the scenario's parameters vary, an eigenfailure's own scenario is that of its medoid:
    modes whose medoids drew the same share a campaign.

    Args:
        under: the planner.
        before: the campaign that was analysed.
        analysis: done, with at least one mode.
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
    """The modes by what their medoids drew, in order."""
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
    """A mode that the new planner's failures are in, and the baseline's are not, or hardly.

    Attributes:
        number: number of the mode, from 1.
        episode: episode of the new planner, its failure in the mode that is nearest to the centre.
        now: its failures in the mode, of `of_now`.
        before: the baseline's, of `of_before`.
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
        """What it rests on; the chance of it is that of independent failures alone.

        Args:
            judged: whether failures are independent.
            name: name of the mode; empty if it is left out.
        """
        chance = f" (p = {self.p_value:.2g})" if judged else ""
        named = f" ({name})" if name else ""
        return (
            f"new mode {self.number}{named}: {self.now} of {self.of_now} failures are in it, before"
            f" {self.before} of {self.of_before}{chance}"
        )


def needs_modes(judged: reruns.Rerun) -> bool:
    """Return whether new modes matter: for methods whose rate does not reveal new failures."""
    failed = judged.before.failures and judged.now.failures
    return bool(judged.by is reruns.JudgedBy.RATE and judged.verdict in ASKING and failed)


def add_modes(
    judged: reruns.Rerun, together: Analysis, now: reruns.RerunSide, pages: str
) -> reruns.Rerun:
    """A rerun with the failure modes that are new in it; if they count, it is new itself.

    Args:
        judged: rerun of a campaign that is judged by its rate.
        together: an analysis of the baseline's campaign and this one that has ended.
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
    """The modes that hold more of one campaign's failures than chance and the other's explain.

    They must also hold more failures per completed episode than chance explains, by the same test:
    the share of a mode among the failures grows, too, when another mode disappears.

    The modes are found without regard to whose the failures are. So if those of both campaigns are
    independent draws of one kind, each mode has a random part of either's: Fisher's exact test
    (1935, The Design of Experiments) holds its error, however the modes were found.

    Args:
        result: result of both campaigns' failures together.
        before: figures of the baseline's campaign.
        now: figures of the new planner's.
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
    """The probability of k or more marked ones among some drawn of all without replacement."""
    most = min(drawn, marked)
    whole = _log_binomial(total, marked)
    logs = (
        _log_binomial(drawn, x) + _log_binomial(total - drawn, marked - x) - whole
        for x in range(max(k, marked - (total - drawn)), most + 1)
    )
    return min(1.0, sum(map(exp, logs)))


def _log_binomial(n: int, k: int) -> float:
    """Logarithm of the number of ways to choose k of n."""
    return lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)
