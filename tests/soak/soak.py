"""Kill parts of a running service at random for some minutes; then see that nothing was lost.

`make soak MINUTES=5`. Prints its seed; the same seed draws the same faults in the same order.
"""

import argparse
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import psutil

from eigenfail.client import Client
from eigenfail.hosting.service import Launcher, LocalService, Plan, local_service
from eigenfail.values import FINAL_STATES

WORKERS = 2
PAUSE_S = (0.5, 4.0)
CAMPAIGNS = (
    {"method": "monte_carlo", "planner": "idm", "episodes": 300, "seed": 11},
    {"method": "ast", "planner": "idm", "episodes": 80, "seed": 12},
    {"method": "difs", "planner": "idm", "episodes": 60, "seed": 13},
)


class Victims:
    """The processes that may be killed at any time."""

    def __init__(self, service: LocalService) -> None:
        self._service = service
        self._workers = [self._start(number) for number in range(WORKERS)]

    def _start(self, number: int) -> "subprocess.Popen[bytes]":
        hub = self._service.address.hub
        command = [sys.executable, "-m", "eigenfail_workers", "--connect", hub]
        quiet = subprocess.DEVNULL
        return subprocess.Popen([*command, "--name", f"w{number}"], stdout=quiet, stderr=quiet)

    def kill(self, kind: str, random_: random.Random) -> bool:
        """Kill one of a kind; False if there is none at the moment."""
        try:
            found = self._find(kind)
            random_.choice(found).kill()
        except (IndexError, psutil.NoSuchProcess):  # none now, or it ended by itself as we looked
            return False
        return True

    def _find(self, kind: str) -> list[psutil.Process]:
        roots = {
            "worker": self._workers,
            "child": self._workers,
            "learner": self._learner_parents(),
        }
        if kind == "worker":
            return [psutil.Process(w.pid) for w in self._workers if w.poll() is None]
        below = [
            child
            for root in roots[kind]
            if root.poll() is None
            for child in psutil.Process(root.pid).children()
        ]
        return [
            p for p in below if ("learner_process" in " ".join(p.cmdline())) == (kind == "learner")
        ]

    def _learner_parents(self) -> "list[subprocess.Popen[bytes]]":
        return [part.process for part in self._service.parts if part.name == "services"]

    def replace_the_dead(self) -> None:
        """Start workers again, as Ray does."""
        for number, worker in enumerate(self._workers):
            if worker.poll() is not None:
                self._workers[number] = self._start(number)

    def end(self) -> None:
        """Stop the workers that live."""
        for worker in self._workers:
            worker.terminate()
            worker.wait(30)


def digests(client: Client) -> list[str]:
    """Run each campaign undisturbed."""
    found = []
    for fields in CAMPAIGNS:
        campaign = client.campaigns.create(name="calm", **fields)
        client.campaigns.wait(campaign.id, timeout_s=600)
        found.append(client.campaigns.digest(campaign.id))
    return found


def storm(
    client: Client, victims: Victims, minutes: float, seed: int
) -> tuple[Counter[str], list[int]]:
    """Run the campaigns again and again while things die; what died, and the campaigns."""
    random_, killed, campaigns = random.Random(seed), Counter[str](), []
    deadline = time.monotonic() + 60 * minutes
    while time.monotonic() < deadline:
        if not campaigns or client.campaigns.get(campaigns[-1]).state in FINAL_STATES:
            fields = CAMPAIGNS[len(campaigns) % len(CAMPAIGNS)]
            campaigns.append(client.campaigns.create(name="storm", **fields).id)
        time.sleep(random_.uniform(*PAUSE_S))
        kind = random_.choice(["worker", "child", "child", "learner"])
        killed[kind] += victims.kill(kind, random_)
        victims.replace_the_dead()
    return killed, campaigns


def complaints(client: Client, campaigns: list[int], calm: list[str]) -> list[str]:
    """Whatever is not as it would have been without the storm."""
    found = []
    for place, number in enumerate(campaigns):
        campaign = client.campaigns.wait(number, timeout_s=600)
        counts = campaign.counts
        if counts.completed != counts.planned:
            found.append(f"campaign {number}: {counts}, {campaign.stopped_because}")
        if client.campaigns.digest(number) != calm[place % len(calm)]:
            found.append(f"campaign {number}: another digest")
    return found


def main() -> None:
    """Calm, storm, verdict; exit code 1 if anything was lost or changed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(2**31))
    arguments = parser.parse_args()
    print(f"seed {arguments.seed}, {arguments.minutes:g} minutes", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        plan = Plan(Path(folder), port=0, launcher=Launcher.NONE)
        with local_service(plan) as service, Client(service.address.url) as client:
            victims = Victims(service)
            calm = digests(client)
            killed, campaigns = storm(client, victims, arguments.minutes, arguments.seed)
            found = complaints(client, campaigns, calm)
            victims.end()
    print(f"killed {dict(killed)} during {len(campaigns)} campaigns")
    print("\n".join(found) or "nothing lost, nothing doubled, every digest as in the calm")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
