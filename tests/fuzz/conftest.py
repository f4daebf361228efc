"""What bends messages and counts escapes is a benchmark, too."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
