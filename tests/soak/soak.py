"""Kill and hold up every process of a service at random for some minutes; nothing may be lost.

`make soak MINUTES=5`. Prints its seed; the same seed draws the same faults in the same order. In
the first half the services themselves are spared, so that what they take can be told from its
first quarter to its last; in the second half nobody is.
"""

import argparse
import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "chaos"))

from resources import Sample, growth, quarters, sample, told
from stage import CAMPAIGNS, Stage
from storm import Storm, verdict

SPARED = ("services killed", "services held up", "everything killed")


def calm(stage: Stage) -> dict[str, str]:
    """The digests of campaigns that nothing disturbs."""
    campaigns = stage.launch()
    digests = stage.finish(*campaigns.values()).digests
    return {method: digests[campaign] for method, campaign in campaigns.items()}


def until(minutes: float, look: Callable[[], object]) -> Callable[[], bool]:
    """Whether so many minutes are over; looks each time that it is asked."""
    deadline = time.monotonic() + 60 * minutes

    def over() -> bool:
        look()
        return time.monotonic() > deadline

    return over


def soak(stage: Stage, minutes: float, seed: int) -> list[str]:
    """Calm, half a storm, storm, verdict: what is to be complained of."""
    storm = Storm(stage, random.Random(seed))
    digests = calm(stage)
    samples: list[Sample] = []
    pid = storm.services.process.pid
    gentle = [kind for kind in storm.faults if kind not in SPARED]
    storm.rage(until(minutes / 2, lambda: samples.append(sample(pid))), gentle)
    first, last = quarters(samples)
    storm.rage(until(minutes / 2, lambda: None))
    found, differing = verdict(storm, digests)
    print(f"caused {dict(storm.befell)} during {len(storm.campaigns)} campaigns of {[*CAMPAIGNS]}")
    print(f"services in the first quarter: {told(first)}; in the last: {told(last)}")
    print(f"lost {found.lost}, doubled {found.doubled}, run again {found.repeated}")
    other = [f"campaign {number}: another digest" for number in differing]
    return [*found.complaints, *other, *growth(first, last)]


def main() -> None:
    """Exit code 1 if anything was lost, changed or has grown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(2**31))
    arguments = parser.parse_args()
    print(f"seed {arguments.seed}, {arguments.minutes:g} minutes", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        stage = Stage(f"sqlite:///{folder}/eigenfail.db", Path(folder))
        try:
            found = soak(stage, arguments.minutes, arguments.seed)
        finally:
            stage.end()
    print("\n".join(found) or "nothing lost, nothing doubled, every digest as in the calm")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
