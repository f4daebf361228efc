"""Failures that a service finds in processes of others: the examples of bridges, as they are."""

import os
import signal
import socket
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import ROOT, Figure
from benchmarks.samples import COMMAND

from eigenfail.bridges import ADDRESS_VARIABLE
from eigenfail.client import Client
from eigenfail.hosting.service import Plan, local_service

FOLDER = ROOT / "examples" / "bridge"
MANY = {"monte_carlo": 2_000, "cem": 1_000}
"""Episodes of the methods that the file does not name; it says how many AST has."""


class Example(NamedTuple):
    """A bridge, its campaign file, and which of its planners are searched, by which methods.

    Attributes:
        command: what starts it, without the address.
        share: of the episodes in `MANY`: its episodes are dearer.
    """

    command: tuple[str, ...]
    file: str
    methods: dict[str, tuple[str, ...]]
    share: float = 1.0


PYTHON = sys.executable
COMPILED = ("./bridge",)
"""The bridge in C++, which is compiled first."""

ALL = ("monte_carlo", "ast", "cem")
EXAMPLES = {
    "cpp": Example(COMPILED, "cpp/campaign.toml", {"headway": ALL}),
    "sumo": Example(
        (PYTHON, str(FOLDER / "sumo_bridge.py")),
        "sumo.toml",
        {"ACC": ALL, "IDM": ALL, "Krauss": ALL},
    ),
    "highway_env": Example(
        (PYTHON, str(FOLDER / "highway_env_bridge.py")),
        "highway_env.toml",
        {"headway": ALL},
        share=0.2,
    ),
}


def found_in_others(_crew: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The failure rate of each campaign; a service has workers of its own."""
    for name, example in EXAMPLES.items():
        with TemporaryDirectory() as folder, serve_bridge(example, Path(folder)) as client:
            for fields in campaigns(example, seed):
                place = f"bridges.{name}.{fields['planner'].lower()}.{fields['method']}"
                yield f"{place}.failure_rate", rate(client, fields)


def campaigns(example: Example, seed: int) -> Iterator[dict[str, Any]]:
    """The file's campaign, by every method and against every planner."""
    given = tomllib.loads((FOLDER / example.file).read_text())
    for planner, methods in example.methods.items():
        for method in methods:
            fields = {**given, "planner": planner, "method": method, "seed": seed}
            if method in MANY:
                fields |= {"settings": {}, "episodes": round(example.share * MANY[method])}
            yield fields


def rate(client: Client, fields: dict[str, Any]) -> Figure:
    """Run it; its failures ÷ its episodes."""
    campaign = client.campaigns.create(**fields)
    client.campaigns.wait(campaign.id)
    found = client.campaigns.summary(campaign.id).failure_rate
    # The episodes of a search are no random sample.
    ends = found.interval and (found.interval.low, found.interval.high)
    n = fields["episodes"]
    return Figure(value=found.value, unit="share", n=n, interval=ends, command=COMMAND)


@contextmanager
def serve_bridge(example: Example, folder: Path) -> Iterator[Client]:
    """A service of one worker, whose bridge runs."""
    if example.command == COMPILED:
        build(folder)
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    os.environ[ADDRESS_VARIABLE] = address
    bridge = subprocess.Popen([*example.command, address], cwd=folder)
    try:
        with (
            local_service(Plan(folder / "data", port=0, workers=1)) as service,
            Client(service.address.url) as client,
        ):
            yield client
    finally:
        bridge.send_signal(signal.SIGTERM)
        bridge.wait()
        del os.environ[ADDRESS_VARIABLE]


def build(folder: Path) -> None:
    """The C++ program, as its document says."""
    source = str(FOLDER / "cpp" / "main.cpp")
    command = ["g++", "-std=c++17", "-O2", source, "-lzmq", "-o", str(folder / "bridge")]
    subprocess.run(command, check=True)
