"""What each mode of an analysis is, in words, with its medoid and the planner's account of it."""

import time
from threading import Thread

from eigenfail import plugins
from eigenfail.contracts import Explainer, Store
from eigenfail.errors import EigenfailError
from eigenfail.values import (
    Analysis,
    AnalysisResult,
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    ExplainedEpisode,
    FailureMode,
    TrajectorySource,
)
from eigenfail_services.analysis.account_words import describe_account
from eigenfail_services.analysis.words import Clock, describe

PATIENCE_S = 60.0
"""For all episodes of an analysis together: then no planner is waited for, nor asked, any more."""


def mode_words(
    store: Store, analysis: Analysis, result: AnalysisResult, step_s: float | None
) -> tuple[str, ...]:
    """A few sentences on each mode, in the order of the modes: the largest has its account first.

    Args:
        store: where the medoids are.
        analysis: that found the modes.
        result: what it found.
        step_s: duration of a step; None where it has none. [s]
    """
    until_s = time.monotonic() + PATIENCE_S
    return tuple(
        f"Mode {number}: {words_of(store, analysis.campaign, mode, step_s, until_s)}"
        for number, mode in enumerate(result.modes, start=1)
    )


def words_of(
    store: Store, campaign: int, mode: FailureMode, step_s: float | None, until_s: float
) -> str:
    """What the eigenfailure does, which episode shows it, and what the planner did there.

    Times are those of the medoid: an eigenfailure has no impact of its own until it is replayed.
    """
    campaign = mode.medoid_campaign or campaign
    medoid = store.episodes.get(campaign, mode.medoid)
    clock = Clock(medoid.steps, step_s, "its medoid's impact")
    shown = f"Its medoid is episode {campaign}/{mode.medoid}"
    setup = store.campaigns.get(campaign).spec.setup()
    account = account_of(setup, medoid, Clock(medoid.steps, step_s), until_s)
    told = f"{shown}; {account}" if account else f"{shown}."
    return f"{describe(mode.eigenfailure, clock)} {told}"


def account_of(setup: EpisodeSetup, medoid: EpisodeResult, clock: Clock, until_s: float) -> str:
    """What the planner did in an episode; empty where nobody can tell, or not in time.

    The planner is asked in a thread of its own. Whatever goes wrong there leaves the analysis as it
    is; and one that never answers is left behind once, as the time of all others is spent with it.

    Args:
        setup: of the episode's campaign.
        medoid: the episode.
        clock: its times.
        until_s: when `time.monotonic` says so, the planner is not waited for. [s]
    """
    told: list[str] = []

    def ask() -> None:
        explained = explain(setup, medoid)
        if explained is not None and explained.result.digest() == medoid.digest():
            told.append(describe_account(explained, clock))

    left_s = until_s - time.monotonic()
    if left_s > 0.0:
        asking = Thread(target=ask, daemon=True)
        asking.start()
        asking.join(left_s)
    return told[0] if told else ""


def explain(setup: EpisodeSetup, stored: EpisodeResult) -> ExplainedEpisode | None:
    """The episode again, with the planner's account.

    None where workers are not installed, where there is no planner to be asked, and where it fails
    at the question.
    """
    task = EpisodeTask(stored.index, stored.seed, TrajectorySource(stored.noise.z))
    try:
        explainer: Explainer = plugins.load(plugins.EXPLAINERS, "default")
        return explainer(setup, task)
    except EigenfailError:
        return None
