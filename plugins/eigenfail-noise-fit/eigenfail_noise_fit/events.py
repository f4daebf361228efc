"""Fits of events, misses and ghosts, as Markov chains of two states.

The likelihood is the probability of each step given the previous step. The first step of a track
does not count: if a track begins when the sensor first sees the vehicle, the track begins with a
measurement by definition.
"""

from collections.abc import Sequence
from functools import partial

import msgspec
import numpy as np
from scipy import special

from eigenfail.errors import InvalidValue
from eigenfail.values.channels import GHOST
from eigenfail.values.estimates import Interval
from eigenfail.values.shapes import MOST_LIKELY, Markov
from eigenfail_noise_fit import jackknife
from eigenfail_noise_fit.sensor_log import Booleans, EventSteps

CONSTANT, GROWING = "constant", "with distance"
"""Candidates: how the probability that an event begins depends on the distance."""

LEAST_RATE = 1e-6
LONGEST_STEPS = 1000.0
MOST_ENDING = 1.0 - 1e-6
"""Largest probability that an event ends at a step: of 1, a longer one would be impossible."""

RATE, DURATION, GROWTH = 0, 1, 2
"""Places of the parameters: the rate, 1 ÷ the mean duration, and the growth of the rate."""

FEWEST_BLOCKS = 2
"""Blocks with a run of an event: without the only one, the jackknife knows no duration."""

BANDS = 5
"""Most bands of distance, with as many steps in each."""

UNDETERMINED = (
    "its distances do not tell how often vehicles are missed at them.",
    "Log vehicles at different distances.",
)


class ChainFit(msgspec.Struct, frozen=True, eq=False):
    """The best parameters of one chain.

    Attributes:
        kind: whether the rate depends on the distance: `CONSTANT` or `GROWING`.
        name: the channel.
        best: parameters of largest likelihood: rate, 1 ÷ mean duration, and growth, if any.
        score: log probability of a step of tracks that were not fitted, and its gain over a
            constant rate.
    """

    kind: str
    name: str
    best: jackknife.Array
    score: jackknife.ShapeScore

    @property
    def shape(self) -> Markov:
        """The channel's shape with the fitted parameters."""
        rate, ends, *growth = self.best.tolist()
        duration = 1.0 / ends
        return Markov(rate, duration, *growth)

    def compute_probability(self, steps: EventSteps) -> jackknife.Array:
        """Return the probability that the event lasts at each step, given the one before."""
        return _compute_probability(steps, self.best)


def fit_chains(name: str, steps: EventSteps, *, by_distance: bool) -> list[ChainFit]:
    """Return the fits of a chain with a constant rate, and of one whose rate grows.

    Args:
        name: the channel.
        steps: steps of the event.
        by_distance: whether to fit the second one.

    Raises:
        InvalidValue: no event begins or ends within a block, so that its rate or its duration
            cannot be estimated.
    """
    _refuse_endless(name, steps)
    kinds = (CONSTANT, GROWING) if by_distance else (CONSTANT,)
    likelihoods = [_make_likelihood(kind, name, steps) for kind in kinds]
    scores = jackknife.compare_candidates(likelihoods)
    return [
        ChainFit(kind, name, jackknife.maximize_likelihood(likelihood), score)
        for kind, likelihood, score in zip(kinds, likelihoods, scores, strict=True)
    ]


def choose_chain(fits: Sequence[ChainFit]) -> ChainFit:
    """Return the last fit whose gain over the first one has an interval above 0, or the first."""
    return [fit for fit in fits if fit is fits[0] or fit.score.is_better][-1]


def find_chain_parameters(fit: ChainFit, steps: EventSteps) -> tuple[jackknife.Parameter, ...]:
    """Return the parameters with the intervals of the jackknife over blocks.

    The interval of a probability that is the same at all steps includes the exact one for
    independent steps, as few events differ little between blocks.

    Raises:
        InvalidValue: the log does not determine all parameters.
    """
    found = list(
        jackknife.estimate_parameters(_make_likelihood(fit.kind, fit.name, steps), fit.best)
    )
    if fit.kind == CONSTANT:
        found[RATE] = _widen(found[RATE], steps.now[~steps.before], MOST_LIKELY)
    ends = _widen(_invert(found[DURATION]), ~steps.now[steps.before], 1.0)
    found[DURATION] = _invert(ends)
    return tuple(found)


def _invert(one: jackknife.Parameter) -> jackknife.Parameter:
    low, high = one.interval.low, one.interval.high
    return jackknife.Parameter(one.name, 1.0 / one.value, Interval(1.0 / high, 1.0 / low))


def _widen(one: jackknife.Parameter, happened: Booleans, most: float) -> jackknife.Parameter:
    """Return a probability with at least the interval of independent steps."""
    wide = jackknife.widen_share(one.interval, int(happened.sum()), len(happened))
    interval = Interval(max(wide.low, LEAST_RATE), min(wide.high, most))
    return msgspec.structs.replace(one, interval=interval)


def _refuse_endless(name: str, steps: EventSteps) -> None:
    begins, ends = (~steps.before & steps.now).any(), (steps.before & ~steps.now).any()
    if not begins or not ends:
        what = "begins" if not begins else "ends"
        raise InvalidValue(
            "track",
            f"no run of '{name}' {what} between two steps of the log, so that "
            f"{'its rate' if not begins else 'how long it lasts'} cannot be told.",
            "Log vehicles for longer, or leave out the rows without a measurement at the ends of "
            "tracks.",
        )
    if len(np.unique(steps.block[steps.before])) < FEWEST_BLOCKS:
        where = "stretch of time" if name == GHOST else "track"
        raise InvalidValue(
            "track",
            f"runs of '{name}' lie in a single {where}, so that it cannot be told how much their "
            "duration differs.",
            f"Log vehicles for longer, or leave out the rows of '{name}'.",
        )


def _make_likelihood(kind: str, name: str, steps: EventSteps) -> jackknife.Likelihood:
    absent, lasting = ~steps.before, steps.before
    rate = float(steps.now[absent].mean())
    ends = float((~steps.now[lasting]).mean())
    unit = min(max(rate, LEAST_RATE), MOST_LIKELY)
    parameters = [
        jackknife.FreeParameter(
            f"{name}.rate",
            (LEAST_RATE, MOST_LIKELY),
            unit if kind == CONSTANT else 0.5 * unit,
            unit,
            is_scale=kind == CONSTANT,
            least_scale=unit,
        ),
        jackknife.FreeParameter(
            f"{name}.mean_steps",
            (1.0 / LONGEST_STEPS, MOST_ENDING),
            min(max(ends, 1.0 / LONGEST_STEPS), MOST_ENDING),
            is_scale=True,
            is_inverse=True,
        ),
    ]
    if kind == GROWING:
        slope = unit / max(float(steps.distance_m.mean()), 1.0)
        growth = jackknife.FreeParameter(
            f"{name}.rate_per_m", (0.0, MOST_LIKELY), 0.5 * slope, slope, least_scale=slope
        )
        parameters.append(growth)
    return jackknife.Likelihood(
        tuple(parameters),
        partial(_compute_density, steps),
        steps.block,
        steps.blocks,
        UNDETERMINED,
    )


def _compute_density(steps: EventSteps, parameters: jackknife.Array) -> jackknife.Array:
    """Return the log probability of each step given the one before, shape (n,)."""
    p = _compute_probability(steps, parameters)
    density: jackknife.Array = special.xlogy(steps.now, p) + special.xlog1py(~steps.now, -p)
    return density


def _compute_probability(steps: EventSteps, parameters: jackknife.Array) -> jackknife.Array:
    growth = parameters[GROWTH] if len(parameters) > GROWTH else 0.0
    begins = np.minimum(parameters[RATE] + growth * steps.distance_m, MOST_LIKELY)
    p: jackknife.Array = np.where(steps.before, 1.0 - parameters[DURATION], begins)
    return p


class MissBand(msgspec.Struct, frozen=True):
    """How often vehicles in a band of distances were missed.

    Attributes:
        distance_m: smallest and largest distance. [m]
        steps: number of steps.
        share: share of the steps at which the vehicle was missed.
        interval: its 95 % interval by the jackknife over tracks, at least as wide as for
            independent steps.
        begun: number of runs that began there.
        mean_steps: mean duration of misses, steps missed by runs that ended; None if none did.
    """

    distance_m: tuple[float, float]
    steps: int
    share: float
    interval: Interval
    begun: int
    mean_steps: float | None


def list_bands(steps: EventSteps) -> tuple[MissBand, ...]:
    """Return the bands of distance, from near to far, of the steps that follow another one."""
    edges = np.unique(np.quantile(steps.distance_m, np.linspace(0.0, 1.0, BANDS + 1)))
    band = np.clip(np.searchsorted(edges, steps.distance_m, "right") - 1, 0, len(edges) - 2)
    return tuple(_measure_band(steps, band == number) for number in np.unique(band))


def _measure_band(steps: EventSteps, inside: Booleans) -> MissBand:
    distance = steps.distance_m[inside]
    counts = np.bincount(steps.block, inside, steps.blocks).astype(float)
    sums = np.bincount(steps.block, inside & steps.now, steps.blocks).astype(float)
    share, interval = jackknife.find_ratio_interval(sums, counts)
    missed, n = int(sums.sum()), int(counts.sum())
    ended = int((inside & steps.before & ~steps.now).sum())
    lasted = int((inside & steps.before).sum())
    wide = jackknife.widen_share(interval, missed, n)
    return MissBand(
        distance_m=(float(distance.min()), float(distance.max())),
        steps=n,
        share=share,
        interval=Interval(max(wide.low, 0.0), min(wide.high, 1.0)),
        begun=int((inside & ~steps.before & steps.now).sum()),
        mean_steps=lasted / ended if ended else None,
    )
