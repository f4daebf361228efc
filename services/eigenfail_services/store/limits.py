"""How much is kept, and how often something is tried."""

KEPT_EVENTS = 200_000
"""The event log forgets what is older."""

KEPT_CHANGES = 1_000_000
"""The audit log forgets what is older."""

KEPT_ARRIVALS = 100_000
"""The list of workers forgets what is older."""

KEPT_CHECKPOINTS = 2
"""Of each campaign: the last one, and the one to fall back to."""

MAX_ATTEMPTS = 5
"""Claims of one job in a row without progress, before it is buried."""

BURIED = (
    f"Whoever worked on it was lost {MAX_ATTEMPTS} times in a row before it got any further. "
    "The service's log says why; start it anew once that is put right."
)
