"""Example values for tests: campaign specifications, results of episodes, and findings."""

from typing import Any

import numpy as np

from eigenfail.values.analysis import AnalysisResult, FailureMode
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeFault, EpisodeResult, Outcome
from eigenfail.values.learning import STATE
from eigenfail.values.measures import Measures
from eigenfail.values.scene import Scene

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
"""A failure of the planner with a warning 2.25 s before it."""


def spec(**changes: Any) -> CampaignSpec:
    """Return the specification of a campaign of ten episodes."""
    fields: dict[str, Any] = {"name": "example", "method": "monte_carlo", "episodes": 10}
    return CampaignSpec(**fields | changes)


def floats(seed: int, *shape: int) -> Floats:
    """Return arbitrary numbers."""
    return np.random.default_rng(abs(seed)).standard_normal(shape).astype(np.float32)


def result(
    index: int, outcome: Outcome = Outcome.SAFE, steps: int = 3, salt: int = 0, **changes: Any
) -> EpisodeResult:
    """Return the result of a safe episode; another salt gives another course."""
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
    """Return the result of an episode with a collision, with every optional field set."""
    scene = Scene(
        dt_s=0.1,
        vehicles=floats(index, steps + 1, 2, 4),
        sizes=floats(index, 2, 2),
        perceived=floats(index, steps, 2),
        controls=floats(index, steps, 2),
    )
    states = floats(index, steps, len(STATE))
    fields: dict[str, Any] = {"scene": scene, "states": states, "source": "policy"}
    fields["importance"] = floats(index, steps)
    return result(index, Outcome.COLLISION, steps, **fields | changes)


def make_errored_result(index: int, message: str = "It raised.", **changes: Any) -> EpisodeResult:
    """Return the result of an errored episode."""
    fields: dict[str, Any] = {"measures": None, "fault": EpisodeFault("planner", message)}
    return result(index, Outcome.ERRORED, 0, **fields | changes)


def analysis_result(failures: int = 4) -> AnalysisResult:
    """Return two modes among some failures."""
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
