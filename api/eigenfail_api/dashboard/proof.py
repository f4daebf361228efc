"""Proof by replay, as a part of the page of an analysis."""

from functools import partial

from eigenfail import values
from eigenfail.presentation.figures import UNKNOWN, format_number
from eigenfail.values.episode import ERRORED
from eigenfail_api.dashboard import rendering

CAME_TO_NOTHING = frozenset({values.CampaignState.CANCELLED, values.CampaignState.DEAD})
NOT_TRIED = rendering.Tile(UNKNOWN, ("no replay completed",))


def make_proof_view(found: values.Proof, unit: str) -> dict[str, object]:
    """Return what the page shows of an analysis's replays; robustness in a unit, or none."""
    replays = [replay for scenario in found.scenarios for replay in scenario.replays]
    cut_off = any(scenario.state in CAME_TO_NOTHING for scenario in found.scenarios)
    return {
        "found": found,
        "ended": sum(replay.outcome is not None for replay in replays),
        "planned": len(replays),
        # Asking replays something only where nothing was replayed, some of it was cut off, or
        # centres do not fail.
        "may_ask": not found.scenarios or cut_off or bool(found.done and found.unplaced),
        "tallies": make_tallies(found, unit),
        "describe": partial(describe_reproduction, unit=unit),
        "badge_of": make_scenario_badge,
        "outcomes": rendering.OUTCOME_BADGES,
    }


def make_tallies(found: values.Proof, unit: str) -> tuple[tuple[str, rendering.Tile], ...]:
    """Return the tiles of replays in the same scenario, and in all if there are several."""
    same = (("Eigenfailures, same scenario", describe_reproduction(found.reproduced, unit)),)
    count = len(found.scenarios)
    if count < 2:
        return (*same, ("Medoids", describe_reproduction(found.medoids, unit)))
    return (
        *same,
        (f"Eigenfailures, {count} scenarios", describe_reproduction(found.eigenfailures, unit)),
        (f"Medoids, {count} scenarios", describe_reproduction(found.medoids, unit)),
    )


def describe_reproduction(found: values.Reproduction, unit: str) -> rendering.Tile:
    """Return how many replays failed again, of those tried, and how near they came if none did.

    Args:
        found: count of the replays.
        unit: unit of robustness; empty for a function.
    """
    rate = found.rate
    if rate is None:
        return NOT_TRIED
    nearest = "\u00a0".join(filter(None, (format_number(found.smallest_robustness_m), unit)))
    lines = () if rate.k else (f"smallest robustness {nearest}",)
    return rendering.Tile(f"{rate.k} of {rate.n}", lines)


def make_scenario_badge(scenario: values.ProvenScenario) -> rendering.Badge:
    """Return the badge of the campaign that replays: errored if every replay of it errored."""
    ended = [replay.outcome for replay in scenario.replays if replay.outcome is not None]
    is_errored = bool(ended) and all(outcome is values.Outcome.ERRORED for outcome in ended)
    is_done = scenario.state is values.CampaignState.DONE
    return rendering.CAMPAIGN_BADGES[ERRORED if is_done and is_errored else scenario.state]
