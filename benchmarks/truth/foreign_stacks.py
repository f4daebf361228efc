"""Figures: driving stacks of other authors, their failures without noise, by chance and by search.

The episodes without noise run at several points of a scenario, the campaigns at its defaults. Each
campaign has its own service, whose worker has the bridge. A film of the worst failure of each stack
is written to docs/pictures/stacks.
"""

import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import ROOT, Figure
from benchmarks.samples import COMMAND, count_share
from benchmarks.truth.foreign import ALL, FOLDER, PYTHON, Example, serve_bridge
from msgspec.structs import replace

from eigenfail.bridges import ADDRESS_VARIABLE
from eigenfail.cli.specs import read_spec
from eigenfail.client import Client
from eigenfail.values.episode import EpisodeTask, Outcome, TrajectorySource
from eigenfail.worlds import world_of
from eigenfail_workers.bridge.connection import SharedConnection
from eigenfail_workers.bridge.engine import BridgeEngine

FILMS = ROOT / "docs" / "pictures" / "stacks"


class Stack(NamedTuple):
    """A driving stack of other authors.

    Attributes:
        package: the package that it comes from.
        example: its bridge, and its campaign file, which has the settings of AST.
        points: values of a parameter of the scenario, at which it drives without noise.
        episodes: budget of each method.
    """

    package: str
    example: Example
    points: tuple[str, Sequence[float]]
    episodes: int


def python(bridge: str) -> tuple[str, ...]:
    """The command that starts a bridge in Python, without the address."""
    return PYTHON, str(FOLDER / bridge)


STACKS = {
    "sumo": Stack(
        "libsumo",
        Example(python("sumo_bridge.py"), "sumo.toml", {"ACC": ALL}),
        ("gap_m", [*map(float, range(16, 41))]),
        100,
    ),
    "idm_vehicle": Stack(
        "highway-env",
        Example(python("idm_vehicle_bridge.py"), "idm_vehicle.toml", {"IDMVehicle": ALL}),
        ("traffic", range(50)),
        200,
    ),
    "fiss_plus": Stack(
        "fiss-planner",
        Example(python("fiss_bridge.py"), "fiss.toml", {"fiss_plus": ALL}),
        ("gap_m", [*map(float, range(26, 51))]),
        200,
    ),
    "dqn": Stack(
        "stable-baselines3",
        Example(python("dqn_bridge.py"), "dqn.toml", {"DQN": ALL}),
        ("traffic", range(50)),
        100,
    ),
}


def list_missing(stack: Stack) -> tuple[str, ...]:
    """Return the package of a stack, if it is not installed."""
    return list_missing_package(stack.package)


def list_missing_package(package: str) -> tuple[str, ...]:
    """Return a package, if it is not installed."""
    try:
        distribution(package)
    except PackageNotFoundError:
        return (package,)
    return ()


def find(name: str, _crew: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Yield the figures of one stack."""
    stack, place = STACKS[name], f"foreign.{name}"
    with TemporaryDirectory() as folder, serve_bridge(stack.example, Path(folder)) as client:
        yield f"{place}.undisturbed", drive_undisturbed(stack)
        found = {method: launch(client, stack, method, seed) for method in ALL}
        for method, campaign in found.items():
            yield f"{place}.{method}", tell_failures(client, campaign, method, stack.episodes)
        searched = max(found.values(), key=lambda each: count_failures(client, each))
        yield f"{place}.modes", count_modes(client, searched)
        yield f"{place}.worst", film_worst(client, found, FILMS / f"{name}.gif")


def count_stacks(figures: Mapping[str, Figure]) -> Iterator[tuple[str, Figure]]:
    """Count the stacks in which some method found a failure, by the packages that they come from.

    tests/examples/bridge runs each of them at the defaults of its scenario without noise, where it
    must not fail.
    """
    failed = {
        stack.package
        for name, stack in STACKS.items()
        if any((figures.get(f"foreign.{name}.{method}") or EMPTY).value for method in ALL)
    }
    if failed:
        words = ", ".join(sorted(failed))
        yield (
            "foreign.stacks",
            Figure(value=len(failed), unit="stacks", n=len(failed), note=words, command=COMMAND),
        )


EMPTY = Figure(value=None, unit="share", n=0, command=COMMAND)


def drive_undisturbed(stack: Stack) -> Figure:
    """Return the share of the points at which the stack collides without noise."""
    spec = read_spec(FOLDER / stack.example.file)
    form = world_of(spec.simulator).find_form(spec)
    noise = np.zeros((form.steps, len(form.channels)), np.float32)
    calm = EpisodeTask(0, 0, TrajectorySource(noise))
    parameter, values = stack.points
    collided = []
    with closing(SharedConnection(os.environ[ADDRESS_VARIABLE])) as connection:
        for value in values:
            parameters = {**spec.scenario_parameters, parameter: value}
            setup = replace(spec, scenario_parameters=parameters).setup()
            (result,) = BridgeEngine(setup, connection).run([calm])
            if result.outcome is Outcome.ERRORED:
                raise SystemExit(f"The episode without noise failed: {result.fault}.")
            collided.append(result.is_failure)
    failed = [f"{value:g}" for value, one in zip(values, collided, strict=True) if one]
    where = f"{parameter} from {values[0]:g} to {values[-1]:g}"
    return count_share(collided, f"{where}; collisions at {', '.join(failed) or 'none'}")


def launch(client: Client, stack: Stack, method: str, seed: int) -> int:
    """Run a campaign at the defaults of the scenario; returns its id."""
    fields = tomllib.loads((FOLDER / stack.example.file).read_text())
    fields |= {"method": method, "episodes": stack.episodes, "seed": seed}
    if method != "ast":
        fields["settings"] = {}
    campaign = client.campaigns.create(**fields)
    client.campaigns.wait(campaign.id)
    return campaign.id


def tell_failures(client: Client, campaign: int, method: str, episodes: int) -> Figure:
    """Return failures ÷ episodes; with an interval only of a random sample."""
    rate = client.campaigns.summary(campaign).failure_rate
    ends = rate.interval and (rate.interval.low, rate.interval.high)
    note = "" if ends else f"the episodes that {method} chose; no failure rate under p(x)"
    return Figure(
        value=rate.value, unit="share", n=episodes, interval=ends, note=note, command=COMMAND
    )


def count_failures(client: Client, campaign: int) -> int:
    """Return how many episodes of a campaign failed."""
    return len([*client.episodes.list(campaign, Outcome.COLLISION, fields=["index"])])


def count_modes(client: Client, campaign: int) -> Figure:
    """Return the number of modes of its failures: 1 where they are not distinct."""
    n = count_failures(client, campaign)
    if n < 2:
        return Figure(value=n, unit="modes", n=n, command=COMMAND)
    analysis = client.analyses.wait(client.analyses.create(campaign).id)
    result = analysis.result
    if result is None:
        return Figure(value=None, unit="modes", n=n, note=analysis.problem, command=COMMAND)
    modes = len(result.modes) if result.distinct else 1
    words = " ".join(result.words)
    note = f"{client.campaigns.get(campaign).spec.method}; {result.verdict} {words}"
    return Figure(value=modes, unit="modes", n=n, note=note, command=COMMAND)


def film_worst(client: Client, found: Mapping[str, int], path: Path) -> Figure:
    """Write a film of the most severe failure, by chance if there is one; returns its severity."""
    fields = ["index", "severity", "steps", "log_probability"]
    for method, campaign in found.items():
        rows = client.episodes.list(campaign, Outcome.COLLISION, sort="-severity", fields=fields)
        worst: dict[str, Any] | None = next(iter(rows), None)
        if worst is not None:
            path.parent.mkdir(exist_ok=True)
            client.episodes.export_recording(campaign, worst["index"], path)
            note = f"episode {worst['index']} of {method}, step {worst['steps']}"
            return Figure(value=worst["severity"], unit="m²/s²", n=1, note=note, command=COMMAND)
    return Figure(value=None, unit="m²/s²", n=0, command=COMMAND)
