"""Check that everything else works when plug-ins' folders are deleted.

    .venv/bin/python deploy/without_plugins.py

For each folder of plugins/ the repository is copied without it, to an environment of its own in
which the plug-in is not installed. There the core's tests run of what a plug-in could be tied to:
commands, routes, methods, formats, documents and recipes. A last copy has no plug-in at all:
the linters run there, too. It prints what it runs; the exit code is 1 if any of it fails.
`make test` does this in the end.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parent.parent
PLUGINS = tuple(sorted(file.parent for file in ROOT.glob("plugins/*/pyproject.toml")))
AT_ONCE = 2
"""Copies that are checked at a time: each keeps one core busy."""

LINT_IMPORTS = "from importlinter.cli import lint_imports_command; lint_imports_command()"
LINTERS = (
    ("-m", "ruff", "check", "."),
    ("-m", "ruff", "format", "--check", "."),
    ("-m", "mypy"),
    ("-c", LINT_IMPORTS),
    ("-m", "mkdocs", "build", "--quiet", "--site-dir", ".site"),
    # A name of the core that nothing uses without one plug-in is not used without any of them.
    ("deploy/structure.py",),
)
"""What python is called with in the copy without any plug-in."""

TESTS = (
    "tests/test_plugins.py",
    "tests/test_golden.py",
    "tests/api/test_extensions.py",
    "tests/api/test_mixing.py",
    "tests/api/test_recordings.py",
    "tests/benchmarks/test_trials.py",
    "tests/deploy/test_locks.py",
    "tests/deploy/test_recipes.py",
    "tests/docs/test_claims.py",
    "tests/docs/test_cli_page.py",
    "tests/docs/test_documents.py",
    "tests/docs/test_episodes_page.py",
    "tests/docs/test_noise_page.py",
    "tests/docs/test_plugins_page.py",
    "tests/docs/test_rest_page.py",
    "tests/docs/test_site.py",
    "tests/sdk/cli/test_completion.py",
    "tests/sdk/cli/test_main.py",
    "tests/sdk/cli/test_plugin_commands.py",
    "tests/sdk/test_recording_formats.py",
)
CHECK = ("-m", "pytest", "-q", "-m", "not service and not browser", *TESTS)
"""What python is called with in every copy."""

MADE = shutil.ignore_patterns(
    ".git",
    ".venv",
    ".out",
    ".site",
    ".hypothesis",
    ".pytest_cache",
    ".ruff_cache",
    ".import_linter_cache",
    "__pycache__",
    "__compiled__",
    "node_modules",
    "eigenfail-data",
)
"""Names of files that programs make in the repository. The cache of mypy is not among them: mypy
compares contents, so that the cache saves most of its time in the copy."""


def main() -> int:
    """Check without each plug-in in turn, and without all of them; 1 if something fails."""
    with ThreadPoolExecutor(AT_ONCE) as threads:
        # The longest check begins first.
        asked = [
            threads.submit(check_without, "all plug-ins", set(PLUGINS), (*LINTERS, CHECK)),
            *(threads.submit(check_without, one.name, {one}, (CHECK,)) for one in PLUGINS),
        ]
        return 0 if all(each.result() for each in asked) else 1


def check_without(label: str, deleted: set[Path], checks: Sequence[tuple[str, ...]]) -> bool:
    """Return whether checks pass in a copy of the repository without some plug-ins."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="eigenfail-without-") as name:
        clone = Path(name) / "clone"
        copy_repository(clone, deleted)
        python = make_environment(clone)
        require_absence(python, clone, deleted)
        for check in checks:
            done = run(python, clone, *check)
            # As a whole, since another check prints at the same time.
            printed = (done.stdout + done.stderr).decode(errors="replace")
            print(f"Without {label}: {' '.join(check)[:90]}\n{printed}", flush=True)
            if done.returncode:
                print(f"Without {label} something else fails.", flush=True)
                return False
    print(f"Without {label}: all passed in {time.monotonic() - began:.0f} s.")
    return True


def copy_repository(clone: Path, deleted: set[Path]) -> None:
    """Copy the repository, which need not have its history, but for the folders of plug-ins."""

    def leave_out(folder: str, names: list[str]) -> set[str]:
        return MADE(folder, names) | {name for name in names if Path(folder, name) in deleted}

    shutil.copytree(ROOT, clone, ignore=leave_out, symlinks=True)


def make_environment(clone: Path) -> Path:
    """Make an environment for the copy, with the third-party packages of this one.

    An environment that took over the packages of this one as a whole would find the plug-in there.

    Returns:
        Its interpreter.
    """
    environment = clone / ".venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    (packages,) = environment.glob("lib/python*/site-packages")
    here = next(Path(place) for place in sys.path if Path(place).name == "site-packages")
    for entry in here.iterdir():
        if not entry.name.lstrip("_").startswith("eigenfail"):
            (packages / entry.name).symlink_to(entry)
    for script in Path(sys.executable).parent.iterdir():
        place = environment / "bin" / script.name
        if script.name != "eigenfail" and not place.exists():
            place.symlink_to(script)
    python = environment / "bin" / "python"
    projects = [clone, *(file.parent for file in clone.glob("plugins/*/pyproject.toml"))]
    options = ("--quiet", "--no-deps", "--no-index", "--no-build-isolation")
    editable = [str(word) for project in projects for word in ("--editable", project)]
    run(python, clone, "-m", "pip", "install", *options, *editable).check_returncode()
    return python


def require_absence(python: Path, clone: Path, deleted: set[Path]) -> None:
    """Raise CalledProcessError if the core is not the copy's, or a deleted plug-in is there."""
    script = (
        "import sys, eigenfail\n"
        "from importlib.metadata import distributions\n"
        "from pathlib import Path\n"
        "assert Path(sys.argv[1]) in Path(eigenfail.__file__).parents, eigenfail.__file__\n"
        "assert not {*sys.argv[2:]} & {each.name for each in distributions()}\n"
    )
    names = sorted(folder.name for folder in deleted)
    run(python, clone, "-c", script, str(clone), *names).check_returncode()


def run(python: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[bytes]:
    """Run Python in a folder, without what this process has in its environment of ours."""
    ours = ("EIGENFAIL", "PYTHONPATH", "VIRTUAL_ENV", "PYTEST")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
    kept["NO_MKDOCS_2_WARNING"] = "1"
    return subprocess.run([python, *words], cwd=folder, env=kept, check=False, capture_output=True)


if __name__ == "__main__":
    sys.exit(main())
