"""Find the figures that the documents state, and write benchmarks/results/claims.json.

The learning curves of the methods that learn go to learning_curves.json in the same folder, from
which `python -m benchmarks.pictures.drawings` draws them. Trials of plug-ins may write further
files there.

`python -m benchmarks.claims --only cut_in.rulebook.p_fail` finds a part of them and leaves the
others as they are. Exit code 1 if a target is missed, 2 if no figure has the name asked for.
"""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from benchmarks.episode_pool import open_pool
from benchmarks.figures import RESULTS, Figure, Record, write
from benchmarks.peers.comparison import compare_searches
from benchmarks.targets import TARGETS, add_target, list_missed
from benchmarks.trials import TRIALS, Finding
from benchmarks.truth import curves
from benchmarks.truth.foreign_stacks import count_stacks

SEED = 20261122
"""Used for nothing else: no part of the world was chosen by what it shows."""


def find_figures(prefix: str, seed: int) -> dict[str, Finding]:
    """What the trials find that a prefix concerns; figures only whose names begin with it."""
    findings: dict[str, Finding] = {}
    with open_pool() as hands:
        for trial in TRIALS:
            if trial.concerns(prefix) and trial.missing:
                print(f"{trial.prefixes[0]}… kept: {', '.join(trial.missing)} not installed")
            elif trial.concerns(prefix):
                began = time.perf_counter()
                findings |= trial.find(hands, seed)
                print(f"{trial.prefixes[0]}… {time.perf_counter() - began:.0f} s", flush=True)
    return {
        name: one
        for name, one in findings.items()
        if name.startswith(prefix) or not isinstance(one, Figure)
    }


def write_beside(to: Path, findings: dict[str, Finding]) -> None:
    """Keep what was found besides figures: learning curves and the records of trials."""
    beside = to.with_name(curves.FILE.name)
    fresh = {n: one for n, one in findings.items() if not isinstance(one, Figure | Record)}
    curves.write(curves.read(beside) | fresh, beside)
    for each in findings.values():
        if isinstance(each, Record):
            each.write_beside(to)


def read_other_figures(path: Path, prefix: str) -> dict[str, Figure]:
    """The figures in the file whose names begin otherwise, or that cannot be found here."""
    if not path.exists():
        return {}
    figures = msgspec.json.decode(path.read_bytes(), type=dict[str, Figure])
    without = tuple(own for trial in TRIALS if trial.missing for own in trial.prefixes)
    return {
        name: figure
        for name, figure in figures.items()
        if not name.startswith(prefix) or name.startswith(without)
    }


def derive(figures: dict[str, Figure], prefix: str) -> dict[str, Figure]:
    """What is counted over the figures of several trials, where a prefix concerns these."""
    return {
        name: figure
        for own, count in (("search.", compare_searches), ("foreign.", count_stacks))
        if prefix.startswith(own) or own.startswith(prefix)
        for name, figure in count(figures)
    }


def table(figures: dict[str, Figure], late: list[str]) -> Iterator[str]:
    """A line for each figure: name, value, interval, the paper's, target, whether that is held."""
    yield f"{'claim':<44} {'value':>9} {'95 % interval':>21} {'paper':>7} {'n':>6}  target"
    for name, figure in sorted(figures.items()):
        value, paper = number(figure.value), number(figure.paper)
        ends = ", ".join(map(number, figure.interval or ()))
        outcome = "MISSED" if name in late else "held"
        target = f"{figure.target}: {outcome}" if figure.target else ""
        yield f"{name:<44} {value:>9} {ends:>21} {paper:>7} {figure.n:>6}  {target}".rstrip()


def number(value: float | None) -> str:
    """Four digits, or a dash."""
    return "–" if value is None else f"{value:.4g}"


def main(
    only: Annotated[str, typer.Option(help="Figures whose names begin like this.")] = "",
    seed: Annotated[int, typer.Option(min=0, help="Of all noise.")] = SEED,
    to: Annotated[Path, typer.Option(help="File to write.")] = RESULTS / "claims.json",
) -> None:
    """Find, write, show."""
    findings = find_figures(only, seed)
    figures = {
        n: add_target(n, one, seed) for n, one in findings.items() if isinstance(one, Figure)
    }
    compared = derive(read_other_figures(to, only) | figures, only)
    if not figures and not any(name.startswith(only) for name in compared):
        print(f"No figure's name begins with '{only}'; some are {', '.join(sorted(TARGETS))}.")
        raise typer.Exit(2)
    figures |= {name: add_target(name, one, seed) for name, one in compared.items()}
    write(to, read_other_figures(to, only) | figures)
    write_beside(to, findings)
    late = list_missed(figures, only)
    print("\n".join(table(figures, late)))
    raise typer.Exit(bool(late))


if __name__ == "__main__":
    typer.run(main)
