"""The recipes' steps, done without a container engine, in some minutes and as root.

Every RUN and COPY of the Dockerfile is done in layers of its own, for both targets. Then the
services of the compose file are started from them, in its order and with its commands, variables,
volumes and health checks, beside a real PostgreSQL; a campaign runs, workers and Ray's head are
killed, another campaign runs, and all is stopped. It says what it does, and ends with 1 if
anything is not as it should be.
"""

import os
import signal
import sys
import tempfile
import time
import tomllib
from pathlib import Path

sys.path.append(str(Path(__file__).parent))

from building import Builder, sh
from composed import Composed
from packaging.utils import canonicalize_name
from recipe import stages

ROOT = Path(__file__).parents[2]
INDEX = "TORCH_INDEX"
LOCKS = ("server.txt", "worker.txt", "torch_cpu.txt")
PROJECTS = (ROOT / "pyproject.toml", *ROOT.glob("plugins/*/pyproject.toml"))
BY_KUBERAY = (
    ("bash", "-c", "--", "ray start --help"),
    ("bash", "-c", "--", "ray health-check --help"),
    ("ray", "kuberay-autoscaler", "--help"),
    ("python", "-c", "import ray.autoscaler._private.kuberay.run_autoscaler"),
    ("python", "-c", "import ray.autoscaler.v2.monitor"),
)
SPEC = """name = "image"
method = "monte_carlo"
planner = "idm"
episodes = 5
"""
CAMPAIGN = (
    *("sh", "-euc", f"echo '{SPEC}' > c.toml; exec eigenfail run c.toml \"$@\"", "sh"),
    *("--url", "http://controller:8440", "--json"),
)


def main() -> int:
    """Do it all; 1 if something is wrong."""
    with tempfile.TemporaryDirectory(prefix="eigenfail-image-") as name:
        folder = Path(name)
        sh("mount", "-n", "-t", "tmpfs", "-o", "size=10g", "tmpfs", folder)
        try:
            images = build(folder / "build")
            composed = Composed(ROOT / "deploy" / "compose.yaml", images, folder / "run", tell)
            with composed:
                check_packages(composed)
                lead_through(composed)
        finally:
            sh("umount", "-n", "--recursive", folder)
    tell("All of it is as it should be.")
    return 0


def build(folder: Path):
    """Both targets, and what they begin with. torch comes from this machine's own index."""
    builder = Builder(folder, ROOT, {INDEX: os.environ.get(INDEX, "")}, tell)
    for stage in stages(ROOT / "deploy" / "Dockerfile").values():
        builder.build(stage)
    tell(f"Built: {', '.join(builder.built)}.")
    return {name: builder.built[name] for name in ("everything", "worker")}


def check_packages(composed: Composed) -> None:
    """Raises AssertionError if a package is not pinned, or one is missing that KubeRay starts."""
    lines = [
        line
        for name in LOCKS
        for line in (ROOT / "deploy" / "locks" / name).read_text().splitlines()
    ]
    pinned = {name_of(line.split()[0]) for line in lines if "==" in line}
    projects = [tomllib.loads(file.read_text())["project"] for file in PROJECTS]
    core, *plug_ins = (name_of(f"{each['name']}=={each['version']}") for each in projects)
    expected = {"everything": {core, *plug_ins}, "worker": {core}}
    for image in ("worker", "everything"):
        told = composed.ask(("pip", "list", "--format=freeze"), image)
        found = {name_of(line) for line in told.splitlines() if "==" in line}
        loose = {line for line in found - pinned - expected[image] if not line.startswith("pip==")}
        assert not loose, f"not pinned in {image}: {loose}"
        assert found >= expected[image], f"missing in {image}: {expected[image] - found}"
        tell(f"{len(found)} packages are in {image}, and all of them are pinned.")
    for words in BY_KUBERAY:
        composed.ask(words)


def name_of(line: str) -> str:
    """With one spelling of each name."""
    name, _, version = line.partition("==")
    return f"{canonicalize_name(name)}=={version}"


def lead_through(composed: Composed) -> None:
    """What somebody does with it who follows the document."""
    composed.up("postgres", "migrate", "admin-key", "keys", "ray-token")
    composed.up("controller", "ray-head", "services")
    composed.up("worker", "worker-2")
    composed.check_cannot_write()
    composed.run_campaign(CAMPAIGN, "workers of Ray")

    tell("Both nodes of Ray are killed; two others join.")
    for name in ("worker", "worker-2"):
        composed.kill(name)
    composed.up("worker", "worker-2")
    composed.run_campaign(CAMPAIGN, "other workers of Ray")

    tell("Ray's head is killed, and starts again; plain workers do the work meanwhile.")
    composed.kill("ray-head")
    composed.up("plain-worker")
    composed.run_campaign(CAMPAIGN, "a plain worker, of the small image")
    composed.up("ray-head")
    for name in ("worker", "worker-2"):
        composed.kill(name)
    composed.stop("plain-worker")
    composed.up("worker", "worker-2")
    composed.run_campaign(CAMPAIGN, "workers of Ray's new head")

    tell("The services are killed, and start again.")
    composed.kill("services")
    composed.up("services")
    composed.run_campaign(CAMPAIGN, "the services started again")
    for name in ("controller", "services"):
        composed.stop(name)


def tell(text: str) -> None:
    """Say what is being done, and when."""
    sys.stdout.write(f"{time.strftime('%H:%M:%S')} {text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    if "--here" not in sys.argv:  # mounts that are nobody else's, and end with this process
        apart = ("unshare", "--mount", "--propagation", "private", sys.executable)
        os.execvp(apart[0], [*apart, *sys.argv, "--here"])
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    sys.exit(main())
