"""What the services and the process of Ray's driver say to each other, over real pipes."""

import time
from contextlib import ExitStack

import pytest

from eigenfail_services.campaigns import ray_link
from eigenfail_services.campaigns.ray_link import RayLink, StartRay

pytestmark = pytest.mark.service

PIPE = 65_536
"""What a pipe holds. [bytes]"""


def test_lists_that_no_pipe_holds_come_whole_in_both_directions(monkeypatch) -> None:
    monkeypatch.setattr(ray_link, "MODULE", "eigenfail_roomy_ray")
    many = tuple(f"machine-of-a-cluster-12345.{number}" for number in range(8_000))
    assert sum(map(len, many)) > 3 * PIPE
    link = RayLink(StartRay("tcp://127.0.0.1:1", None, None, 1))
    with ExitStack() as ending:
        ending.callback(link.stop)
        for names in (many, many[:1], many[1:]):
            wait_for(link, names)


def wait_for(link: RayLink, names: tuple[str, ...]) -> None:
    """Ask for them until they have their places."""
    placed: tuple[str, ...] | None = None
    while placed != names:
        assert link.trouble() == ""
        link.want(names)
        for standing in link.hear():
            placed = standing.placed
        time.sleep(0.01)
