"""Write the lock files: every package that is installed, its version, the hashes of its files.

    .venv/bin/python deploy/lock.py            keep the locked versions; follow pyproject.toml
    .venv/bin/python deploy/lock.py numpy ray  also take the newest releases of these packages

Needs PyPI. The CPU builds of torch are listed at their own index, which is asked only when torch's
version has changed.
"""

import re
import subprocess
import sys
import tempfile
import tomllib
import urllib.request
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from packaging.utils import canonicalize_name
from uv import find_uv_bin

ROOT = Path(__file__).parents[1]
PROJECT = ROOT / "pyproject.toml"
PLUGINS = tuple(sorted(ROOT.glob("plugins/*/pyproject.toml")))
DEVELOPMENT = ROOT / "constraints.txt"
LOCKS = ROOT / "deploy" / "locks"
TORCH_CPU = LOCKS / "torch_cpu.txt"
TORCH_INDEX = "https://download.pytorch.org/whl/cpu/torch/"
TIMEOUT_S = 30
HEADER = "# Written by deploy/lock.py. Do not edit.\n"
PLATFORM = ("--python-version", "3.11", "--python-platform", "x86_64-manylinux_2_28")
"""Where versions are chosen. The hashes are those of a release's files for all platforms."""

# What PyPI's build of torch for Linux needs and the CPU build does not.
CUDA = re.compile(r"(cuda|nvidia)-[a-z0-9-]+|triton")
CPU_WHEEL = re.compile(
    r"torch-(?P<version>[\d.]+)(?:\+|%2B)cpu-cp31[12]-[^#\"<>]*_(?:x86_64|aarch64)\.whl"
    r"#sha256=(?P<digest>[0-9a-f]{64})"
)

Lock = Mapping[str, str]
"""Lines of a lock file by the name of the package: its pin and its hashes."""


def main(upgraded: Sequence[str]) -> int:
    """Write every lock file; 1 if one cannot be made."""
    everything = compile_lock(("dev", "deploy-checks"), upgraded)
    torch = lock_cpu_torch(version_of(everything["torch"]))
    if torch is None:
        return 1
    cuda = {name for name in everything if CUDA.fullmatch(name)} | {"torch"}
    for path, names in (
        (LOCKS / "build.txt", list_names((), everything)),
        (LOCKS / "compiler.txt", list_names(("compiler",), everything)),
        (LOCKS / "worker.txt", list_names(("worker",), everything)),
        (LOCKS / "server.txt", list_names(("server", "worker", "postgres"), everything) - cuda),
        (LOCKS / "torch_cuda.txt", cuda),
    ):
        write(path, (everything[name] for name in sorted(names)))
    write(TORCH_CPU, [torch])
    development = {name: everything[name] for name in everything.keys() - cuda} | {"torch": torch}
    write(DEVELOPMENT, (development[name] for name in sorted(development)))
    return 0


def compile_lock(extras: Sequence[str], upgraded: Sequence[str]) -> dict[str, str]:
    """Resolve the project with some extras and its build backend; versions stay as they are locked.

    Raises:
        CalledProcessError: no set of versions fits, or PyPI was not reached.
    """
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "lock.txt"
        output.write_text("".join(locked_versions()), "utf-8")
        run_uv(
            *(PROJECT, write_build_requirements(Path(folder))),
            *(write_plugin_requirements(Path(folder)), "--generate-hashes"),
            *(word for extra in extras for word in ("--extra", extra)),
            *(word for name in upgraded for word in ("--upgrade-package", name)),
            *("--output-file", output),
        )
        return read_lock(output.read_text("utf-8"))


def list_names(extras: Sequence[str], everything: Lock) -> set[str]:
    """Names of all packages that some extras need; without extras, those that build the project.

    Plug-ins are installed beside the server: what they need belongs to that extra.
    """
    with tempfile.TemporaryDirectory() as folder:
        pins = Path(folder) / "pins.txt"
        pins.write_text("".join(pin_of(block) for block in everything.values()), "utf-8")
        build = write_build_requirements(Path(folder))
        sources = [PROJECT, *(word for extra in extras for word in ("--extra", extra))]
        if "server" in extras:
            sources.append(write_plugin_requirements(Path(folder)))
        text = run_uv(*(sources if extras else (build,)), "--constraint", pins)
    return set(read_lock(text))


def run_uv(*words: str | Path) -> str:
    """Run uv's resolver, and return what it prints.

    Raises:
        CalledProcessError: no set of versions fits, or PyPI was not reached.
    """
    command = (find_uv_bin(), "pip", "compile", "--quiet", "--strip-extras", *PLATFORM, *words)
    plain = ("--no-header", "--no-annotate")
    return subprocess.run([*command, *plain], check=True, stdout=subprocess.PIPE, text=True).stdout


def write_build_requirements(folder: Path) -> Path:
    """Write what builds the project, as requirements for the resolver."""
    path = folder / "build.txt"
    requires = tomllib.loads(PROJECT.read_text("utf-8"))["build-system"]["requires"]
    path.write_text("".join(f"{line}\n" for line in requires), "utf-8")
    return path


def write_plugin_requirements(folder: Path) -> Path:
    """Write what the plug-ins need besides eigenfail, as requirements for the resolver."""
    path = folder / "plugins.txt"
    projects = [tomllib.loads(file.read_text("utf-8"))["project"] for file in PLUGINS]
    lines = [line for project in projects for line in project["dependencies"]]
    path.write_text("".join(f"{line}\n" for line in lines if not is_ours(line)), "utf-8")
    return path


def is_ours(requirement: str) -> bool:
    """Return whether a requirement is of eigenfail itself or of one of its plug-ins."""
    return requirement.startswith("eigenfail")


def locked_versions() -> Iterator[str]:
    """The pins of the present lock files, without hashes and without torch's local label."""
    for path in (DEVELOPMENT, LOCKS / "torch_cuda.txt"):
        if path.exists():
            yield from (pin_of(block) for block in read_lock(path.read_text("utf-8")).values())


def lock_cpu_torch(version: str) -> str | None:
    """Pin and hashes of the CPU builds of torch; None, with a message, if they cannot be had."""
    present = TORCH_CPU.read_text("utf-8") if TORCH_CPU.exists() else ""
    block = read_lock(present).get("torch")
    if block and version_of(block) == version:
        return block
    try:
        with urllib.request.urlopen(TORCH_INDEX, timeout=TIMEOUT_S) as answer:
            found = read_cpu_hashes(answer.read().decode(), version)
    except OSError as error:
        print(f"{TORCH_INDEX} cannot be reached ({error}): run this where it can be.")
        return None
    if not found:
        print(f"{TORCH_INDEX} lists no CPU build of torch {version}: pin another version.")
        return None
    hashes = [f"    --hash=sha256:{digest}" for digest in found]
    return " \\\n".join([f"torch=={version}+cpu", *hashes]) + "\n"


def read_cpu_hashes(page: str, version: str) -> list[str]:
    """SHA-256 of each CPU build for Linux of a version, as the index lists them."""
    return sorted({m["digest"] for m in CPU_WHEEL.finditer(page) if m["version"] == version})


def read_lock(text: str) -> dict[str, str]:
    """The lines of each package, by its canonical name."""
    kept = "".join(line for line in text.splitlines(True) if not line.lstrip().startswith("#"))
    blocks = [block for block in re.split(r"^(?=\w)", kept, flags=re.MULTILINE) if block.strip()]
    return {canonicalize_name(block.split("==")[0]): block for block in blocks}


def pin_of(block: str) -> str:
    """The pin without hashes and without a local label: `name==version`, and a line feed."""
    return re.split(r"[\s+;\\]", block, maxsplit=1)[0] + "\n"


def version_of(block: str) -> str:
    """The version of a pin, without a local label."""
    return pin_of(block).strip().split("==")[1]


def write(path: Path, blocks: Iterable[str]) -> None:
    """Write a lock file."""
    path.parent.mkdir(exist_ok=True)
    path.write_text(HEADER + "".join(blocks), "utf-8")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
