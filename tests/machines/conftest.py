"""What the machines play beside the real parts: here, and with the benchmarks, which use it too."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path += [str(HERE), str(HERE.parents[1] / "benchmarks")]
