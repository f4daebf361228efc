"""Figures: what becomes of a planner's failures when one number of the world is another."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import msgspec
import numpy as np
from benchmarks.episode_loop import tasks
from benchmarks.episode_pool import EpisodePool, horizon, make_setup
from benchmarks.figures import Figure
from benchmarks.samples import share
from benchmarks.truth.shapes import draw_held_noise

from eigenfail.values.episode import EpisodeSetup

EPISODES = 300


class Changed(NamedTuple):
    """Parameters of the scenario and settings of the planner that are not the defaults."""

    parameters: Mapping[str, float]
    settings: Mapping[str, Any]

    def setup(self, scenario: str, planner: str) -> EpisodeSetup:
        """A campaign with these; all else is as it is by default."""
        setup = make_setup(scenario, planner, **self.parameters)
        return msgspec.structs.replace(setup, planner_settings=dict(self.settings))


def parameter(name: str, *values: float) -> dict[str, Changed]:
    """One parameter of the scenario at each of these values."""
    return {f"{name}_{value:g}": Changed({name: value}, {}) for value in values}


def setting(path: str, *values: float) -> dict[str, Changed]:
    """One setting of the planner at each of these values; a dot leads into a part of it."""
    *parts, name = path.split(".")
    found = {}
    for value in values:
        settings: dict[str, Any] = {name: value}
        for part in reversed(parts):
            settings = {part: settings}
        found[f"{name}_{value:g}"] = Changed({}, settings)
    return found


IDM_IN_CUT_IN = {
    **parameter("final_offset_m", 2.0, 2.05, 2.15),
    **parameter("lane_change_s", 2.8, 3.2),
    **parameter("actor_speed_mps", 12.0, 13.0),
    **parameter("distance_m", 53.0, 63.0),
    **setting("lane_half_width_m", 2.2, 2.3),
    **setting("brake_build_up_mps3", 8.0, 15.0, 1000.0),
    **setting("max_deceleration_mps2", 5.0, 6.0),
}
IDM_IN_MERGE_IN = {
    **parameter("behind_m", 17.0, 18.0, 18.5, 19.0, 20.0, 20.5, 21.0),
    **parameter("ramp_m", 330.0, 340.0, 345.0, 355.0, 360.0, 370.0),
    **setting("gaps.safe_deceleration_mps2", 0.25, 1.0),
    **setting("gaps.gap_behind_m", 1.0, 3.0),
}
RULEBOOK_IN_CUT_IN = {
    **setting("tracker.gate", 8.5, 10.6),
    **setting("tracker.lateral_acceleration_mps2", 0.12, 0.22),
    **setting("tracker.again_speed_sd_mps", 1.35, 2.0),
    **setting("tracker.misses_to_delete", 7, 10),
    **setting("candidates.neighbour_braking_mps2", 3.0),
    "intent_2.0_2.4": Changed({}, {"intent": {"enter_m": 2.0, "leave_m": 2.4}}),
}


def idm(
    scenario: str, changes: Mapping[str, Changed], pool: EpisodePool, seed: int
) -> Iterator[tuple[str, Figure]]:
    """How often `idm` fails under ordinary noise."""
    for name, changed in changes.items():
        played = pool.play(changed.setup(scenario, "idm"), tasks(0, EPISODES, seed))
        rate = share([one.is_failure for one in played])
        yield f"{scenario}.idm.varied.{name}.failure_rate", rate


def rulebook(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """How often `rulebook` loses its track under ordinary noise, and crashes under held noise."""
    steps = horizon("cut_in")
    noise = draw_held_noise(np.random.default_rng(seed), EPISODES, steps, sigma=3.0, hold=5)
    for name, changed in RULEBOOK_IN_CUT_IN.items():
        setup, place = changed.setup("cut_in", "rulebook"), f"cut_in.rulebook.varied.{name}"
        usual = pool.play(setup, tasks(0, EPISODES, seed))
        yield f"{place}.track_lost", share([one.lost_tracks > 0 for one in usual])
        crashed = [one.is_failure for one in pool.inject(setup, noise)]
        yield f"{place}.held3_rate", share(crashed)
