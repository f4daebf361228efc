"""`eigenfail campaign workers`: who ran the episodes."""

import msgspec

from eigenfail.values.operations import WorkerShare


def test_who_ran_the_episodes(eigenfail, done, store):
    told = eigenfail("campaign", "workers", done)
    assert told.exit_code == 0, told.output
    (share,) = store.figures.workers(done)
    assert f"{share.worker} 24 100 % {share.failures} 0 " in " ".join(told.stdout.split())


def test_as_json_it_is_the_values(eigenfail, done, store):
    told = eigenfail("campaign", "workers", done, "--json").stdout
    found = msgspec.json.decode(told, type=tuple[WorkerShare, ...])
    assert found == store.figures.workers(done)
