"""How DiFS divides its episodes, and which trajectories it trains on."""

from typing import Protocol

import msgspec
import numpy as np

from eigenfail_services.methods.difs.mixture import Rows
from eigenfail_services.methods.difs.settings import DifsSettings
from eigenfail_services.methods.difs.trials import Trials

PAPERS_SIZE = 500
"""From the prior, and again below the threshold."""

FIRST_SHARE = 0.08

ELITES_AT_FIRST = 4
"""As many draws from the prior for each trajectory that is trained on, at least."""

ROUND_SHARE, SMALLEST_ROUND = 0.04, 10


class Plan(msgspec.Struct, frozen=True):
    """What is proposed when.

    Attributes:
        initial: how many episodes are drawn from the prior.
        round_size: how many lie between two trainings after that.
        final: the number of the first episode of the last part, at robustness 0.
    """

    initial: int
    round_size: int
    final: int


class Schedule(Protocol):
    """A named course of a campaign."""

    def plan(self, episodes: int, settings: DifsSettings) -> Plan:
        """The division of a budget, where the settings leave it open."""

    def chosen(
        self, trials: Trials, kinds: Rows, threshold_m: float, settings: DifsSettings
    ) -> Rows:
        """Which trajectories the next training is on, by what they are like so far: `kinds`."""


class ManyRounds:
    """Few draws from the prior, many small rounds, no part that is not learnt from."""

    def plan(self, episodes: int, settings: DifsSettings) -> Plan:
        """8 % of the budget, no less than four for each of the elite; rounds of 4 %."""
        fewest = min(ELITES_AT_FIRST * settings.elite, episodes // 2)
        round_size = max(SMALLEST_ROUND, round(ROUND_SHARE * episodes))
        return Plan(max(round(FIRST_SHARE * episodes), fewest), round_size, episodes)

    def chosen(
        self, trials: Trials, kinds: Rows, _threshold_m: float, settings: DifsSettings
    ) -> Rows:
        """The elite of each kind; once failures are more than that, the likelier of the newest."""
        return trials.elite(settings.elite, settings.likely_share, kinds)


class Paper:
    """500 from the prior, 500 below the threshold, the rest at robustness 0; or in halves."""

    def plan(self, episodes: int, _settings: DifsSettings) -> Plan:
        """Half of the budget twice, where it is smaller than 1000."""
        half = min(PAPERS_SIZE, (episodes + 1) // 2)
        return Plan(half, PAPERS_SIZE, min(2 * PAPERS_SIZE, episodes))

    def chosen(
        self, trials: Trials, _kinds: Rows, threshold_m: float, _settings: DifsSettings
    ) -> Rows:
        """All at or below the threshold."""
        return np.flatnonzero(trials.robustness <= np.float32(threshold_m))


SCHEDULES: dict[str, Schedule] = {"many_rounds": ManyRounds(), "paper": Paper()}


def planned(episodes: int, settings: DifsSettings) -> Plan:
    """The schedule's plan, but for what the settings say."""
    plan = SCHEDULES[settings.schedule].plan(episodes, settings)
    initial, final = plan.initial, plan.final
    if settings.initial_share is not None:
        initial = max(1, round(settings.initial_share * episodes))
    if settings.final_share is not None:
        final = episodes - round(settings.final_share * episodes)
    return Plan(initial, settings.round_size or plan.round_size, final)
