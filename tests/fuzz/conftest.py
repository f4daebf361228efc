"""What bends messages and counts escapes is a benchmark, too; what sends requests, a program."""

import sys
from pathlib import Path

sys.path += [str(Path(__file__).parents[2] / "benchmarks"), str(Path(__file__).parent)]
