"""Machines of a network that a test made itself: namespaces on a bridge, and what runs there.

None of them has a name, and none is reached from outside. Each lasts as long as a process that dies
with the test, however that ends, so nothing of them can be left behind.
"""

import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from itertools import count
from pathlib import Path

import deadlines

WITH_US = ("setpriv", "--pdeathsig", "KILL")
HOLD = 'echo "$0" > /proc/sys/kernel/hostname && echo up && exec sleep infinity'
NETWORK = "10.77.0"
END_WITHIN_S = deadlines.PROCESS_S


class Namespaces(Exception):
    """This machine cannot make network namespaces."""


class Host:
    """A machine with a name, an address, and a cable to the switch.

    Attributes:
        name: as it calls itself.
        address: by which the others reach it.
    """

    def __init__(self, name: str, number: int = 0) -> None:
        self.name = name
        self.address = f"{NETWORK}.{number}"
        command = [*WITH_US, "unshare", "--net", "--uts", "sh", "-c", HOLD, name]
        self._held = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        if self._held.stdout.readline() != b"up\n":
            raise Namespaces(self._held.communicate()[1].decode())
        self.pid = self._held.pid
        self._started: list[subprocess.Popen[bytes]] = []
        self.do("ip", "link", "set", "lo", "up")

    def command(self, words: Sequence[str]) -> list[str]:
        """As it is run there."""
        return ["nsenter", "--target", str(self.pid), "--net", "--uts", *words]

    def do(self, *words: str) -> str:
        """Run something there to its end; what it printed."""
        done = subprocess.run(self.command(words), capture_output=True, text=True, check=False)
        if done.returncode:
            raise Namespaces(f"{' '.join(words)}: {done.stderr}")
        return done.stdout

    def eigenfail(self, *words: str) -> str:
        """Run the command line there to its end; what it printed."""
        return self.do(str(Path(sys.executable).with_name("eigenfail")), *words)

    def start(self, *words: str, log: Path) -> "subprocess.Popen[bytes]":
        """A module that runs there until it is ended, or the test is."""
        command = self.command([*WITH_US, sys.executable, "-m", *words])
        with log.open("ab") as stream:
            self._started.append(subprocess.Popen(command, stdout=stream, stderr=stream))
        return self._started[-1]

    def end(self) -> None:
        """End all that was started there, and with it the machine."""
        for process in self._started:
            process.terminate()
        until_s = time.monotonic() + END_WITHIN_S
        for process in self._started:
            try:
                process.wait(max(0.0, until_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._held.kill()
        self._held.communicate()


class Network:
    """A switch, and hosts with cables to it.

    Raises:
        Namespaces: there can be none here.
    """

    def __init__(self) -> None:
        self._ending = ExitStack()
        self._numbers = count(1)
        self._plugs: dict[Host, str] = {}
        self._switch = self._keep(Host("switch"))
        try:
            self._switch.do("ip", "link", "add", "bridge", "type", "bridge")
            self._switch.do("ip", "link", "set", "bridge", "up")
        except Namespaces:
            self.close()
            raise

    def _keep(self, host: Host) -> Host:
        self._ending.callback(host.end)
        return host

    def host(self, name: str) -> Host:
        """One more machine, with its cable plugged in."""
        number = next(self._numbers)
        host = self._keep(Host(name, number))
        plug = self._plugs[host] = f"plug{number}"
        veth = ("type", "veth", "peer", "name", "cable", "netns", str(host.pid))
        self._switch.do("ip", "link", "add", plug, *veth)
        self._switch.do("ip", "link", "set", plug, "master", "bridge", "up")
        host.do("ip", "address", "add", f"{host.address}/24", "dev", "cable")
        host.do("ip", "link", "set", "cable", "up")
        return host

    def slow_down(self, host: Host, rate: str) -> None:
        """Let no more than so much through its cable, from it and to it."""
        bucket = ("root", "tbf", "rate", rate, "burst", "32kbit", "latency", "400ms")
        host.do("tc", "qdisc", "add", "dev", "cable", *bucket)
        self._switch.do("tc", "qdisc", "add", "dev", self._plugs[host], *bucket)

    def unplug(self, host: Host) -> None:
        """Nothing gets to it, nor from it; nobody is told."""
        self._switch.do("ip", "link", "set", self._plugs[host], "down")

    def plug_in(self, host: Host) -> None:
        """After `unplug`."""
        self._switch.do("ip", "link", "set", self._plugs[host], "up")

    def close(self) -> None:
        """End everything, the last host first."""
        self._ending.close()
