"""Figure: methods whose episodes and modes are the same, bit for bit, on processors of other types.

A type of processor is emulated by environment variables that libraries read when they are loaded:
they name the kernels of OpenBLAS and the features that numpy, torch and the C library may use. On
each of them a process runs a small campaign of each method, and an analysis, as the services start
it: with `NUMERIC_ENVIRONMENT` over the environment that it was given.

`python -m benchmarks.truth.processors` prints the digests of this process, as JSON.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import ROOT, Figure
from benchmarks.samples import COMMAND
from benchmarks.searches import EARLIER, Found, search

from eigenfail import plugins
from eigenfail.processes import NUMERIC_ENVIRONMENT
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import Failures

TYPES: dict[str, dict[str, str]] = {
    "as it is": {},
    "Haswell": {"OPENBLAS_CORETYPE": "Haswell", "MKL_CBWR": "AVX2"},
    "Zen": {"OPENBLAS_CORETYPE": "Zen", "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL"},
    "Skylake-X": {"OPENBLAS_CORETYPE": "SkylakeX", "NPY_DISABLE_CPU_FEATURES": "AVX512_ICL"},
    "Cooper Lake": {"OPENBLAS_CORETYPE": "Cooperlake", "MKL_CBWR": "AUTO"},
    "without AVX-512": {
        "OPENBLAS_CORETYPE": "Zen",
        "ATEN_CPU_CAPABILITY": "avx2",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512BW,-AVX512DQ",
    },
}

SEED = 20261126

KNOWN: dict[str, tuple[int, dict[str, Any]]] = {
    "ast": (80, {"warm_up": 20}),
    "cem": (80, {}),
    "chains": (60, {"campaign": EARLIER, "chains": 4}),
    "cma": (60, {}),
    "annealing": (60, {}),
    "optuna": (60, {}),
    "go_explore": (60, {}),
    "difs": (160, {"device": "cpu", "first_steps": 50, "steps": 20}),
    "mixture_ce": (280, {}),
    "ensemble": (80, {"members": 2}),
    "evaluate": (20, {"campaign": EARLIER}),
    "held": (20, {}),
    "minimal": (40, {"campaign": EARLIER, "episode": 0}),
    "mixture": (500, {"round_size": 60}),
    "monte_carlo": (60, {}),
    "nearest": (20, {"analysis": EARLIER}),
    "replay": (20, {"campaign": EARLIER}),
    "splitting": (400, {"runs": 5, "particles": 20}),
    "subset": (300, {}),
}
"""Episodes and settings by method."""

SMALL = {name: KNOWN[name] for name in KNOWN if name in plugins.names(plugins.METHODS)}
"""The methods that are installed: a plug-in may be absent."""

GIVEN = {"chains": 20, "minimal": 1, "nearest": 2, "replay": 20}
"""Failures that the methods which need some are given."""


def find_figures(pool: EpisodePool, _seed: int) -> Iterator[tuple[str, Figure]]:
    """Count the digests that are the same on every type, with the environment and without it."""
    pinned = pool.each(run_on, TYPES.values(), [NUMERIC_ENVIRONMENT] * len(TYPES))
    bare = pool.each(run_on, TYPES.values(), [{}] * len(TYPES))
    agreeing, left = count_agreeing(pinned), count_agreeing(bare)
    value = agreeing / (len(TYPES) * len(pinned[0]))
    note = (
        f"{len(pinned[0]) - 1} methods and an analysis on {len(TYPES)} types "
        f"({', '.join(TYPES)}); without the environment of the services' processes {left} of "
        f"{len(TYPES) * len(bare[0])} agree; seed {SEED}"
    )
    n = len(TYPES) * len(pinned[0])
    yield (
        "cross_processor_equal",
        Figure(value=value, unit="share", n=n, command=COMMAND, note=note),
    )


def run_on(
    emulated: Mapping[str, str], own: Mapping[str, str], methods: Sequence[str] = ()
) -> dict[str, str]:
    """Return the digests that a process finds which is started on a type of processor.

    Args:
        emulated: environment that makes the type.
        own: environment that the services add for their processes; it overrides `emulated`.
        methods: methods of the campaigns; none given: all.
    """
    kept = {name: value for name, value in os.environ.items() if name not in NUMERIC_ENVIRONMENT}
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.truth.processors", *methods],
        cwd=ROOT,
        env=kept | emulated | own,
        stdout=subprocess.PIPE,
        check=True,
    )
    found: dict[str, str] = json.loads(done.stdout)
    return found


def count_agreeing(found: Sequence[Mapping[str, str]]) -> int:
    """Return how many digests are those of the first type."""
    return sum(one[name] == found[0][name] for one in found for name in found[0])


def find_digests(methods: Sequence[str]) -> dict[str, str]:
    """Return the digest of a campaign of each method, and of an analysis of failures."""
    failures = [one.z for one in run_small("monte_carlo").crashes]
    found = {
        name: run_small(name, run_small("ast") if name == "evaluate" else None, failures).digest
        for name in methods
    }
    return found | {"analysis": analyse_failures(failures)}


def run_small(method: str, earlier: Found | None = None, noise: Sequence[Floats] = ()) -> Found:
    """Run a campaign of a planner that fails often."""
    episodes, settings = SMALL[method]
    spec = CampaignSpec(
        name=method,
        method=method,
        episodes=episodes,
        seed=SEED,
        scenario="cut_in",
        planner="idm",
        settings=settings,
    )
    return search(spec, earlier, noise[: GIVEN.get(method, 0)])


def analyse_failures(noise: Sequence[Floats]) -> str:
    """Return the digest of the modes of failures, by the noise of these."""
    from eigenfail_services.analysis.job import analyse, hash_result

    failures = Failures(tuple(range(len(noise))), tuple(noise))
    return hash_result(analyse(failures, max(map(len, noise)), AnalysisSettings(features="noise")))


if __name__ == "__main__":
    print(json.dumps(find_digests(sys.argv[1:] or plugins.names(plugins.METHODS))))
