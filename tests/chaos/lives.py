"""How long the state machines of the tests live, and whether their lives are the same ones always.

`make test` lives the same lives every time; tests/machines/explore.py those of a seed
(EIGENFAIL_EXPLORE=1).
"""

import os

from hypothesis import HealthCheck, Phase, settings

VARIABLE = "EIGENFAIL_EXPLORE"
EXPLORING = os.environ.get(VARIABLE) == "1"
TIMES = 3 if EXPLORING else 1
"""So many more lives a run; the runs of an exploration go on until its time is over."""

# A life that fails is shortened for minutes, past the time limit of its test, which then hides what
# failed. `make test` prints it as it was found; explore.py finds the shortest one.
PHASES = (Phase.generate, Phase.shrink) if EXPLORING else (Phase.generate,)

settings.register_profile(
    "lives",
    deadline=None,
    derandomize=not EXPLORING,
    phases=PHASES,
    print_blob=EXPLORING,
    report_multiple_bugs=False,
    suppress_health_check=list(HealthCheck),
)


def lives(examples: int, steps: int) -> settings:
    """So many lives of so many steps each."""
    profile = settings.get_profile("lives")
    return settings(profile, max_examples=TIMES * examples, stateful_step_count=steps)
