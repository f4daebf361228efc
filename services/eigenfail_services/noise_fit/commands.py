"""`eigenfail noise`: a disturbance model from a sensor's log, and what a model means."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from scipy import stats

from eigenfail.cli.options import AsJson
from eigenfail.cli.render import show
from eigenfail.cli.specs import read_spec
from eigenfail.errors import InvalidValue
from eigenfail.files import read_toml, write_new
from eigenfail.hosting.service import require_installed
from eigenfail.presentation.figures import (
    format_interval,
    format_number,
    format_share,
    format_signed,
    format_signed_interval,
)
from eigenfail.presentation.tables import Block, FactTable, Table, TableColumn
from eigenfail.presentation.terminal import render
from eigenfail.suites import LIKE_MODEL, read_disturbance
from eigenfail.values import AXES, DisturbanceModel, Interval
from eigenfail.values.channels import EGO, Channel, split_name
from eigenfail.values.shapes import ChannelShape, Shape
from eigenfail.worlds import describe_disturbance, list_channels, world_of
from eigenfail_services.noise_fit.checks import ModelCheck, check_fit
from eigenfail_services.noise_fit.fitting import (
    Fit,
    Parameter,
    choose_fit,
    find_parameters,
    fit_shapes,
)
from eigenfail_services.noise_fit.sensor_log import SensorLog, read_log

DISTANCES_M = {"longitudinal": (0.0, 10.0, 20.0, 50.0, 100.0), "lateral": (0.0, 2.0, 4.0, 8.0)}
SHARES = {"50 %": 0.5, "95 %": 0.95, "99.9 %": 0.999}

USUAL_STEP_S = 0.1
"""Time step of the built-in scenarios. [s]"""

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Fit the disturbance model p(x) to the log of a sensor, and show what a model means.",
)

LogFile = Annotated[
    Path,
    typer.Argument(
        metavar="LOG",
        help="CSV or Parquet: track, time_s [s], true position dx_m, dy_m and reported position "
        "seen_dx_m, seen_dy_m of a vehicle from the ego [m]; 30 tracks or more.",
    ),
]
Step = Annotated[
    float,
    typer.Option(
        "--step",
        min=1e-3,
        max=10.0,
        help="Period of the log [s]; the model is for scenarios with this time step.",
    ),
]
Output = Annotated[
    Path | None,
    typer.Option(
        "--output", help="TOML file for the model, which must not exist yet (default: print only)."
    ),
]
ModelFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="TOML file of a disturbance model, or of a campaign.")
]


class Misses(msgspec.Struct, frozen=True):
    """Steps at which the sensor did not see the vehicle.

    Attributes:
        share: of all steps of the tracks.
        mean_steps: mean length of their runs; None where there are none.
        ghosts: number of measurements without a vehicle.
    """

    share: float
    mean_steps: float | None
    ghosts: int


class ShapeScore(msgspec.Struct, frozen=True):
    """How well a shape describes tracks that it was not fitted to; see `Fit`."""

    kind: str
    held_out: float
    gain: float | None
    interval: Interval | None


class FitReport(msgspec.Struct, frozen=True):
    """What `noise fit` found: the model, what speaks for it, and what it leaves out."""

    model: DisturbanceModel
    parameters: tuple[Parameter, ...]
    shapes: tuple[ShapeScore, ...]
    checks: tuple[ModelCheck, ...]
    misses: Misses
    tracks: int
    measurements: int
    distances_m: dict[str, tuple[float, float]]
    step_s: float


@app.callback()
def _require_server() -> None:
    require_installed()


@app.command()
def fit(
    log: LogFile, step: Step = USUAL_STEP_S, output: Output = None, as_json: AsJson = False
) -> None:
    """Fit a disturbance model to a sensor's log, with intervals and checks."""
    if output is not None and output.exists():
        remedy = "Choose another file, or remove this one."
        raise InvalidValue("--output", f"'{output}' exists already.", remedy)
    errors = read_log(log, step)
    report = make_report(errors, fit_shapes(errors))
    if output is not None:
        write_new(output, format_model(report, log.name), "--output")
    show(report, as_json, lambda: render(*_list_blocks(report, output)))


@app.command(name="show")
def show_model(file: ModelFile, as_json: AsJson = False) -> None:
    """Show the errors that a disturbance model draws, on a road at several distances."""
    model = read_disturbance(file)
    blocks = tuple(_describe_noise_of_function(file, model) or _describe_model(model))
    show(model, as_json, lambda: render(*blocks))


def make_report(log: SensorLog, fits: Sequence[Fit]) -> FitReport:
    """Return what was found of a log, given the fits of all shapes."""
    best = choose_fit(fits)
    return FitReport(
        model=best.model,
        parameters=find_parameters(best, log),
        shapes=tuple(map(_score, fits)),
        checks=tuple(check_fit(log, best)),
        misses=Misses(
            share=log.missed / (log.missed + len(log.track)),
            mean_steps=log.missed / log.misses if log.misses else None,
            ghosts=log.ghosts,
        ),
        tracks=log.tracks,
        measurements=len(log.track),
        distances_m={
            axis: (float(values.min()), float(values.max()))
            for axis, values in zip(AXES, log.distance_m.T, strict=True)
        },
        step_s=log.step_s,
    )


def _score(one: Fit) -> ShapeScore:
    gain, interval = one.gain or (None, None)
    return ShapeScore(one.candidate.kind, one.held_out, gain, interval)


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
        *([f"# {_describe_step(report.step_s)}"] if report.step_s != USUAL_STEP_S else []),
    ]
    for parameter in report.parameters:
        low, high = parameter.interval.low, parameter.interval.high
        lines.append(f"# {parameter.name}: 95 % interval {low:.4g} to {high:.4g}")
    table = msgspec.toml.encode(_round(report.model)).decode()
    return "\n".join([*lines, "", table])


def _round(model: DisturbanceModel) -> dict[str, object]:
    """Return the fields of a model with six significant digits."""
    fields = msgspec.to_builtins(model)
    shape = {name: _round_number(value) for name, value in fields.pop("shape").items()}
    return {**{name: _round_number(value) for name, value in fields.items()}, "shape": shape}


def _round_number(value: object) -> object:
    return float(f"{value:.6g}") if isinstance(value, float) else value


def _list_blocks(report: FitReport, output: Path | None) -> Iterator[Block]:
    along, across = (report.distances_m[axis] for axis in AXES)
    yield FactTable(
        "Log",
        (
            ("tracks", str(report.tracks)),
            ("measurements", f"{report.measurements:,}, {report.step_s:g} s apart"),
            ("distances along the road", f"{along[0]:.3g} to {along[1]:.3g} m"),
            ("distances across it", f"{across[0]:.3g} to {across[1]:.3g} m"),
            ("missed", _describe_misses(report.misses)),
            ("ghosts", f"{report.misses.ghosts:,} measurements without a vehicle"),
            ("shape chosen", str(report.model.shape.__struct_config__.tag)),
        ),
    )
    yield _draw_parameters(report)
    yield _draw_shapes(report)
    yield _draw_checks(report)
    failed = sum(not check.holds for check in report.checks)
    if failed:
        yield f"{failed} of {len(report.checks)} checks do not hold: the log is not of this model."
    if report.step_s != USUAL_STEP_S:
        yield _describe_step(report.step_s)
    if output is not None:
        yield (
            f"Written to {output}. A campaign in the same folder uses it with disturbance = "
            f'"{output.name}".'
        )


def _describe_step(step_s: float) -> str:
    return (
        f"The model is of steps of {step_s:g} s: use it in scenarios with this time step alone. "
        f"Those that come with eigenfail have {USUAL_STEP_S:g} s."
    )


def _describe_misses(misses: Misses) -> str:
    share = f"{format_share(misses.share)} of the steps"
    if misses.mean_steps is None:
        return share
    return f"{share}, in runs of {misses.mean_steps:.2g} steps on average; not part of the model"


def _draw_parameters(report: FitReport) -> Table:
    return Table(
        "Parameters",
        (
            TableColumn("Parameter", is_figure=False),
            TableColumn("Value"),
            TableColumn("95 % interval"),
        ),
        tuple(
            (one.name, format_number(one.value), format_interval(one.interval))
            for one in report.parameters
        ),
        ("Intervals are of the jackknife over tracks.",),
    )


def _draw_shapes(report: FitReport) -> Table:
    return Table(
        "Shapes",
        (
            TableColumn("Shape", is_figure=False),
            TableColumn("Log density"),
            TableColumn("More than white [95 %]"),
        ),
        tuple(
            (
                one.kind,
                format_number(one.held_out, 4),
                _format_gain(one),
            )
            for one in report.shapes
        ),
        ("Log densities are means per measurement, on tracks that were not fitted.",),
    )


def _format_gain(one: ShapeScore) -> str:
    if one.gain is None or one.interval is None:
        return ""
    return f"{format_signed(one.gain)} {format_signed_interval(one.interval)}"


def _draw_checks(report: FitReport) -> Table:
    return Table(
        "Checks",
        (
            TableColumn("Check", is_figure=False),
            TableColumn("Observed"),
            TableColumn("Interval"),
            TableColumn("Expected"),
            TableColumn("Verdict", is_figure=False),
        ),
        tuple(
            (
                check.name,
                format_number(check.value),
                format_interval(check.interval),
                format_number(check.expected),
                "holds" if check.holds else f"does not hold. {check.remedy}",
            )
            for check in report.checks
        ),
        (
            (
                "z is what the model makes of the errors, standard normal if the model is correct. "
                "Then all checks hold with a probability of 99 %; that they hold is no proof."
            ),
        ),
    )


def _describe_model(model: DisturbanceModel) -> Iterator[Block]:
    yield FactTable("Model", tuple(model.in_words().items()))
    for channel in model.list_channels():
        if channel.sigma is not None:
            yield _draw_sizes(channel, channel.sigma, model)


def _draw_sizes(channel: Channel, base: float, model: DisturbanceModel) -> Table:
    """Return the size of the errors of a continuous channel by distance."""
    shape = channel.shape or model.shape
    factors = [_find_quantile(shape, share) for share in SHARES.values()]
    target, quantity = split_name(channel.name)
    distances = DISTANCES_M.get(quantity, DISTANCES_M[AXES[0]])
    along = f"{quantity} distance" if quantity in DISTANCES_M else "distance"
    rows = [
        (distance, model.scale * ((channel.sigma_per_m or 0.0) * distance + base))
        for distance in ((0.0,) if target == EGO else distances)
    ]
    return Table(
        f"{channel.name} errors".capitalize(),
        (
            TableColumn(f"{along} [m]".capitalize()),
            TableColumn("Sigma"),
            *(TableColumn(words) for words in SHARES),
        ),
        tuple((distance, at, *(factor * at for factor in factors)) for distance, at in rows),
        (
            (
                f"Size of {channel.name} errors [{channel.unit}]: sigma, and what 50 %, 95 % and "
                "99.9 % do not exceed."
            ),
        ),
    )


def _describe_noise_of_function(file: Path, model: DisturbanceModel) -> Sequence[Block]:
    """Return what holds for a campaign on a function; nothing where the file describes none."""
    if world_of(str(read_toml(file, LIKE_MODEL).get("simulator"))).has_road:
        return ()
    spec = read_spec(file)
    channels = list_channels(spec)
    facts = (("channels", ", ".join(channels)), *describe_disturbance(spec).items())
    sizes = (model.scale * _find_quantile(model.shape, share) for share in SHARES.values())
    table = Table(
        "Noise of each channel",
        (TableColumn("Sigma"), *(TableColumn(words) for words in SHARES)),
        ((model.scale, *sizes),),
        ("Size of the noise at every step: sigma, and what 50 %, 95 % and 99.9 % do not exceed.",),
    )
    return (FactTable("Model", facts), table)


def _find_quantile(shape: Shape | ChannelShape, share: float) -> float:
    """Return the size below which this share of standardised errors lies. [sigma]"""
    upper = float(stats.norm.ppf(0.5 + 0.5 * share))
    return shape.step((upper,), None, (1.0,))[0]
