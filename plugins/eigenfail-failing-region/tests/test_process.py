"""The process that computes a region."""

import re
from pathlib import Path

from eigenfail_failing_region import campaigns


def test_its_logs_are_redacted():
    assert re.search(r"logs\.configure\(", Path(campaigns.__file__).read_text())
