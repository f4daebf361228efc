"""New lives of the state machines, or with --seed those of an earlier run again.

`python tests/machines/explore.py --minutes 5`. Runs follow each other, each with a seed of its own,
until the time is over or one fails.
"""

import argparse
import os
import secrets
import subprocess
import sys
import time
from pathlib import Path

TESTS = Path(__file__).parents[1]
SEEDS = 2**32
MACHINES = "RuleBasedStateMachine"


def machines() -> list[str]:
    """The files with machines."""
    files = sorted(TESTS.rglob("test_*.py"))
    return [str(file) for file in files if MACHINES in file.read_text()]


def live(seed: int) -> int:
    """All machines with one seed; how pytest exits."""
    print(f"Lives of seed {seed}.", flush=True)
    command = [sys.executable, "-m", "pytest", "-q", "--timeout=0", f"--hypothesis-seed={seed}"]
    surroundings = {**os.environ, "EIGENFAIL_EXPLORE": "1"}
    return subprocess.run([*command, *machines()], env=surroundings, check=False).returncode


def main() -> None:
    """Live until the time is over, or a life ends badly."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--seed", type=int, help="the lives of this seed alone")
    asked = parser.parse_args()
    until_s = time.monotonic() + 60 * asked.minutes
    while True:
        seed = secrets.randbelow(SEEDS) if asked.seed is None else asked.seed
        if status := live(seed):
            print(f"The same lives again: python tests/machines/explore.py --seed {seed}")
            sys.exit(status)
        if asked.seed is not None or time.monotonic() > until_s:
            return


if __name__ == "__main__":
    main()
