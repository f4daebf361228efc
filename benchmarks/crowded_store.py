"""A database as full as after a busy year: a thousand campaigns, a million episodes."""

from collections.abc import Iterator

import numpy as np
from sqlalchemy import Connection, insert

from eigenfail.values import CampaignSpec, CampaignState, Outcome
from eigenfail_services.store import open_store
from eigenfail_services.store.codec import to_json
from eigenfail_services.store.engine import Database, find_backend
from eigenfail_services.store.schema import campaigns, episodes

CAMPAIGNS = 1_000
EPISODES = 1_000_000
LARGEST_SHARE = 8
"""One episode in so many is in the largest campaign."""

FAILS = {"monte_carlo": 0.0, "ast": 0.35, "difs": 0.2, "cem": 0.1, "subset": 0.15}
"""Share of failures, by method."""

MADE = 10_000
"""Episodes that are made one by one for each method; those of campaigns are copies of them."""

BEGUN_MS, APART_MS, EPISODE_MS = 1_760_000_000_000, 60_000, 40
COLUMNS = ", ".join(f'"{column.name}"' for column in episodes.columns[2:])
COPY = f"""
INSERT INTO episodes (campaign, "index", {COLUMNS})
SELECT ?, "index" + ?, {COLUMNS.replace('"finished_ms"', '"finished_ms" + ?')}
FROM made WHERE campaign = ? AND "index" < ? ORDER BY "index"
"""


def fill(address: str, count: int = CAMPAIGNS, total: int = EPISODES) -> int:
    """Fill an empty SQLite database; the id of its largest campaign, the newest but one.

    Trajectories and scenes are left out: no page that is measured reads them.
    """
    open_store(address).close()
    database = Database(find_backend(address))
    sizes = sizes_of(count, total)
    with database.writing() as connection:
        make(connection)
        rows = [campaign_row(number, *size) for number, size in enumerate(sizes, 1)]
        connection.execute(insert(campaigns), rows)
        for number, (method, size) in enumerate(sizes, 1):
            copy(connection, number, [*FAILS].index(method), size)
    database.close()
    return count - 1


def sizes_of(count: int, total: int) -> list[tuple[str, int]]:
    """Method and episodes of each campaign."""
    methods = [*FAILS]
    each = (total - total // LARGEST_SHARE) // (count - 1)
    sizes = [(methods[number % len(methods)], each) for number in range(count)]
    sizes[-2] = ("ast", total - each * (count - 1))
    return sizes


def campaign_row(number: int, method: str, size: int) -> dict[str, object]:
    """A campaign that is done."""
    spec = CampaignSpec(name=f"{method} {number}", method=method, episodes=size)
    begun_ms = BEGUN_MS + number * APART_MS
    return {
        "id": number,
        "state": CampaignState.DONE,
        "spec": to_json(spec),
        "planned": size,
        "completed": size,
        "failures": sum(int(part.sum()) for part in collisions(method, size)),
        "failed": 0,
        "cancelled": 0,
        "duplicates": 0,
        "created_ms": begun_ms,
        "started_ms": begun_ms,
        "ended_ms": begun_ms + size * EPISODE_MS,
        "active_s": size * EPISODE_MS / 1_000.0,
        "stopped_because": "All episodes have ended.",
        "digest": "0" * 64,
        "learning_s": size / 400.0,
        "waiting_s": size / 800.0,
        "discarded_s": 0.0,
    }


def collisions(method: str, size: int) -> Iterator[np.ndarray]:
    """Which episodes collide, by copies of those that were made."""
    made = np.random.default_rng(1).random(MADE) < FAILS[method]
    for first in range(0, size, MADE):
        yield made[: size - first]


def make(connection: Connection) -> None:
    """The episodes to copy, in a table of their own; its campaigns are numbers of methods."""
    connection.exec_driver_sql("CREATE TEMP TABLE made AS SELECT * FROM episodes WHERE 0")
    names = [column.name for column in episodes.columns]
    marks = ", ".join("?" * len(names))
    statement = f'INSERT INTO made (campaign, "index", {COLUMNS}) VALUES ({marks})'
    for number, method in enumerate(FAILS):
        rows = [tuple(row[name] for name in names) for row in episode_rows(number, method)]
        connection.exec_driver_sql(statement, rows)


def episode_rows(number: int, method: str) -> Iterator[dict[str, object]]:
    """What a method's episodes look like, measures included."""
    rng = np.random.default_rng(number)
    (collided,) = collisions(method, MADE)
    nothing = dict.fromkeys(column.name for column in episodes.columns)
    for index in range(MADE):
        yield nothing | {
            "campaign": number,
            "index": index,
            "seed": index,
            "steps": int(rng.integers(60, 100)),
            "source": "prior",
            "worker": f"worker-{rng.integers(8)}",
            "log_probability": float(rng.normal(-150.0, 12.0)),
            "max_jerk_mps3": 4.0,
            "hard_brakings": 0,
            "clipped_steps": 0,
            "wall_s": float(rng.gamma(8.0, 0.005)),
            "finished_ms": index * EPISODE_MS,
            "digest": rng.bytes(32).hex(),
            "has_scene": bool(collided[index]),
            **(crash(rng) if collided[index] else drive(rng)),
        }


def crash(rng: np.random.Generator) -> dict[str, object]:
    """What is measured over an episode with a collision."""
    collided_s = float(rng.uniform(4.0, 9.0))
    return {
        "outcome": Outcome.COLLISION,
        "robustness_m": 0.0,
        "severity": float(rng.gamma(9.0, 12.0)),
        "min_ttc_s": float(rng.uniform(0.1, 0.8)),
        "max_drac_mps2": float(rng.uniform(5.0, 9.0)),
        "ttc_violated_s": collided_s - 1.5,
        "drac_violated_s": collided_s - 0.3,
        "drac_at_warning_mps2": float(rng.uniform(3.0, 9.0)),
        "collided_s": collided_s,
    }


def drive(rng: np.random.Generator) -> dict[str, object]:
    """What is measured over an episode without one."""
    return {
        "outcome": Outcome.SAFE,
        "robustness_m": float(rng.gamma(4.0, 1.6)),
        "min_ttc_s": float(rng.uniform(1.0, 6.0)),
        "max_drac_mps2": float(rng.uniform(0.3, 2.0)),
    }


def copy(connection: Connection, campaign: int, method: int, size: int) -> None:
    """The episodes of a campaign."""
    begun_ms = BEGUN_MS + campaign * APART_MS
    for first in range(0, size, MADE):
        at_ms = begun_ms + first * EPISODE_MS
        connection.exec_driver_sql(COPY, (campaign, first, at_ms, method, size - first))
