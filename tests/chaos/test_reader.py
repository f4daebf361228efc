"""What the reader tells: nothing of a sound database, and each kind of damage by its name."""

import contextlib
import hashlib
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest
import reader
from accepted import accept_spec
from damages import DAMAGES
from store_checks.examples import deliver, running

from eigenfail.testing.examples import collision, make_errored_result, result, spec
from eigenfail.values.campaign import CampaignState
from eigenfail.values.disturbance import DisturbanceModel, NoiseTrajectory
from eigenfail.values.shapes import Correlated
from eigenfail_services.campaigns.rounds import FORMAT, Checkpoint, write_checkpoint
from eigenfail_services.methods import archive
from eigenfail_services.store.store import open_store

DONE, HALF, DEAD, SHAPED, QUEUED = range(1, 6)
"""Campaigns, by what became of them."""


class Facts(msgspec.Struct, frozen=True):
    """Of a learner that has learnt nothing."""

    rounds: int = 0


def fill(url: str) -> None:
    """Five campaigns: done, half-way, dead, with coloured noise, queued."""
    store = open_store(url)
    done, half, dead = (running(store, seed=seed) for seed in (DONE, HALF, DEAD))
    deliver(store, done, *map(result, range(8)), make_errored_result(8), collision(9))
    deliver(store, done, result(0))
    store.campaigns.move(done.id, CampaignState.DONE)
    deliver(store, half, result(0), result(1))
    store.checkpoints.save(half.id, checkpoint(half.spec.seed, half.spec.episodes))
    deliver(store, dead, result(0), result(1))
    store.campaigns.move(dead.id, CampaignState.DEAD, "It could not continue.")
    ar1 = Correlated()
    shaped = running(store, disturbance=DisturbanceModel(shape=ar1))
    plain = result(0)
    noise = NoiseTrajectory(plain.noise.z, plain.noise.sigma, ar1)
    deliver(store, shaped, msgspec.structs.replace(plain, noise=noise))
    store.campaigns.create(accept_spec(spec()))
    while job := store.jobs.claim("somebody", 60.0):
        if job.subject in {DONE, DEAD}:
            store.jobs.finish(job)
    store.close()


def checkpoint(seed: int, budget: int, **changes: bytes) -> bytes:
    """Of a campaign in the middle."""
    learner = archive.write("toy", Facts(), {"weights": np.ones(3, np.float32)})
    fields = {"number": 1, "episodes": 2, "ended": False, "policy": None, "rounds": ()}
    fields |= {"campaign_seed": seed, "budget": budget, "learner": learner} | changes
    return write_checkpoint(Checkpoint(format=FORMAT, **fields))


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database of which there is nothing to be said."""
    path = tmp_path_factory.mktemp("sound") / "eigenfail.db"
    fill(f"sqlite:///{path}")
    return path


@pytest.fixture
def damage(sound: Path, tmp_path: Path) -> Callable[[str], str]:
    """Copies the sound database and does something to it; the address of what is left."""

    def damage(script: str) -> str:
        path = tmp_path / "damaged.db"
        path.write_bytes(sound.read_bytes())
        with contextlib.closing(sqlite3.connect(path)) as connection:
            connection.executescript(script)
        return f"sqlite:///{path}"

    return damage


def test_nothing_is_said_of_a_sound_database(sound: Path) -> None:
    found = reader.read(f"sqlite:///{sound}")
    assert found.complaints == ()
    assert (found.lost, found.doubled, found.repeated, found.sound) == (0, 0, 1, True)


def test_it_reads_postgresql_as_it_reads_sqlite(sound: Path, postgres_url: str) -> None:
    fill(postgres_url)
    assert reader.read(postgres_url) == reader.read(f"sqlite:///{sound}")
    with reader.snapshot(postgres_url) as connection:
        connection.exec_driver_sql("ROLLBACK")
        connection.exec_driver_sql("DELETE FROM trajectories WHERE campaign = 1")
        connection.exec_driver_sql("UPDATE campaigns SET failures = 2 WHERE id = 1")
        connection.exec_driver_sql("BEGIN")
    found = reader.read(postgres_url)
    assert (found.lost, found.doubled) == (10, 0)
    assert "P1: campaign 1 counts 10 finished, 1 failed, 2 collisions" in found.complaints[0]


def test_digests_are_those_that_the_service_tells(sound: Path) -> None:
    url = f"sqlite:///{sound}"
    store = open_store(url)
    told = {n: store.episodes.digest(n) for n in (DONE, HALF, DEAD, SHAPED, QUEUED)}
    store.close()
    assert reader.read(url).digests == told


@pytest.mark.parametrize(("script", "said"), DAMAGES.values(), ids=DAMAGES)
def test_every_damage_is_told(damage: Callable[[str], str], script: str, said: str) -> None:
    found = reader.read(damage(script))
    assert said in "\n".join(found.complaints)
    assert not found.sound


def test_a_learner_that_was_bent_is_told(sound: Path, damage: Callable[[str], str]) -> None:
    learner = archive.write("toy", Facts(), {"weights": np.ones(3, np.float32)})
    bent = checkpoint(HALF, 10, learner=learner[:-1] + b"\x00")
    kept = hashlib.sha256(bent).hexdigest()
    url = damage(f"UPDATE checkpoints SET sha256 = '{kept}', state = x'{bent.hex()}'")
    (said,) = reader.read(url).complaints
    assert said == "P5: checkpoint 1 of campaign 2 holds a learner whose SHA-256 does not match."


@pytest.mark.parametrize(
    ("damaged", "lost", "doubled"),
    [
        ("a row is gone, with its noise", 1, 0),
        ("the noise is gone", 1, 0),
        ("it ended with episodes open", 8, 0),
        ("a row comes twice", 0, 1),
        ("the noise is changed", 0, 0),
    ],
)
def test_what_is_lost_and_doubled_is_counted(
    damage: Callable[[str], str], damaged: str, lost: int, doubled: int
) -> None:
    found = reader.read(damage(DAMAGES[damaged][0]))
    assert (found.lost, found.doubled) == (lost, doubled)


def test_it_shares_no_code_with_the_writer(sound: Path) -> None:
    look = "import reader, sys; print([m for m in sys.modules if m.startswith('eigenfail')])"
    folder = str(Path(reader.__file__).parent)
    done = subprocess.run(
        [sys.executable, "-c", look], cwd=folder, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_by_hand_it_prints_and_exits_with_1(damage: Callable[[str], str]) -> None:
    url = damage("UPDATE campaigns SET failures = 0 WHERE id = 1")
    done = subprocess.run(
        [sys.executable, reader.__file__, url], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert done.stdout.splitlines()[-1] == "lost 0, doubled 0, repeated 1"
