"""Measure what is promised about speed, and write benchmarks/results/latest.json.

`python -m benchmarks.run --only hub` runs the programs of which some figure's name begins like
this, and keeps the other figures. A program that cannot run, such as one that compares with a tool
that is not installed, is told and leaves its figures as they are; the exit code is then 1. It is 2
if no figure has such a name.
"""

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from subprocess import CalledProcessError
from typing import Annotated, NamedTuple

import msgspec
import typer
from benchmarks.figures import RESULTS, Figure, show, write
from benchmarks.peers.handwritten_programs import failure_figures, ledger_figures
from benchmarks.speed.analysis import analysis_figures
from benchmarks.speed.bridge import bridge_figures
from benchmarks.speed.difs_sampling import difs_sampling_figures
from benchmarks.speed.hub import hub_figures
from benchmarks.speed.pages import page_figures
from benchmarks.speed.planner import planner_figures
from benchmarks.speed.recovery import recovery_figures
from benchmarks.speed.sac import sac_figures
from benchmarks.speed.scale import scale_figures
from benchmarks.speed.service import service_figures
from benchmarks.speed.start_up import cli_help, programme_figures, run_cold, worker_ready
from benchmarks.speed.start_up import service_figures as start_figures
from benchmarks.speed.waiting import learner_share

from eigenfail.hosting.service import Launcher

OUTPUT = RESULTS / "latest.json"


class Program(NamedTuple):
    """How the names of some figures begin, and what measures them all."""

    beginnings: tuple[str, ...]
    measure: Callable[[], Mapping[str, Figure]]

    def concerns(self, prefix: str) -> bool:
        """Return whether the name of one of its figures may begin like this."""
        return any(own.startswith(prefix) or prefix.startswith(own) for own in self.beginnings)


measure_hub = cache(hub_figures)
"""The rates of many workers are computed from the hub's figures, of the same run."""

PROGRAMS = (
    Program(("cli_help_s",), lambda: {"cli_help_s": cli_help()}),
    Program(("worker_ready_s",), lambda: {"worker_ready_s": worker_ready()}),
    Program(("run_cold_s",), lambda: {"run_cold_s": run_cold()}),
    Program(("paper_programme_s",), programme_figures),
    Program(("ready_ray_",), lambda: start_figures(Launcher.RAY)),
    Program(("ready_local_",), lambda: start_figures(Launcher.LOCAL)),
    Program(("analysis_",), analysis_figures),
    Program(("page_",), page_figures),
    Program(("plan_", "qp_"), planner_figures),
    Program(("sac_over_sb3",), sac_figures),
    Program(("difs_sampling_over_ddpm1000",), difs_sampling_figures),
    Program(("ast_over_sb3_wall",), failure_figures),
    Program(("stored_over_optuna",), ledger_figures),
    Program(("learner_share",), lambda: {"learner_share": learner_share()}),
    Program(("service_", "two_workers_over_one", "episode_cpu_"), service_figures),
    Program(("bridge_over_builtin",), bridge_figures),
    Program(("kill_extra_work", "recovery_s"), recovery_figures),
    Program(("hub_",), measure_hub),
    Program(
        ("checkpoint_ms_", "commit_ms", "learner_ms_", "rate_", "result_", "tail_"),
        lambda: scale_figures(measure_hub()),
    ),
)


def main(
    only: Annotated[str, typer.Option(help="Figures whose names begin like this.")] = "",
    to: Annotated[Path, typer.Option(help="File to write.")] = OUTPUT,
) -> None:
    """Measure, write, show."""
    chosen = [program for program in PROGRAMS if program.concerns(only)]
    if not chosen:
        known = ", ".join(own for program in PROGRAMS for own in program.beginnings)
        print(f"No figure's name begins with '{only}'. Names begin with {known}.")
        raise typer.Exit(2)
    failed = False
    for program in chosen:
        try:
            found = program.measure()
        # A tool is missing or does not start: the others can be measured nevertheless.
        except (ImportError, OSError, RuntimeError, SystemExit, CalledProcessError) as error:
            print(f"{program.beginnings[0]}… could not be measured and keeps its figures: {error}")
            failed = True
            continue
        # Written after each program, so that an interruption costs no figure of the hours before.
        kept = msgspec.json.decode(to.read_bytes(), type=dict[str, Figure]) if to.exists() else {}
        write(to, kept | found)
        show(found)
    raise typer.Exit(failed)


if __name__ == "__main__":
    typer.run(main)
