"""Bridges of strangers, started as programs, and what searches for failures in them."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import deadlines
import numpy as np
import pytest
from msgspec.structs import replace
from warm_command import find_warm_command

from eigenfail import plugins
from eigenfail.cli.specs import read_spec
from eigenfail.settings import read_settings
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeResult, learner_seed
from eigenfail.values.learning import LearnerContext
from eigenfail.worlds import world_of
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_workers.bridge.connection import SharedConnection
from eigenfail_workers.bridge.engine import BridgeEngine

BRIDGES = Path(__file__).parents[3] / "examples" / "bridge"
PROBE = ("g++", "-x", "c++", "-fsyntax-only", "-")
COMPILER = (
    *("g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-O0"),
    *("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-I", str(BRIDGES / "cpp")),
)


class Started(NamedTuple):
    """A bridge that runs, and where."""

    program: subprocess.Popen[str]
    address: str


@pytest.fixture(scope="session")
def compiled(tmp_path_factory) -> Callable[[Path], Path]:
    """Builds a C++ bridge; a warning is an error, and so is what the sanitizers see later."""

    def build(source: Path) -> Path:
        try:
            subprocess.run(PROBE, input=b"#include <zmq.h>", check=True, capture_output=True)
        except (OSError, subprocess.CalledProcessError):
            pytest.skip("no g++, or no zmq.h for it")
        program = tmp_path_factory.mktemp("compiled") / source.stem
        subprocess.run([*COMPILER, str(source), "-o", str(program), "-lzmq"], check=True)
        return program

    return build


@pytest.fixture
def start(tmp_path) -> Iterator[Callable[..., Started]]:
    """Starts bridges, given their command without the address."""
    started: list[Started] = []

    def run(*command: object) -> Started:
        address = f"ipc://{tmp_path}/b{len(started)}"
        words = [*map(str, command), address]
        program = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + deadlines.PROCESS_S
        # Whoever connects waits 10 s for an answer, and imports alone may take longer.
        while not Path(address.removeprefix("ipc://")).exists() and program.poll() is None:
            assert time.monotonic() < deadline, "it does not listen"
            time.sleep(0.02)
        started.append(Started(program, address))
        return started[-1]

    yield run
    for each in started:
        each.program.kill()
        each.program.communicate()


@pytest.fixture
def start_python(start) -> Callable[[str], Started]:
    """Starts one of the examples in Python."""
    return lambda name: start(sys.executable, BRIDGES / name)


@pytest.fixture
def engine() -> Iterator[Callable[[CampaignSpec, str], BridgeEngine]]:
    """Engines on bridges."""
    lines: list[SharedConnection] = []

    def make(spec: CampaignSpec, address: str) -> BridgeEngine:
        lines.append(SharedConnection(address))
        return BridgeEngine(spec.setup(), lines[-1])

    yield make
    for line in lines:
        line.close()


@pytest.fixture
def search(engine) -> Callable[..., list[EpisodeResult]]:
    """Runs a campaign file on a bridge, with a smaller budget."""

    def run(file: Path, address: str, episodes: int) -> list[EpisodeResult]:
        spec = replace(read_spec(file), episodes=episodes)
        steps = world_of(spec.simulator).find_form(spec).steps
        method = plugins.load(plugins.METHODS, spec.method)
        settings = read_settings(method.Settings, spec.settings, "settings")
        none = np.zeros((0, steps, 2), np.float32)
        learner = method(LearnerContext(learner_seed(spec.seed), episodes, steps, none), settings)
        rounds = Rounds(learner, spec.seed, episodes)
        return list(run_in_process(rounds, engine(spec, address)))

    return run


@pytest.fixture
def check_bridge() -> Callable[[str], None]:
    """Holds a bridge against its protocol, as its author would."""

    def check(address: str) -> None:
        command = [Path(find_warm_command(), "eigenfail"), "doctor", "--bridge", address]
        told = subprocess.run(command, capture_output=True, text=True, check=False)
        assert told.returncode == 0, told.stdout + told.stderr
        assert "broken" not in told.stdout

    return check
