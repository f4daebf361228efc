"""The time limits of tests: how long a test waits for what must happen before it fails.

They only end a test that hangs, so they are generous: a machine of two cores at a load of 20 stays
far below them. On a slower one, EIGENFAIL_TEST_PATIENCE=3 makes them three times as long. A limit
that is itself what a test is about stands in that test; tests/test_deadlines.py lists those.
"""

import os

PATIENCE = float(os.environ.get("EIGENFAIL_TEST_PATIENCE", "1"))

PROCESS_S = 180.0 * PATIENCE
"""For a process or a thread to start, to answer or to end."""

CAMPAIGN_S = 600.0 * PATIENCE
"""For a campaign, a notebook or many processes to end."""

TEST_S = 900.0 * PATIENCE
"""For a test as a whole."""
