"""Kill, hold up and cut off every process of a service at random; nothing may be lost.

`python tests/soak/soak.py --minutes 5`: half of the time on SQLite, half on PostgreSQL. It prints
its seed; the same seed draws the same faults in the same order. On each database the services
themselves are spared at first, so that what they take can be told from the first quarter of that
time to its last.
"""

import argparse
import random
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

sys.path += [str(Path(__file__).parents[1] / name) for name in ("chaos", "support")]

from postgresql import server
from promises import late, run_again
from resources import Sample, growth, quarters, sample, told
from stage import CAMPAIGNS, Stage, stage_on
from storm import NOTHING_MORE, SERVER_SHUTDOWN, WRITE_LOCK, Fault, Storm, hold_write_lock, verdict

HARMLESS = (
    "SIGKILL of a worker's inner process",
    "SIGKILL of a learner",
    "SIGKILL of the controller",
)
"""Whoever holds a result lives, and so does the line: nothing may be run again."""

SPARED = (
    "SIGKILL of the services",
    "SIGSTOP of the services",
    "SIGKILL of every process at once",
    SERVER_SHUTDOWN,
)


def until(minutes: float, look: Callable[[], object]) -> Callable[[], bool]:
    """Whether so many minutes are over; looks each time that it is asked."""
    deadline = time.monotonic() + 60 * minutes

    def over() -> bool:
        look()
        return time.monotonic() > deadline

    return over


def calm(stage: Stage) -> tuple[dict[str, str], dict[str, float]]:
    """Digests, and times in seconds, of campaigns that nothing disturbs, one after the other."""
    digests, times = {}, {}
    for method in CAMPAIGNS:
        (campaign,) = stage.launch(method).values()
        began_s = time.monotonic()
        digests[method] = stage.finish(campaign).digests[campaign]
        times[method] = time.monotonic() - began_s
    return digests, times


def soak(
    stage: Stage, minutes: float, seed: int, more: Mapping[str, Fault] = NOTHING_MORE
) -> list[str]:
    """Calm, a breeze, half a storm, storm, verdict: what is to be complained of."""
    storm = Storm(stage, random.Random(seed), more)
    digests, times_s = calm(stage)
    samples: list[Sample] = []
    pid = storm.services.process.pid
    gentle = [kind for kind in storm.faults if kind not in SPARED]
    for kinds in (HARMLESS, gentle):
        storm.rage(until(minutes / 4, lambda: samples.append(sample(pid))), kinds)
    first, last = quarters(samples)
    storm.rage(until(minutes / 2, lambda: None))
    tardy = [*late(storm, times_s)]
    found, differing = verdict(storm, digests)
    print(f"caused {dict(storm.befell)} during {len(storm.campaigns)} campaigns of {[*CAMPAIGNS]}")
    print(f"services in the first quarter: {told(first)}; in the last: {told(last)}")
    print(f"lost {found.lost}, doubled {found.doubled}, brought again {found.repeated}")
    other = [f"campaign {number}: another digest" for number in differing]
    again = run_again(storm, HARMLESS)
    return [*found.complaints, *other, *growth(first, last), *again, *tardy]


def on_sqlite(minutes: float, seed: int) -> list[str]:
    """What is to be complained of there."""
    draws = random.Random(seed)
    with stage_on("") as stage:
        more = {WRITE_LOCK: partial(hold_write_lock, stage.url, draws)}
        return soak(stage, minutes, seed, more)


def on_postgresql(minutes: float, seed: int) -> list[str]:
    """What is to be complained of there, where the server is broken off, too."""
    with server() as running, stage_on(running.url) as stage:
        return soak(stage, minutes, seed, {SERVER_SHUTDOWN: running.restarted})


DATABASES = {"sqlite": on_sqlite, "postgresql": on_postgresql}


def main() -> None:
    """Exit code 1 if anything was lost, changed, late or has grown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(2**31))
    parser.add_argument("--database", choices=DATABASES, action="append")
    arguments = parser.parse_args()
    databases = arguments.database or [*DATABASES]
    print(f"seed {arguments.seed}, {arguments.minutes:g} minutes", flush=True)
    found = []
    for database in databases:
        print(f"on {database}:", flush=True)
        found += DATABASES[database](arguments.minutes / len(databases), arguments.seed)
    print("\n".join(found) or "nothing lost, doubled or late, every digest as in the calm")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
