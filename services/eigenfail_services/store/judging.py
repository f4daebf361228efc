"""What becomes of delivered results: pure, and the same in every store."""

from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any

import msgspec

from eigenfail.values import (
    FINAL_STATES,
    STATE,
    Campaign,
    Counts,
    EpisodeResult,
    Floats,
    Measures,
    Outcome,
    Shape,
    assess,
)
from eigenfail.values.randomness import MAX_SEED
from eigenfail.values.records import Delivery, EpisodeRow, Verdict

MAX_STEPS = 2**31 - 1

MEASURES = Measures.__struct_fields__
COUNTED = ("hard_brakings", "clipped_steps")
NOTHING_MEASURED: dict[str, Any] = dict.fromkeys(MEASURES)


class Kept(msgspec.Struct, frozen=True, eq=False):
    """A result that is the episode's one result.

    Attributes:
        result: as it can be stored: numbers that are not finite are gone.
        digest: of the result as it was delivered.
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
    """Judge results: the first that fits is kept, within one delivery too.

    Args:
        campaign: as it stands, locked.
        known: digests of those of the episodes that have a result.
        deliveries: what was brought.
    """
    digests = dict(known)
    judgement = Judgement([], [], [], campaign.counts)
    for delivery in deliveries:
        verdict = _verdict(campaign, digests, delivery.result)
        judgement.verdicts.append(verdict)
        if verdict is Verdict.KEPT:
            judgement.kept.append(_kept(delivery, campaign))
            digests[delivery.result.index] = judgement.kept[-1].digest
        if verdict is Verdict.ALARM:
            judgement.alarms.append(delivery)
    return msgspec.structs.replace(judgement, counts=_counted(judgement))


def _verdict(campaign: Campaign, digests: Mapping[int, str], result: EpisodeResult) -> Verdict:
    # What does not fit may not even have a digest.
    if campaign.state in FINAL_STATES or not _fits(result, campaign):
        return Verdict.UNWANTED
    if result.index not in digests:
        return Verdict.KEPT
    same = digests[result.index] == result.digest()
    return Verdict.DUPLICATE if same else Verdict.ALARM


def _kept(delivery: Delivery, campaign: Campaign) -> Kept:
    result = delivery.result
    kept = storable(result, campaign.spec.disturbance.shape)
    return Kept(kept, delivery.worker, result.digest())


def _fits(result: EpisodeResult, campaign: Campaign) -> bool:
    """Whether it belongs to the campaign, and can be read back as it was written."""
    noise, states = result.noise, result.states
    return (
        0 <= result.index < campaign.counts.planned
        and 0 <= result.seed <= MAX_SEED
        and 0 <= result.steps <= MAX_STEPS
        and _is_table(noise.z, 2)
        and noise.sigma.shape == noise.z.shape
        and (not len(noise.z) or noise.shape == campaign.spec.disturbance.shape)
        and (states is None or (_is_table(states, len(STATE)) and len(states) == result.steps))
    )


def _is_table(array: Floats, columns: int) -> bool:
    return array.ndim == 2 and array.shape[1] == columns


def _counted(judgement: Judgement) -> Counts:
    before = judgement.counts
    outcomes = [kept.result.outcome for kept in judgement.kept]
    failed = outcomes.count(Outcome.FAILED)
    again = judgement.verdicts.count(Verdict.DUPLICATE) + judgement.verdicts.count(Verdict.ALARM)
    return msgspec.structs.replace(
        before,
        completed=before.completed + len(outcomes) - failed,
        failures=before.failures + outcomes.count(Outcome.COLLISION),
        failed=before.failed + failed,
        duplicates=before.duplicates + again,
    )


def storable(result: EpisodeResult, shape: Shape) -> EpisodeResult:
    """The result without numbers that are not finite; without a robustness nothing was measured.

    Noise without a step, as of an episode that was never run, is given the campaign's shape.
    """
    return msgspec.structs.replace(
        result,
        noise=msgspec.structs.replace(result.noise, shape=shape),
        measures=_finite_measures(result.measures),
        wall_s=finite(result.wall_s) or 0.0,
    )


def _finite_measures(measures: Measures | None) -> Measures | None:
    if measures is None or not isfinite(measures.robustness_m):
        return None
    found: dict[str, Any] = {name: finite(getattr(measures, name)) for name in MEASURES}
    return Measures(**found | {name: count(getattr(measures, name)) for name in COUNTED})


def finite(number: float | None) -> float | None:
    """The number if it is one."""
    return number if number is not None and isfinite(number) else None


def count(number: int | None) -> int | None:
    """The number if it can be one of steps."""
    return number if number is not None and 0 <= number <= MAX_STEPS else None


def row_of(campaign: int, kept: Kept, at_ms: int) -> EpisodeRow:
    """A kept result as a line in a list."""
    result, fault = kept.result, kept.result.fault
    return EpisodeRow(
        assessed=assess(result.outcome, result.measures),
        problem=f"{fault.kind}: {fault.message}" if fault else "",
        **columns_of(campaign, kept, at_ms),
    )


def columns_of(campaign: int, kept: Kept, at_ms: int) -> dict[str, Any]:
    """What of a kept result can be looked for; a log-probability that is not finite reads 0."""
    result, measures = kept.result, kept.result.measures
    return {
        "campaign": campaign,
        "index": result.index,
        "seed": result.seed,
        "outcome": result.outcome,
        "steps": result.steps,
        "source": result.source,
        "worker": kept.worker,
        "log_probability": finite(result.noise.log_probability) or 0.0,
        "wall_s": result.wall_s,
        "finished_ms": at_ms,
        "digest": kept.digest,
        "has_scene": result.scene is not None,
        **(NOTHING_MEASURED if measures is None else msgspec.structs.asdict(measures)),
    }
