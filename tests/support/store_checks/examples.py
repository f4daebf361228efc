"""What the checks of a store put into it, and how they compare what they find."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from accepted import accept_spec

from eigenfail.testing import expect
from eigenfail.testing.examples import floats, result, spec
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery, Verdict
from eigenfail_services.campaigns.analysis_jobs import run_analysis
from eigenfail_services.store.store import Store

WORKER = "worker-1"
BEYOND = (0, -1, 999, 2**63, 2**70)
"""Ids that nothing has."""


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


def running(store: Store, **changes: Any) -> Campaign:
    """A campaign that has begun."""
    return store.campaigns.move(
        store.campaigns.create(accept_spec(spec(**changes))).id, CampaignState.RUNNING
    )


def name_channels(count: int) -> dict[str, Any]:
    """The fields of a campaign on a function of noise with so many channels, of three steps."""
    channels = [f"c{number}" for number in range(count)]
    return {
        "simulator": "function",
        "scenario": "function",
        "planner": "m:f",
        "scenario_parameters": {"steps": 3, "channels": channels},
    }


def analyse_function(store: Store, channels: Sequence[str], axes: str = "joint") -> tuple[int, int]:
    """A campaign on a function with 24 failures of nine steps, and its analysis; their ids.

    Half of the failures have a push in the last channel.
    """
    fields = name_channels(len(channels))
    fields["scenario_parameters"] = {"steps": 9, "channels": [*channels]}
    campaign = running(store, name="function", method="monte_carlo", episodes=24, **fields).id
    noise = np.random.default_rng(1).normal(size=(24, 9, len(channels))).astype(np.float32)
    noise[:12, 4, -1] += 9.0
    failures = [
        EpisodeResult(
            index=index,
            seed=index,
            outcome=Outcome.COLLISION,
            steps=9,
            noise=NoiseTrajectory(z, np.ones_like(z)),
            source="prior",
            measures=Measures(0.0),
        )
        for index, z in enumerate(noise)
    ]
    store.episodes.commit(campaign, [Delivery(each, WORKER) for each in failures])
    settings = AnalysisSettings(axes=axes, clusters=2, bootstrap=0)
    analysis = store.analyses.create(campaign, settings).id
    run_analysis(store, analysis)
    return campaign, analysis


def noise_of(channels: int, index: int = 0, steps: int = 3) -> NoiseTrajectory:
    """Noise of so many channels."""
    z = floats(index, steps, channels)
    return NoiseTrajectory(z, np.ones_like(z))


def result_of(channels: int, index: int = 0, **changes: Any) -> EpisodeResult:
    """The result of an episode on a function of noise with so many channels."""
    return result(index, **{"noise": noise_of(channels, index)} | changes)


def deliver(store: Store, campaign: Campaign, *results: EpisodeResult) -> list[Verdict]:
    """Commit results, all in one."""
    return store.episodes.commit(campaign.id, [Delivery(each, WORKER) for each in results])
