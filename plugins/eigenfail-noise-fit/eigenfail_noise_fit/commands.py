"""Fit the disturbance model p(x) to the log of a sensor, and show what a model means."""

from collections.abc import Iterable, Iterator, Sequence
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
from eigenfail.presentation import figures
from eigenfail.presentation.tables import Block, FactTable, Table, TableColumn
from eigenfail.progress import announce
from eigenfail.suites import LIKE_MODEL, read_disturbance
from eigenfail.values.channels import EGO, GHOST, Channel, split_name
from eigenfail.values.disturbance import AXES, DisturbanceModel
from eigenfail.values.shapes import ChannelShape, Shape, White
from eigenfail.worlds import describe_disturbance, list_channels, world_of
from eigenfail_noise_fit.events import MissBand
from eigenfail_noise_fit.log_file import read_log
from eigenfail_noise_fit.report import (
    SHARES,
    USUAL_STEP_S,
    CandidateScore,
    FitReport,
    describe_misses,
    describe_step,
    fit_log,
    format_channels,
    format_model,
)
from eigenfail_noise_fit.tier4 import import_noise

DISTANCES_M = {"longitudinal": (0.0, 10.0, 20.0, 50.0, 100.0), "lateral": (0.0, 2.0, 4.0, 8.0)}

app = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__)

LogFile = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        help="CSV or Parquet: track, time_s [s], true position dx_m, dy_m and reported position "
        "seen_dx_m, seen_dy_m of a vehicle from the ego [m]; heading_rad, speed_mps, length_m and "
        "width_m if known, each with what was reported as seen_heading_rad and so on; 30 tracks or "
        "more.",
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
        "--output",
        "-o",
        help="TOML file for the model, which must not exist yet (default: print only).",
    ),
]
Pictures = Annotated[
    Path | None,
    typer.Option(
        "--pictures", help="Folder for pictures of each channel as SVG, which must not exist yet."
    ),
]
ModelFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="TOML file of a disturbance model, or of a campaign.")
]


ParameterFile = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="ROS 2 parameter file (YAML) of scenario_simulator_v2."),
]
Farthest = Annotated[
    float,
    typer.Option(
        "--farthest",
        min=1.0,
        max=1000.0,
        help="Distance [m] up to which lines are fitted to the steps of the parameters.",
    ),
]
Config = Annotated[
    str | None,
    typer.Option(
        "--config", metavar="NAME", help="Noise configuration, if noise.v3 or noise.v4 has several."
    ),
]


@app.callback()
def _require_server() -> None:
    require_installed()


@app.command()
def fit(
    log: LogFile,
    step: Step = USUAL_STEP_S,
    output: Output = None,
    pictures: Pictures = None,
    as_json: AsJson = False,
) -> None:
    """Fit a disturbance model to a sensor's log, with intervals and checks."""
    _refuse_existing("--output", output)
    _refuse_existing("--pictures", pictures)
    with announce(f"Fitting a model to {log}"):
        fitted, report = fit_log(read_log(log, step))
    if output is not None:
        write_new(output, format_model(report, log.name), "--output")
    blocks = [*_list_blocks(report, output)]
    if pictures is not None:
        # matplotlib takes longer to import than most fits take.
        from eigenfail_noise_fit.pictures import draw_fit

        blocks.append(_write_pictures(draw_fit(fitted), pictures))
    show(report, as_json, *blocks)


@app.command(name="show")
def show_model(file: ModelFile, pictures: Pictures = None, as_json: AsJson = False) -> None:
    """Show the errors that a disturbance model draws, on a road at several distances."""
    _refuse_existing("--pictures", pictures)
    model = read_disturbance(file)
    of_function = _describe_noise_of_function(file, model)
    blocks = [*(of_function or _describe_model(model))]
    if pictures is not None:
        if of_function:
            problem = "noise of a function is not drawn."
            raise InvalidValue("--pictures", problem, "Leave the option out.")
        from eigenfail_noise_fit.pictures import draw_model

        blocks.append(_write_pictures(draw_model(model), pictures))
    show(model, as_json, *blocks)


@app.command(name="import")
def import_model(  # noqa: PLR0913, PLR0917 - typer makes an option of each argument
    file: ParameterFile,
    output: Output = None,
    step: Step = USUAL_STEP_S,
    farthest: Farthest = 100.0,
    config: Config = None,
    as_json: AsJson = False,
) -> None:
    """Import the perception noise of TIER IV's scenario_simulator_v2 as channels.

    Not all of it has a counterpart: what is left out is listed, and stands in the file as comments.
    """
    _refuse_existing("--output", output)
    imported = import_noise(file, step, farthest, config)
    if output is not None:
        lines = [
            (
                f"# Imported by `eigenfail noise import` from {file.name!a}, for steps of "
                f"{step:g} s and distances up to {farthest:g} m."
            ),
            *(f"# {sentence}" for sentence in imported.mapped),
            *(f"# Left out: {sentence}" for sentence in imported.left_out),
        ]
        text = "\n".join([*lines, "", format_channels(imported.channels)])
        write_new(output, text, "--output")
    model = DisturbanceModel(channels=imported.channels)
    blocks: list[Block] = [
        FactTable("Model", tuple(model.in_words().items())),
        *imported.mapped,
        *(f"Left out: {sentence}" for sentence in imported.left_out),
    ]
    if output is not None:
        blocks.append(f"Written to {output}.")
    show(imported._asdict(), as_json, *blocks)


def _refuse_existing(option: str, path: Path | None) -> None:
    if path is not None and path.exists():
        what = "file" if option == "--output" else "folder"
        remedy = f"Choose another {what}, or remove this one."
        raise InvalidValue(option, f"'{path}' exists already.", remedy)


def _write_pictures(pictures: Iterable[tuple[str, str]], folder: Path) -> str:
    """Write pictures, given by name and SVG, into a new folder; return a sentence that names them.

    Raises:
        InvalidValue: the folder cannot be made, or a file in it.
    """
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        problem = f"'{folder}' cannot be made: {error.strerror}."
        raise InvalidValue("--pictures", problem, "Choose another folder.") from error
    names = []
    for name, svg in pictures:
        names.append(f"{name}.svg")
        write_new(folder / names[-1], svg, "--pictures")
    return f"Pictures in {folder}: {', '.join(names)}."


def _list_blocks(report: FitReport, output: Path | None) -> Iterator[Block]:
    along, across = (report.distances_m[axis] for axis in AXES)
    yield FactTable(
        "Log",
        (
            ("tracks", str(report.tracks)),
            ("measurements", f"{report.measurements:,}, {report.step_s:g} s apart"),
            ("distances along the road", f"{along[0]:.3g} to {along[1]:.3g} m"),
            ("distances across it", f"{across[0]:.3g} to {across[1]:.3g} m"),
            ("missed", describe_misses(report)),
            ("ghosts", f"{report.misses.ghosts:,} measurements without a vehicle"),
            ("shape chosen", _name_shapes(report.model)),
        ),
    )
    yield _draw_parameters(report)
    yield _draw_shapes(report)
    if report.bands:
        yield _draw_bands(report.bands)
    yield _draw_checks(report)
    failed = sum(not check.holds for check in report.checks)
    if failed:
        yield f"{failed} of {len(report.checks)} checks do not hold: the log is not of this model."
    yield from report.remarks or ()
    if report.step_s != USUAL_STEP_S:
        yield describe_step(report.step_s)
    if output is not None:
        yield (
            f"Written to {output}. A campaign in the same folder uses it with disturbance = "
            f'"{output.name}".'
        )


def _name_shapes(model: DisturbanceModel) -> str:
    """Return the kind of the shape of a position, or of each channel."""
    if isinstance(model.channels, msgspec.UnsetType):
        return str(model.shape.__struct_config__.tag)
    return ", ".join(
        f"{channel.name} {(channel.shape or White()).__struct_config__.tag}"
        for channel in model.channels
    )


def _draw_parameters(report: FitReport) -> Table:
    note = "Intervals are of the jackknife over tracks."
    if any(one.name.startswith(f"{GHOST}.") for one in report.parameters):
        note = "Intervals are of the jackknife over tracks, of ghosts over stretches of time."
    return Table(
        "Parameters",
        (
            TableColumn("Parameter", is_figure=False),
            TableColumn("Value"),
            TableColumn("95 % interval"),
        ),
        tuple(
            (one.name, figures.format_number(one.value), figures.format_interval(one.interval))
            for one in report.parameters
        ),
        (note,),
    )


def _draw_shapes(report: FitReport) -> Table:
    by_channel = not isinstance(report.model.channels, msgspec.UnsetType)
    channel = TableColumn("Channel", is_figure=False)
    simplest = "the first one" if by_channel else "white"
    return Table(
        "Shapes",
        (
            *([channel] if by_channel else []),
            TableColumn("Shape", is_figure=False),
            TableColumn("Log density"),
            TableColumn(f"More than {simplest} [95 %]"),
        ),
        tuple(
            (
                *([str(one.channel)] if by_channel else []),
                one.kind,
                figures.format_number(one.held_out, 4),
                _format_gain(one),
            )
            for one in report.shapes
        ),
        ("Log densities are means per measurement, on tracks that were not fitted.",),
    )


def _format_gain(one: CandidateScore) -> str:
    if one.gain is None or one.interval is None:
        return ""
    return f"{figures.format_signed(one.gain)} {figures.format_signed_interval(one.interval)}"


def _draw_bands(bands: Sequence[MissBand]) -> Table:
    return Table(
        "Misses by distance",
        (
            TableColumn("Distance", "m", is_figure=False),
            TableColumn("Steps"),
            TableColumn("Missed"),
            TableColumn("95 % interval"),
            TableColumn("Runs begun"),
            TableColumn("Mean steps"),
        ),
        tuple(
            (
                f"{band.distance_m[0]:.3g} to {band.distance_m[1]:.3g}",
                band.steps,
                figures.format_share(band.share),
                figures.format_percent_interval(band.interval),
                band.begun,
                band.mean_steps,
            )
            for band in bands
        ),
        ("Distances are in the plane. The first step of each track is not counted.",),
    )


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
                figures.format_number(check.value),
                figures.format_interval(check.interval),
                figures.format_number(check.expected),
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
    """Return what holds for a campaign on a function; nothing if the file describes none."""
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
