"""Check that everything else works when a plug-in's folder is deleted.

    .venv/bin/python deploy/without_plugins.py

For each folder of plugins/ the repository is copied without it, to an environment of its own in
which the plug-in is not installed. There the linters run, and the core's tests of what a plug-in
could be tied to: commands, routes, documents, benchmarks and recipes. It prints what it runs; the
exit code is 1 if any of it fails. `make test` does this in the end.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parent.parent
PLUGINS = tuple(sorted(file.parent for file in ROOT.glob("plugins/*/pyproject.toml")))
LINT_IMPORTS = "from importlinter.cli import lint_imports_command; lint_imports_command()"
CHECKS = (
    ("-m", "ruff", "check", "."),
    ("-m", "ruff", "format", "--check", "."),
    ("-m", "mypy"),
    ("-c", LINT_IMPORTS),
    ("deploy/structure.py",),
    ("-m", "mkdocs", "build", "--quiet", "--site-dir", ".site"),
    (
        *("-m", "pytest", "-q", "-m", "not service and not browser"),
        *("tests/test_plugins.py", "tests/test_golden.py", "tests/sdk/cli/test_plugin_commands.py"),
        *("tests/sdk/cli/test_main.py", "tests/sdk/cli/test_completion.py"),
        *("tests/docs/test_cli_page.py", "tests/docs/test_documents.py", "tests/docs/test_site.py"),
        *("tests/docs/test_noise_page.py", "tests/docs/test_claims.py"),
        *("tests/docs/test_episodes_page.py", "tests/docs/test_plugins_page.py"),
        *("tests/sdk/exchange/test_formats.py", "tests/api/test_recordings.py"),
        *("tests/docs/test_rest_page.py", "tests/api/test_extensions.py"),
        *("tests/benchmarks/test_trials.py", "tests/deploy/test_recipes.py"),
        "tests/deploy/test_locks.py",
    ),
)
"""What python is called with, one after the other."""

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
"""What is made in the repository, but for the cache of mypy, which compares contents: it saves most
of mypy's time in the copy."""


def main() -> int:
    """Check without each plug-in in turn; 1 if something fails."""
    failed = [folder.name for folder in PLUGINS if not check_without(folder)]
    if failed:
        print(f"Without these plug-ins something else fails: {', '.join(failed)}.")
    return 1 if failed else 0


def check_without(plugin: Path) -> bool:
    """Return whether all checks pass in a copy of the repository without a plug-in."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="eigenfail-without-") as name:
        clone = Path(name) / "clone"
        copy_repository(clone, plugin)
        python = make_environment(clone)
        require_absence(python, clone, plugin.name)
        for check in CHECKS:
            print(f"Without {plugin.name}: {' '.join(check)[:90]}", flush=True)
            if run(python, clone, *check).returncode:
                return False
    print(f"Without {plugin.name}: all passed in {time.monotonic() - began:.0f} s.")
    return True


def copy_repository(clone: Path, plugin: Path) -> None:
    """Copy the repository, which need not have its history, but for the folder of a plug-in."""

    def leave_out(folder: str, names: list[str]) -> set[str]:
        return MADE(folder, names) | {name for name in names if Path(folder, name) == plugin}

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


def require_absence(python: Path, clone: Path, plugin: str) -> None:
    """Raises CalledProcessError unless the core is the copy's and the plug-in is not installed."""
    script = (
        "import sys, eigenfail\n"
        "from importlib.metadata import distributions\n"
        "from pathlib import Path\n"
        "assert Path(sys.argv[1]) in Path(eigenfail.__file__).parents, eigenfail.__file__\n"
        "assert sys.argv[2] not in {each.name for each in distributions()}\n"
    )
    run(python, clone, "-c", script, str(clone), plugin).check_returncode()


def run(python: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[bytes]:
    """Run Python in a folder, without what this process has in its environment of ours."""
    ours = ("EIGENFAIL", "PYTHONPATH", "VIRTUAL_ENV", "PYTEST")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
    kept["NO_MKDOCS_2_WARNING"] = "1"
    return subprocess.run([python, *words], cwd=folder, env=kept, check=False)


if __name__ == "__main__":
    sys.exit(main())
