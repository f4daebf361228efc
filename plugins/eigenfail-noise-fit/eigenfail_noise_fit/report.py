"""Result of `noise fit`: the model, evidence for it, and parts of the log that it leaves out."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np

from eigenfail.presentation.figures import count_noun, format_number, format_share
from eigenfail.values.channels import GHOST, MISSED, Channel
from eigenfail.values.disturbance import AXES, DisturbanceModel
from eigenfail.values.estimates import Interval
from eigenfail_noise_fit import fitting
from eigenfail_noise_fit.checks import (
    MAD_SIGMAS,
    ModelCheck,
    check_channels,
    check_position,
)
from eigenfail_noise_fit.events import (
    ChainFit,
    MissBand,
    choose_chain,
    find_chain_parameters,
    fit_chains,
    list_bands,
)
from eigenfail_noise_fit.jackknife import Parameter, ShapeScore, list_bounded
from eigenfail_noise_fit.sensor_log import EventSteps, SensorLog

USUAL_STEP_S = 0.1
"""Time step of the built-in scenarios. [s]"""

SHARES = {"50 %": 0.5, "95 %": 0.95, "99.9 %": 0.999}
"""Shares of errors whose size describes a model, by name."""

FEWEST_EVENTS = 20
"""Runs of an event, below which a report says that they are few."""

LARGE_SIGMA_RAD = 0.35
"""Errors of headings beyond this are improbable of a sensor, and usual of values in degrees."""

HALF_LANE_M = 1.75
PLANE = "plane"
"""Name of the distances in the plane, next to those of the axes."""


class Misses(msgspec.Struct, frozen=True):
    """Steps at which the sensor did not see the vehicle.

    Attributes:
        share: of all steps of the tracks.
        mean_steps: mean length of their runs; None if there are none.
        ghosts: number of measurements without a vehicle.
    """

    share: float
    mean_steps: float | None
    ghosts: int


class CandidateScore(msgspec.Struct, frozen=True):
    """How well a shape describes tracks that it was not fitted to; see `ShapeScore`.

    Attributes:
        channel: the channel that it was fitted to; absent if it is of the whole position.
    """

    kind: str
    held_out: float
    gain: float | None
    interval: Interval | None
    channel: str | msgspec.UnsetType = msgspec.UNSET


class FitReport(msgspec.Struct, frozen=True):
    """Result of `noise fit`: the model, evidence for it, and parts of the log that it leaves out.

    Attributes:
        bands: how often vehicles were missed by distance; absent if none was missed.
        remarks: what the model leaves out of the log, and which parameters lie on their bounds;
            absent if the model is of a position and there is none.
    """

    model: DisturbanceModel
    parameters: tuple[Parameter, ...]
    shapes: tuple[CandidateScore, ...]
    checks: tuple[ModelCheck, ...]
    misses: Misses
    tracks: int
    measurements: int
    distances_m: dict[str, tuple[float, float]]
    step_s: float
    bands: tuple[MissBand, ...] | msgspec.UnsetType = msgspec.UNSET
    remarks: tuple[str, ...] | msgspec.UnsetType = msgspec.UNSET


class FittedLog(NamedTuple):
    """A log, and the fits that were chosen.

    Attributes:
        fits: fits of errors, each of one channel or of the position.
        chains: fits of events, with their steps.
    """

    log: SensorLog
    fits: tuple[fitting.Fit, ...]
    chains: tuple[tuple[ChainFit, EventSteps], ...]


def fit_log(log: SensorLog) -> tuple[FittedLog, FitReport]:
    """Fit a model to a log: of the position if the log has nothing else, otherwise of channels.

    Raises:
        InvalidValue: the log does not determine all parameters.
    """
    if log.channels == AXES and not log.has_events:
        return _fit_position(log)
    return _fit_channels(log)


def _fit_position(log: SensorLog) -> tuple[FittedLog, FitReport]:
    errors = log.select(*AXES)
    fits = fitting.fit_shapes(errors)
    best = fitting.choose_fit(fits)
    remarks = _list_fit_remarks(log, (best,))
    report = FitReport(
        model=best.model,
        parameters=fitting.find_parameters(best, errors),
        shapes=tuple(_describe_score(fit.candidate.kind, fit.score) for fit in fits),
        checks=tuple(check_position(log, best)),
        misses=_count_misses(log),
        tracks=errors.tracks,
        measurements=len(errors.track),
        distances_m=_find_distances(log),
        step_s=log.step_s,
        remarks=tuple(remarks) if remarks else msgspec.UNSET,
    )
    return FittedLog(log, (best,), ()), report


def _fit_channels(log: SensorLog) -> tuple[FittedLog, FitReport]:
    tried = {name: fitting.fit_shapes(log.select(name)) for name in log.channels}
    events = _list_events(log)
    tried_chains = {
        name: fit_chains(name, steps, by_distance=name == MISSED) for name, steps in events.items()
    }
    fits = tuple(map(fitting.choose_fit, tried.values()))
    chains = tuple((choose_chain(tried_chains[name]), steps) for name, steps in events.items())
    parameters = [
        *(fitting.find_parameters(fit, log.select(*fit.channels)) for fit in fits),
        *(find_chain_parameters(*chain) for chain in chains),
    ]
    scores = [
        *(
            _describe_score(one.candidate.kind, one.score, name)
            for name in tried
            for one in tried[name]
        ),
        *(
            _describe_score(one.kind, one.score, name)
            for name in events
            for one in tried_chains[name]
        ),
    ]
    position = log.select(*AXES)
    distances = _find_distances(log) | {PLANE: (float(log.plane_m.min()), float(log.plane_m.max()))}
    report = FitReport(
        model=DisturbanceModel(channels=_list_channels(log, fits, chains)),
        parameters=tuple(one for some in parameters for one in some),
        shapes=tuple(scores),
        checks=tuple(check_channels(log, fits, chains)),
        misses=_count_misses(log),
        tracks=position.tracks,
        measurements=len(position.track),
        distances_m=distances,
        step_s=log.step_s,
        bands=list_bands(events[MISSED]) if MISSED in events else msgspec.UNSET,
        remarks=(*_list_fit_remarks(log, fits), *_list_remarks(log, chains)),
    )
    return FittedLog(log, fits, chains), report


def _list_events(log: SensorLog) -> dict[str, EventSteps]:
    events = {}
    if log.is_missed.any():
        events[MISSED] = log.list_miss_steps()
    if log.ghosts.steps is not None:
        events[GHOST] = log.ghosts.steps
    return events


def _list_channels(
    log: SensorLog, fits: Sequence[fitting.Fit], chains: Sequence[tuple[ChainFit, EventSteps]]
) -> tuple[Channel, ...]:
    """Return the channels of the model; a ghost is first seen at the median distance."""
    events = []
    for chain, _ in chains:
        ahead_m = None
        if chain.name == GHOST:
            ahead_m = float(np.clip(np.median(log.ghosts.first[:, 0]), 0.1, 500.0))
        events.append(Channel(chain.name, shape=chain.shape, ahead_m=ahead_m))
    return (*(fit.channel for fit in fits), *events)


def _describe_score(
    kind: str, score: ShapeScore, channel: str | msgspec.UnsetType = msgspec.UNSET
) -> CandidateScore:
    gain, interval = score.gain or (None, None)
    return CandidateScore(kind, score.held_out, gain, interval, channel)


def _count_misses(log: SensorLog) -> Misses:
    missed = int(log.is_missed.sum())
    return Misses(
        share=missed / len(log.track),
        mean_steps=missed / log.count_misses() if missed else None,
        ghosts=log.ghosts.measurements,
    )


def _find_distances(log: SensorLog) -> dict[str, tuple[float, float]]:
    return {
        axis: (float(values.min()), float(values.max()))
        for axis, values in zip(AXES, log.select(*AXES).distance_m.T, strict=True)
    }


def _list_fit_remarks(log: SensorLog, fits: Sequence[fitting.Fit]) -> list[str]:
    """Return parameters on their bounds, the unit of large heading errors, and unread columns."""
    remarks = [
        f"{said}: the model does not describe the errors, or the log is too short."
        for fit in fits
        for said in list_bounded(
            fitting.make_likelihood(fit.candidate, log.select(*fit.channels)), fit.best
        )
    ]
    if "heading" in log.channels:
        # By the median, since some headings that are turned do not change the unit of the others.
        errors = log.select("heading").error
        sigma = MAD_SIGMAS * float(np.median(np.abs(errors - np.median(errors))))
        if sigma > LARGE_SIGMA_RAD:
            remarks.append(
                f"Heading errors were read as radians: their sigma, {sigma:.2g} rad, is "
                f"{np.degrees(sigma):.0f}°. If the headings are in degrees, convert both columns."
            )
    if log.unread:
        remarks.append(f"Columns that are not read: {', '.join(log.unread)}.")
    return remarks


def _list_remarks(log: SensorLog, chains: Sequence[tuple[ChainFit, EventSteps]]) -> list[str]:
    """Return what the model leaves out of a log, in sentences."""
    remarks, ghosts = [], log.ghosts
    if float(log.is_missed.mean()) > 0.5:
        remarks.append("More than half of the rows are misses: check whether rows were matched.")
    for chain, steps in chains:
        begun = int((~steps.before & steps.now).sum())
        if begun < FEWEST_EVENTS:
            remarks.append(
                f"The log has only {count_noun(begun, 'run')} of '{chain.name}': its parameters "
                "are uncertain, and its checks find little."
            )
    if ghosts.behind:
        remarks.append(
            f"{count_noun(ghosts.behind, 'ghost')} first seen next to or behind the ego: left out."
        )
    if ghosts.apart:
        remarks.append(
            f"{count_noun(ghosts.apart, 'measurement')} of ghosts at times at which the log has "
            "no vehicle: left out."
        )
    aside = float(np.mean(np.abs(ghosts.first[:, 1]) > HALF_LANE_M)) if len(ghosts.first) else 0.0
    if aside:
        remarks.append(
            f"{format_share(aside)} of the ghosts ahead were first seen more than "
            f"{HALF_LANE_M:g} m aside; all ghosts of the model stand in the ego's lane."
        )
    return remarks


def describe_step(step_s: float) -> str:
    """Return which scenarios a model of this step is for."""
    return (
        f"The model is of steps of {step_s:g} s: use it in scenarios with this time step alone. "
        f"Those that come with eigenfail have {USUAL_STEP_S:g} s."
    )


def format_model(report: FitReport, source: str) -> str:
    """Return the TOML file of a fitted model, which a campaign names as its `disturbance`."""
    along, across = (report.distances_m[axis] for axis in AXES)
    failed = [check for check in report.checks if not check.holds]
    lines = [
        (
            f"# Fitted by `eigenfail noise fit` to {source!a}: {report.tracks} tracks, "
            f"{report.measurements} measurements, {report.step_s:g} s apart."
        ),
        (
            f"# Distances in the log: {along[0]:.3g} to {along[1]:.3g} m along the road, "
            f"{across[0]:.3g} to {across[1]:.3g} m across. Beyond them the model extrapolates."
        ),
        *(f"# Does not hold: {check.name}, {check.value:.3g}." for check in failed),
        *([f"# {describe_step(report.step_s)}"] if report.step_s != USUAL_STEP_S else []),
        *(f"# {remark}" for remark in report.remarks or ()),
    ]
    for parameter in report.parameters:
        low, high = parameter.interval.low, parameter.interval.high
        lines.append(f"# {parameter.name}: 95 % interval {low:.4g} to {high:.4g}")
    if isinstance(report.model.channels, msgspec.UnsetType):
        table = msgspec.toml.encode(_round_fields(msgspec.to_builtins(report.model))).decode()
        return "\n".join([*lines, "", table])
    return "\n".join([*lines, "", format_channels(report.model.channels)])


def format_channels(channels: Sequence[Channel]) -> str:
    """Return the TOML text of channels, a table for each."""
    return "\n".join(map(_format_channel, channels))


def _format_channel(channel: Channel) -> str:
    fields = _round_fields(msgspec.to_builtins(channel))
    shape: dict[str, object] = fields.pop("shape")
    given = {name: value for name, value in fields.items() if value is not None}
    lines = [_format_entry(name, value) for name, value in given.items()]
    inner = [_format_entry(name, value) for name, value in shape.items()]
    return "\n".join(["[[channels]]", *lines, f"shape = {{ {', '.join(inner)} }}", ""])


def _format_entry(name: str, value: object) -> str:
    return msgspec.toml.encode({name: value}).decode().strip()


def _round_fields(fields: dict[str, Any]) -> dict[str, Any]:
    """Return fields, including fields of inner tables, with six significant digits."""
    return {
        name: _round_fields(value) if isinstance(value, dict) else _round_number(value)
        for name, value in fields.items()
    }


def _round_number(value: object) -> object:
    return float(f"{value:.6g}") if isinstance(value, float) else value


def describe_misses(report: FitReport) -> str:
    """Return how many steps were missed, and in how long runs."""
    share = f"{format_share(report.misses.share)} of the steps"
    if report.misses.mean_steps is None:
        return share
    return f"{share}, in runs of {format_number(report.misses.mean_steps)} steps on average"
