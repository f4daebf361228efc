"""Runs containers without an engine: with unshare, overlayfs and network namespaces.

There is, of a container: a root that cannot be written, folders in memory, volumes, its own
processes, name and address on a network that leads nowhere, a user without rights. There are no
limits of memory and no system calls that are forbidden.
"""

import os
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import psutil
from building import Built, sh

NO_RIGHTS = (
    *("--reuid=10001", "--regid=10001", "--clear-groups", "--inh-caps=-all"),
    *("--bounding-set=-all", "--no-new-privs"),
)
IN_TMP = ("sh", "-c", 'cd /tmp; exec "$@"', "sh")
APART = (
    *("--mount", "--uts", "--ipc", "--pid", "--fork", "--kill-child=KILL", "--mount-proc"),
    *("--propagation", "private"),
)


class Network:
    """A bridge, and an address for each name; nothing leads out of it."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix
        self.hosts: dict[str, str] = {}
        sh("ip", "netns", "add", f"{prefix}-switch")
        inside = ("ip", "-n", f"{prefix}-switch", "link")
        sh(*inside, "add", "bridge0", "type", "bridge")
        sh(*inside, "set", "bridge0", "up")

    def add(self, name: str) -> None:
        """A place on it."""
        space, cable = f"{self.prefix}-{name}", f"v{os.getpid() % 10_000}x{len(self.hosts)}"
        self.hosts[name] = f"10.77.0.{10 + len(self.hosts)}"
        sh("ip", "netns", "add", space)
        switch = f"{self.prefix}-switch"
        sh(
            "ip",
            "link",
            "add",
            cable,
            "netns",
            switch,
            "type",
            "veth",
            "peer",
            "name",
            "eth0",
            "netns",
            space,
        )
        sh("ip", "-n", switch, "link", "set", cable, "master", "bridge0", "up")
        sh("ip", "-n", space, "addr", "add", f"{self.hosts[name]}/24", "dev", "eth0")
        for device in ("lo", "eth0"):
            sh("ip", "-n", space, "link", "set", device, "up")

    def close(self) -> None:
        """Take everything away."""
        for name in (*self.hosts, "switch"):
            subprocess.run(["ip", "netns", "del", f"{self.prefix}-{name}"], check=False)


INSIDE = """
set -eu
root=$1; name=$2; folder=$3; shift 3
hostname "$name"
mount -n -t overlay overlay -o "lowerdir=$LAYERS" "$root"
mount -n -t proc proc "$root/proc"
mount -n --rbind /dev "$root/dev"
mount -n -t tmpfs -o size=128m,mode=1777,noexec,nosuid,nodev tmpfs "$root/dev/shm"
mount -n -t tmpfs -o size=512m,mode=1777,noexec,nosuid,nodev tmpfs "$root/tmp"
mount -n --bind "$folder/hosts" "$root/etc/hosts"
for pair in $VOLUMES; do
    mount -n --bind "${pair%%=*}" "$root${pair#*=}"
    case $READ_ONLY in *" ${pair#*=} "*) mount -n -o remount,bind,ro "$root${pair#*=}";; esac
done
unset LAYERS VOLUMES READ_ONLY
cd "$root"
exec chroot "$root" "$@"
"""


class Container:
    """A process in a place of its own."""

    def __init__(
        self,
        name: str,
        image: Built,
        folder: Path,
        network: Network,
        volumes: Mapping[str, tuple[Path, bool]],
    ) -> None:
        self.name = name
        self.log = folder / f"{name}.log"
        self._image = image
        self._network = network
        self._folder = folder
        self._volumes = volumes
        self.process: subprocess.Popen[bytes] | None = None

    def start(self, words: Sequence[str], environment: Mapping[str, str]) -> None:
        """Begin; what it writes is in its log."""
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                self._command(words),
                env=self._environment(environment),
                stdout=log,
                stderr=subprocess.STDOUT,
            )

    def _command(self, words: Sequence[str]) -> list[str]:
        root = self._folder / f"{self.name}.root"
        root.mkdir(exist_ok=True)
        hosts = [f"{address} {name}" for name, address in self._network.hosts.items()]
        (self._folder / "hosts").write_text("\n".join(("127.0.0.1 localhost", *hosts, "")))
        space = ("ip", "netns", "exec", f"{self._network.prefix}-{self.name}", "unshare")
        inside = ("sh", "-c", INSIDE, "sh", str(root), self.name, str(self._folder))
        return [*space, *APART, *inside, "setpriv", *NO_RIGHTS, *IN_TMP, *words]

    def _environment(self, environment: Mapping[str, str]) -> dict[str, str]:
        volumes = self._volumes.items()
        return {
            "LAYERS": self._image.lower(),
            "VOLUMES": " ".join(f"{path}={place}" for place, (path, _) in volumes),
            "READ_ONLY": " ".join(["", *(place for place, (_, kept) in volumes if kept), ""]),
            **self._image.environment,
            **environment,
        }

    def first(self) -> int:
        """The number, on this machine, of its first process, which may have to begin first."""
        assert self.process is not None
        while self.process.poll() is None:
            if children := psutil.Process(self.process.pid).children():
                return children[0].pid
            time.sleep(0.01)
        raise ProcessLookupError(f"{self.name} has ended: {self.log.read_text()[-3000:]}")

    def within(
        self, words: Sequence[str], environment: Mapping[str, str]
    ) -> subprocess.CompletedProcess[str]:
        """Run a command in it, as `exec` of an engine does; its health check, for one."""
        enter = ("nsenter", "--target", str(self.first()), "--all", "--root", "--wd")
        return subprocess.run(
            [*enter, "setpriv", *NO_RIGHTS, *words],
            env={**self._image.environment, **environment},
            capture_output=True, text=True, check=False,
        )  # fmt: skip

    def end(self, number: int = signal.SIGTERM, within_s: float = 60.0) -> int:
        """Send its first process a signal; how it ended."""
        assert self.process is not None
        with suppress(ProcessLookupError):
            os.kill(self.first(), number)
        try:
            return self.process.wait(within_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            return -1
