"""A measured figure, and the files in which figures are kept."""

import subprocess
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Protocol, runtime_checkable

import msgspec

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"


class Figure(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One number that may be quoted.

    Attributes:
        n: how many runs, episodes or pairs it rests on; `spread` is their smallest and largest.
        target: the bound of the value, in words.
        paper: the paper's number, where there is one.
    """

    value: float | None
    unit: str
    n: int
    command: str
    commit: str = ""
    interval: tuple[float, float] | None = None
    spread: tuple[float, float] | None = None
    target: str = ""
    paper: float | None = None
    note: str = ""


@runtime_checkable
class Record(Protocol):
    """What a trial found besides figures, for files of its own."""

    def write_beside(self, claims: Path) -> None:
        """Write the files into the folder of the claims."""


BENCH = "make bench"
WRITTEN = (":!docs", ":!benchmarks/results")


def summarize_runs(
    values: Sequence[float], unit: str, target: str = "", note: str = "", n: int | None = None
) -> Figure:
    """Return the median of some runs of the benchmarks, with their smallest and largest.

    Args:
        values: one of each run, or of each pair of runs.
        unit: unit of the values.
        target: the bound of the median, in words.
        note: conditions under which the values were measured.
        n: what it rests on, where that is not the number of runs.
    """
    return Figure(
        value=median(values),
        unit=unit,
        n=len(values) if n is None else n,
        spread=(min(values), max(values)),
        target=target,
        command=BENCH,
        note=note,
    )


def commit() -> str:
    """The commit that was measured; marked if what is measured differs from it.

    Documents and their figures do not count: they are what the measuring writes.
    """
    head = said_by_git("rev-parse", "--short", "HEAD")
    changed = said_by_git("status", "--porcelain", "--untracked-files=no", *WRITTEN)
    return f"{head}-dirty" if changed else head or "unknown"


def said_by_git(*words: str) -> str:
    """What git says of this tree; nothing where there is none."""
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip()


def write(path: Path, figures: dict[str, Figure]) -> None:
    """Replace the file, names sorted, each figure with the commit that it was measured on.

    That is the present one, but for figures that carry their commit already.
    """
    now = commit()
    stamped = {
        name: msgspec.structs.replace(f, commit=f.commit or now) for name, f in figures.items()
    }
    data = msgspec.json.encode(dict(sorted(stamped.items())))
    path.write_bytes(msgspec.json.format(data, indent=2) + b"\n")


def show(figures: dict[str, Figure]) -> None:
    """Print name, value, unit and target of each figure."""
    for name, figure in sorted(figures.items()):
        value = "–" if figure.value is None else f"{figure.value:.4g}"
        print(f"{name:<48} {value:>10} {figure.unit:<12} n={figure.n:<6} {figure.target}")
