"""Campaigns of versions of a planner, whose failures brake before they end."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from msgspec.structs import replace

from eigenfail.testing.examples import analysis_result, collision, floats
from eigenfail.testing.examples import result as make_result
from eigenfail.values.analysis import FailureMode
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.scene import Scene
from eigenfail_services.store.store import Store
from store_checks.examples import deliver, running
from store_checks.modes import analysed

STEPS, STEP_S = 20, 0.1
BRAKINGS_MPS2: Mapping[str, float] = {"late": 1.0, "hard": 8.0}
"""Deceleration before the collision in a mode, by its name."""

EPISODES = 500


def make_scene(braking_mps2: float, index: int) -> Scene:
    """Return the scene of a failure in which the ego brakes and runs into another vehicle."""
    own_mps2 = braking_mps2 * (1.0 + 0.02 * (index % 5))
    vehicles = np.zeros((STEPS + 1, 2, 4), np.float32)
    vehicles[:, 0, 3] = 30.0 - own_mps2 * STEP_S * np.arange(STEPS + 1)
    vehicles[:, 0, 0] = -5.0 - 20.0 * STEP_S * np.arange(STEPS, -1, -1)
    sizes = np.array([[5.0, 2.0]] * 2, np.float32)
    return Scene(STEP_S, vehicles, sizes, floats(index, STEPS, 2), floats(index, STEPS, 2))


def release(
    store: Store,
    version: str,
    modes: Mapping[str, int],
    *,
    analyse: bool = True,
    passes: int = 0,
    left_out: int = 0,
    result: Mapping[str, Any] | None = None,
    **changes: Any,
) -> Campaign:
    """A campaign of a version that is done, with so many failures of each mode.

    Args:
        store: where it is.
        version: the version.
        modes: number of failures of each mode, by its name.
        analyse: whether its failures are analysed.
        passes: number of episodes without a failure.
        left_out: number of further failures, which the analysis leaves out.
        result: fields of the result of the analysis that are other than usual.
        changes: fields of the campaign that are other than usual.
    """
    fields: dict[str, Any] = {"method": "monte_carlo", "planner": "idm", "name": "release"}
    fields["scenario_parameters"] = {"distance_m": 53.0}
    campaign = running(
        store, **fields | {"planner_version": version, "episodes": EPISODES} | changes
    )
    owners = [name for name, failures in modes.items() for _ in range(failures)]
    scenes = [make_scene(BRAKINGS_MPS2[name], index) for index, name in enumerate(owners)]
    results = [collision(index, STEPS, scene=each) for index, each in enumerate(scenes)]
    more = [collision(len(owners) + place, STEPS, scene=scenes[0]) for place in range(left_out)]
    passed = [make_result(len(owners) + left_out + place) for place in range(passes)]
    deliver(store, campaign, *results, *more, *passed)
    campaign = store.campaigns.move(campaign.id, CampaignState.DONE)
    if owners and analyse:
        names = list(modes)
        found = tuple(
            FailureMode(modes[name], owners.index(name), floats(1, 3), floats(1, STEPS, 2))
            for name in names
        )
        whole = replace(
            analysis_result(len(owners)),
            noise_silhouette=0.25,
            labels=tuple(map(names.index, owners)),
            modes=found,
            words=tuple(f"Mode {place}: {name}." for place, name in enumerate(names, start=1)),
        )
        analysed(store, campaign, replace(whole, **(result or {})))
    return campaign
