"""Judging of delivered results: which are stored, and what follows. All functions are pure."""

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from typing import Any

import msgspec

from eigenfail.values.campaign import FINAL_STATES, Campaign, Counts
from eigenfail.values.disturbance import NoiseTrajectory, sum_log_densities
from eigenfail.values.episode import MAX_SEED, EpisodeResult, Outcome
from eigenfail.values.learning import count_state
from eigenfail.values.measures import MAX_MAGNITUDE, MEASURES, Measures
from eigenfail.values.records import Delivery, Verdict
from eigenfail_services.store.codec import NoiseForm, find_noise_form
from eigenfail_services.store.schema import clean_prose

MAX_STEPS = 2**31 - 1
_LARGEST = {
    name: MAX_STEPS if measure.is_count else MAX_MAGNITUDE
    for name, measure in MEASURES.items()
    if not measure.is_text
}
_TEXTS = [name for name, measure in MEASURES.items() if measure.is_text]
_NOTHING_MEASURED = (None,) * len(MEASURES)


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
        campaign: the locked campaign, with its present counts.
        known: digests of the episodes that have a result, by index.
        deliveries: the delivered results.
    """
    digests = dict(known)
    form = find_noise_form(campaign.spec)
    judgement = Judgement([], [], [], campaign.counts)
    for delivery in deliveries:
        verdict = _verdict(campaign, form, digests, delivery.result)
        judgement.verdicts.append(verdict)
        if verdict is Verdict.KEPT:
            judgement.kept.append(_to_kept(delivery, form))
            # A second result of the episode may be in the same group, and is compared with this
            # one.
            digests[delivery.result.index] = judgement.kept[-1].digest
        if verdict is Verdict.ALARM:
            judgement.alarms.append(delivery)
    return msgspec.structs.replace(judgement, counts=_update_counts(judgement))


def _verdict(
    campaign: Campaign, form: NoiseForm, digests: Mapping[int, str], result: EpisodeResult
) -> Verdict:
    # What does not fit may not even have a digest.
    if campaign.state in FINAL_STATES or not _fits(result, campaign, form):
        return Verdict.UNWANTED
    if result.index not in digests:
        return Verdict.KEPT
    same = digests[result.index] == result.digest()
    return Verdict.DUPLICATE if same else Verdict.ALARM


def _to_kept(delivery: Delivery, form: NoiseForm) -> Kept:
    result = delivery.result
    # The digest covers the result as it was delivered, because that is how a later duplicate will
    # be compared.
    return Kept(make_storable(result, form), delivery.worker, result.digest())


def _fits(result: EpisodeResult, campaign: Campaign, form: NoiseForm) -> bool:
    """Return whether a result belongs to the campaign, and can be read back as it was written."""
    noise, states, importance = result.noise, result.states, result.importance
    return (
        0 <= result.index < campaign.counts.planned
        and 0 <= result.seed <= MAX_SEED
        and 0 <= result.steps <= MAX_STEPS
        and noise.sigma.shape == noise.z.shape
        # An episode that never ran may not have come as far as the channels of its campaign.
        and ((noise.z.ndim == 2 and not len(noise.z)) or _has_form(noise, form))
        and (states is None or states.shape == (result.steps, count_state(form.channels)))
        and (importance is None or importance.shape == (result.steps,))
        and _is_judged(result, campaign)
    )


def _is_judged(result: EpisodeResult, campaign: Campaign) -> bool:
    """Return whether a result has a robustness of each requirement that its campaign names."""
    if result.outcome is Outcome.ERRORED:
        return not result.requirements
    named = len(campaign.spec.named_requirements)
    return len(result.requirements) == named and all(
        value is None or isfinite(value) for value in result.requirements
    )


def _has_form(noise: NoiseTrajectory, form: NoiseForm) -> bool:
    return noise.z.ndim == 2 and (noise.shape, noise.z.shape[1]) == form


def _update_counts(judgement: Judgement) -> Counts:
    before = judgement.counts
    outcomes = [kept.result.outcome for kept in judgement.kept]
    errored = outcomes.count(Outcome.ERRORED)
    again = judgement.verdicts.count(Verdict.DUPLICATE) + judgement.verdicts.count(Verdict.ALARM)
    return msgspec.structs.replace(
        before,
        completed=before.completed + len(outcomes) - errored,
        failures=before.failures + sum(outcome.is_failure for outcome in outcomes),
        errored=before.errored + errored,
        duplicates=before.duplicates + again,
    )


def make_storable(result: EpisodeResult, form: NoiseForm) -> EpisodeResult:
    """Return a result without invalid numbers; without a robustness it loses all measures.

    Noise without a step, as of an episode that never ran, gets the campaign's form. A result that
    needs no change is returned itself.
    """
    measures, wall_s = _finite_measures(result.measures), result.believed_wall_s
    is_storable = measures is result.measures and wall_s == result.wall_s
    if is_storable and _has_form(result.noise, form):
        return result
    z, sigma = (each.reshape(-1, form.channels) for each in (result.noise.z, result.noise.sigma))
    return msgspec.structs.replace(
        result,
        noise=msgspec.structs.replace(result.noise, z=z, sigma=sigma, shape=form.shape),
        measures=measures,
        wall_s=wall_s,
    )


def _finite_measures(measures: Measures | None) -> Measures | None:
    if measures is None:
        return None
    values = ((name, largest, getattr(measures, name)) for name, largest in _LARGEST.items())
    # Distances, times, counts, and magnitudes of speed, deceleration and jerk are never negative.
    invalid = [
        name for name, largest, value in values if value is not None and not 0 <= value <= largest
    ]
    # In a row, an episode without a robustness counts as one without measures.
    if "robustness_m" in invalid:
        return None
    changes: dict[str, Any] = dict.fromkeys(invalid)
    for name in _TEXTS:
        text = getattr(measures, name)
        if text is not None and clean_prose(text) != text:
            changes[name] = clean_prose(text)
    return msgspec.structs.replace(measures, **changes) if changes else measures


def keep_finite(number: float | None) -> float | None:
    """Return the number if it is finite, and no larger than anything that is measured."""
    # NaN fails this comparison, too.
    return number if number is not None and abs(number) <= MAX_MAGNITUDE else None


def make_rows(campaign: int, kept: Sequence[Kept], at_ms: int) -> list[tuple[Any, ...]]:
    """Return stored results as rows of `episodes`, in the order of the table's columns.

    An invalid log-probability becomes 0.
    """
    log_probabilities = sum_log_densities([each.result.noise for each in kept])
    return [
        _make_row(campaign, each, keep_finite(log_probability) or 0.0, at_ms)
        for each, log_probability in zip(kept, log_probabilities, strict=True)
    ]


def _make_row(campaign: int, kept: Kept, log_probability: float, at_ms: int) -> tuple[Any, ...]:
    result = kept.result
    measures, fault = result.measures, result.fault
    return (
        campaign,
        result.index,
        result.seed,
        result.outcome.value,
        result.steps,
        clean_prose(result.source),
        clean_prose(kept.worker),
        log_probability,
        *(_NOTHING_MEASURED if measures is None else msgspec.structs.astuple(measures)),
        result.wall_s,
        at_ms,
        kept.digest,
        result.scene is not None,
        fault and clean_prose(fault.kind),
        fault and clean_prose(fault.message),
    )
