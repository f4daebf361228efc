"""What the image installs before our own code: `python requirements.py pyproject.toml EXTRA…`."""

import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path


def requirements(manifest: Path, extras: Sequence[str]) -> list[str]:
    """The dependencies of the project, and those of some of its extras."""
    project = tomllib.loads(manifest.read_text("utf-8"))["project"]
    optional = project["optional-dependencies"]
    return [*project["dependencies"], *(line for name in extras for line in optional[name])]


if __name__ == "__main__":
    print(*requirements(Path(sys.argv[1]), sys.argv[2:]), sep="\n")
