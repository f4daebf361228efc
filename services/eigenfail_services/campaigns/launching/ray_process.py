"""The process of Ray's driver: has the workers that it is told to have, and says how they stand.

Wishes come over its standard input, words go to its standard output; Ray's own go to standard
error. It ends with its input, and with the services.
"""

import os
import select
import sys
from collections.abc import Callable
from typing import NoReturn

import msgspec

from eigenfail import logs
from eigenfail.errors import ClusterUnavailable
from eigenfail.processes import die_with_parent, end_now
from eigenfail.wire.curve import read_worker_key
from eigenfail_services.campaigns.launching.ray_cluster import Cluster
from eigenfail_services.campaigns.launching.ray_words import (
    Begin,
    Lines,
    Lost,
    Wanted,
    line,
)
from eigenfail_services.campaigns.launching.ray_workers import RayWorkers

SAY_EVERY_S = 0.5

Say = Callable[[msgspec.Struct], None]


def main() -> NoReturn:
    """Serve until the input ends, or until Ray is lost."""
    die_with_parent()
    logs.configure("services")
    say = take_output()
    with open(sys.stdin.fileno(), "rb", buffering=0, closefd=False) as stream:
        begin = msgspec.json.decode(stream.readline(), type=Begin)
    try:
        serve(begin, Lines(sys.stdin.fileno(), msgspec.json.Decoder(Wanted)), say)
    except ClusterUnavailable as error:
        say(Lost(error.problem, error.remedy))
        end_now(ClusterUnavailable.exit_code)
    end_now(0)


def take_output() -> Say:
    """A way to speak to the services; what others print goes to standard error."""
    words = os.dup(sys.stdout.fileno())
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

    def say(word: msgspec.Struct) -> None:
        os.write(words, line(word))

    return say


def serve(begin: Begin, wishes: Lines[Wanted], say: Say) -> None:
    """Have those workers that were wanted last.

    Raises:
        ClusterUnavailable: there is no Ray, or it is lost.
    """
    key = None if begin.key is None else read_worker_key(begin.key, "key")
    cluster = Cluster(begin.cluster, begin.most)
    workers = RayWorkers(begin.hub, key)
    names: tuple[str, ...] = ()
    while not wishes.ended:
        for wish in wishes.read():
            names = wish.names
        machines = cluster.machines()
        workers.want(names)
        say(workers.standing(machines))
        select.select([sys.stdin], [], [], SAY_EVERY_S)
    workers.dismiss()
    cluster.close()


if __name__ == "__main__":
    main()
