"""What the checks of a store put into it."""

from typing import Any

import numpy as np

from eigenfail.contracts import Store
from eigenfail.testing.expectations import expect
from eigenfail.values import (
    STATE,
    AnalysisResult,
    Campaign,
    CampaignSpec,
    CampaignState,
    EpisodeFault,
    EpisodeResult,
    FailureMode,
    Floats,
    Measures,
    NoiseTrajectory,
    Outcome,
    Scene,
)
from eigenfail.values.records import Delivery, Verdict

WORKER = "worker-1"
BEYOND = (0, -1, 999, 2**63, 2**70)
"""Ids that nothing has."""


CRASH = Measures(
    robustness_m=0.0,
    severity=2.5,
    min_ttc_s=1.25,
    ttc_violated_s=1.5,
    drac_at_warning_mps2=6.5,
    collided_s=3.75,
    left_road_s=3.5,
    max_jerk_mps3=12.5,
    hard_brakings=2,
    clipped_steps=0,
)
"""A planner's failure, foreseen for 2.25 s."""


def equal(found: object, wanted: object, what: str) -> None:
    """Expect the very thing."""
    expect(found == wanted, f"{what}: {found!r}, not {wanted!r}.")


def alike(found: Floats | None, wanted: Floats | None, what: str) -> None:
    """Expect the same array, bit for bit, or none where there was none."""
    if found is None or wanted is None:
        expect(found is wanted, f"{what} came or went.")
        return
    expect(found.dtype == np.float32, f"{what} came back as {found.dtype}.")
    expect(found.shape == wanted.shape, f"{what} came back in another shape: {found.shape}.")
    expect(found.tobytes() == wanted.tobytes(), f"{what} came back with other numbers.")


def spec(**changes: Any) -> CampaignSpec:
    """A campaign of ten episodes."""
    fields: dict[str, Any] = {"name": "example", "method": "monte_carlo", "episodes": 10}
    return CampaignSpec(**fields | changes)


def running(store: Store, **changes: Any) -> Campaign:
    """A campaign that has begun."""
    return store.campaigns.move(store.campaigns.create(spec(**changes)).id, CampaignState.RUNNING)


def floats(seed: int, *shape: int) -> Floats:
    """Numbers of no meaning."""
    return np.random.default_rng(abs(seed)).standard_normal(shape).astype(np.float32)


def result(
    index: int, outcome: Outcome = Outcome.SAFE, steps: int = 3, salt: int = 0, **changes: Any
) -> EpisodeResult:
    """An episode that ran; another salt is another course of it."""
    collided = outcome is Outcome.COLLISION
    noise = NoiseTrajectory(
        floats(1_000 * salt + index, steps, 2), np.abs(floats(index, steps, 2)) + 1
    )
    measures = CRASH if collided else Measures(0.1 + index, min_ttc_s=1.25, clipped_steps=index)
    fields: dict[str, Any] = {
        "index": index,
        "seed": 100 + index,
        "outcome": outcome,
        "steps": steps,
        "noise": noise,
        "source": "prior",
        "measures": measures,
        "wall_s": 0.5,
    }
    return EpisodeResult(**fields | changes)


def collision(index: int, steps: int = 3, **changes: Any) -> EpisodeResult:
    """An episode that ended in a collision, with its scene and what a policy saw."""
    scene = Scene(
        dt_s=0.1,
        vehicles=floats(index, steps + 1, 2, 4),
        sizes=floats(index, 2, 2),
        perceived=floats(index, steps, 2),
        controls=floats(index, steps, 2),
    )
    states = floats(index, steps, len(STATE))
    fields: dict[str, Any] = {"scene": scene, "states": states, "source": "policy"}
    return result(index, Outcome.COLLISION, steps, **fields | changes)


def failed(index: int, message: str = "It raised.", **changes: Any) -> EpisodeResult:
    """An episode that could not be run."""
    fields: dict[str, Any] = {"measures": None, "fault": EpisodeFault("planner", message)}
    return result(index, Outcome.FAILED, 0, **fields | changes)


def deliver(store: Store, campaign: Campaign, *results: EpisodeResult) -> list[Verdict]:
    """Commit results, all in one."""
    return store.episodes.commit(campaign.id, [Delivery(each, WORKER) for each in results])


def analysis_result(failures: int = 4) -> AnalysisResult:
    """Two modes among some failures."""
    modes = tuple(FailureMode(failures // 2, n, floats(n, 3), floats(n, 5, 2)) for n in (0, 1))
    return AnalysisResult(
        episodes=tuple(range(failures)),
        explained=floats(1, 3),
        components=floats(2, 3, 5, 2),
        scores=floats(3, failures, 3),
        labels=tuple(n % 2 for n in range(failures)),
        modes=modes,
        influence=floats(4, 5, 2),
        silhouette=0.625,
        noise_silhouette=None,
    )
