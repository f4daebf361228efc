"""Which delivered results are stored, and what follows: pure functions."""

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from eigenfail.values import (
    FINAL_STATES,
    MEASURES,
    STATE,
    Campaign,
    Counts,
    EpisodeResult,
    Floats,
    Measures,
    Outcome,
    Shape,
)
from eigenfail.values.episode import MAX_SEED
from eigenfail.values.records import Delivery, Verdict

MAX_STEPS = 2**31 - 1
MAX_MAGNITUDE = 1e15
"""Of a measure or a log-probability: sums and squares over ten million episodes stay finite."""

NOTHING_MEASURED: dict[str, Any] = dict.fromkeys(MEASURES)


class Kept(msgspec.Struct, frozen=True, eq=False):
    """A result that becomes the stored result of its episode.

    Attributes:
        result: the stored form: numbers that are not finite are removed.
        digest: digest of the result as it was delivered.
    """

    result: EpisodeResult
    worker: str
    digest: str


class Judgement(msgspec.Struct, frozen=True, eq=False):
    """One verdict for each delivery, in order, and what follows from them."""

    verdicts: list[Verdict]
    kept: list[Kept]
    alarms: list[Delivery]
    counts: Counts


def judge(
    campaign: Campaign, known: Mapping[int, str], deliveries: Iterable[Delivery]
) -> Judgement:
    """Judge deliveries: the first fitting result of an episode is stored.

    Args:
        campaign: as it stands, locked.
        known: digests of those of the episodes that have a result.
        deliveries: the delivered results.
    """
    digests = dict(known)
    judgement = Judgement([], [], [], campaign.counts)
    for delivery in deliveries:
        verdict = _verdict(campaign, digests, delivery.result)
        judgement.verdicts.append(verdict)
        if verdict is Verdict.KEPT:
            judgement.kept.append(_to_kept(delivery, campaign))
            digests[delivery.result.index] = judgement.kept[-1].digest
        if verdict is Verdict.ALARM:
            judgement.alarms.append(delivery)
    return msgspec.structs.replace(judgement, counts=_update_counts(judgement))


def _verdict(campaign: Campaign, digests: Mapping[int, str], result: EpisodeResult) -> Verdict:
    # What does not fit may not even have a digest.
    if campaign.state in FINAL_STATES or not _fits(result, campaign):
        return Verdict.UNWANTED
    if result.index not in digests:
        return Verdict.KEPT
    same = digests[result.index] == result.digest()
    return Verdict.DUPLICATE if same else Verdict.ALARM


def _to_kept(delivery: Delivery, campaign: Campaign) -> Kept:
    result = delivery.result
    kept = make_storable(result, campaign.spec.disturbance.shape)
    return Kept(kept, delivery.worker, result.digest())


def _fits(result: EpisodeResult, campaign: Campaign) -> bool:
    """Return whether a result belongs to the campaign, and can be read back as it was written."""
    noise, states, importance = result.noise, result.states, result.importance
    return (
        0 <= result.index < campaign.counts.planned
        and 0 <= result.seed <= MAX_SEED
        and 0 <= result.steps <= MAX_STEPS
        and _is_table(noise.z, 2)
        and noise.sigma.shape == noise.z.shape
        and (not len(noise.z) or noise.shape == campaign.spec.disturbance.shape)
        and (states is None or (_is_table(states, len(STATE)) and len(states) == result.steps))
        and (importance is None or importance.shape == (result.steps,))
    )


def _is_table(array: Floats, columns: int) -> bool:
    return array.ndim == 2 and array.shape[1] == columns


def _update_counts(judgement: Judgement) -> Counts:
    before = judgement.counts
    outcomes = [kept.result.outcome for kept in judgement.kept]
    errored = outcomes.count(Outcome.ERRORED)
    again = judgement.verdicts.count(Verdict.DUPLICATE) + judgement.verdicts.count(Verdict.ALARM)
    return msgspec.structs.replace(
        before,
        completed=before.completed + len(outcomes) - errored,
        failures=before.failures + outcomes.count(Outcome.COLLISION),
        errored=before.errored + errored,
        duplicates=before.duplicates + again,
    )


def make_storable(result: EpisodeResult, shape: Shape) -> EpisodeResult:
    """Return a result without invalid numbers; without a robustness it has no measures.

    Noise without a step, as of an episode that never ran, gets the campaign's shape.
    """
    return msgspec.structs.replace(
        result,
        noise=msgspec.structs.replace(result.noise, shape=shape),
        measures=_finite_measures(result.measures),
        wall_s=result.believed_wall_s,
    )


def _finite_measures(measures: Measures | None) -> Measures | None:
    if measures is None or _valid_measure(measures.robustness_m) is None:
        return None
    found: dict[str, Any] = {
        name: (valid_count if measure.is_count else _valid_measure)(getattr(measures, name))
        for name, measure in MEASURES.items()
    }
    return Measures(**found)


def _valid_measure(number: float | None) -> float | None:
    # Distances, times, and magnitudes of speed, deceleration and jerk are never negative.
    return keep_finite(number) if number is not None and number >= 0.0 else None


def keep_finite(number: float | None) -> float | None:
    """Return the number if it is finite, and no larger than anything that is measured."""
    return number if number is not None and abs(number) <= MAX_MAGNITUDE else None


def valid_count(number: int | None) -> int | None:
    """Return the number if it can be a number of steps."""
    return number if number is not None and 0 <= number <= MAX_STEPS else None


def make_columns(campaign: int, kept: Kept, at_ms: int) -> dict[str, Any]:
    """Return the columns of a stored result; an invalid log-probability becomes 0."""
    result, measures = kept.result, kept.result.measures
    return {
        "campaign": campaign,
        "index": result.index,
        "seed": result.seed,
        "outcome": result.outcome,
        "steps": result.steps,
        "source": result.source,
        "worker": kept.worker,
        "log_probability": keep_finite(result.noise.log_probability) or 0.0,
        "wall_s": result.wall_s,
        "finished_ms": at_ms,
        "digest": kept.digest,
        "has_scene": result.scene is not None,
        **(NOTHING_MEASURED if measures is None else msgspec.structs.asdict(measures)),
    }
