"""A database as full as after a busy year: a thousand campaigns, a million episodes, 10^4 modes."""

from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace
from sqlalchemy import Connection, insert, update

from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import Outcome
from eigenfail.values.records import Failures
from eigenfail.values.scene import Scene
from eigenfail.worlds import world_of
from eigenfail_services.analysis.job import analyse
from eigenfail_services.resolution import CampaignReferences
from eigenfail_services.store.codec import pack, to_json
from eigenfail_services.store.engine import Database, find_backend
from eigenfail_services.store.schema import campaigns, episodes, scenes
from eigenfail_services.store.store import Store, open_store

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


ANALYSED, MODES, FAILURES = 250, 40, 80
"""Campaigns that are analysed, modes of each, and failures of an analysis."""

VERSIONS = 10
"""Versions of a planner in each question that campaigns ask."""

STEPS, STEP_S = 30, 0.1


def fill_modes(address: str, count: int = CAMPAIGNS) -> int:
    """Analyse the newest campaigns with failures; return the id of the newest analysis.

    Each question, a gap of the scenario, was asked of some versions of the planner.
    """
    store = open_store(address)
    settings = AnalysisSettings(clusters=MODES, features="noise", bootstrap=0)
    result = analyse(make_noise(), STEPS, settings)
    failing = [number for number in range(1, count + 1) if number % len(FAILS) != 1]
    database = Database(find_backend(address))
    for place, campaign in enumerate(failing[-ANALYSED:]):
        spec = store.campaigns.get(campaign).spec
        (collided, *_) = collisions(spec.method, min(spec.episodes, MADE))
        indices = np.flatnonzero(collided)[:FAILURES].tolist()
        name_version(database, store, campaign, place)
        add_scenes(database, campaign, indices, result.labels)
        analysis = store.analyses.create(campaign, settings).id
        store.analyses.finish(analysis, replace(result, episodes=tuple(indices[:FAILURES])))
    database.close()
    store.close()
    return analysis


def make_noise() -> Failures:
    """Noise of failures in as many groups as there are modes."""
    rng = np.random.default_rng(2)
    centres = rng.normal(0.0, 3.0, (MODES, STEPS, 2))
    noise = centres[np.arange(FAILURES) % MODES] + rng.normal(0.0, 0.5, (FAILURES, STEPS, 2))
    return Failures(tuple(range(FAILURES)), tuple(noise.astype(np.float32)))


def name_version(database: Database, store: Store, campaign: int, place: int) -> None:
    """Write the version of the planner, and the gap that tells the question, into a campaign."""
    version = f"v{1 + place % VERSIONS}"
    gap = {"distance_m": 53.0 + 0.5 * (place // VERSIONS)}
    spec = store.campaigns.get(campaign).spec
    changed = replace(spec, planner_version=version, scenario_parameters=gap)
    values = {"spec": to_json(changed), "planner_version": version}
    with database.writing() as connection:
        connection.execute(update(campaigns).where(campaigns.c.id == campaign).values(values))


def add_scenes(
    database: Database, campaign: int, indices: list[int], labels: tuple[int, ...]
) -> None:
    """Store a scene for each failure, in which the ego brakes as hard as its mode says."""
    times_s = STEP_S * np.arange(STEPS + 1)[:, None]
    rows = []
    for index, label in zip(indices, labels, strict=True):
        speeds = 20.0 - np.array([[0.2 * label, 0.0]]) * times_s
        vehicles = np.zeros((STEPS + 1, 2, 4), np.float32)
        vehicles[:, :, 0] = np.array([0.0, 12.0]) + np.cumsum(STEP_S * speeds, axis=0)
        vehicles[:, :, 3] = speeds
        sizes = np.array([[16.0, 2.5], [5.0, 2.0]], np.float32)
        nothing = np.zeros((STEPS, 2), np.float32)
        scene = Scene(STEP_S, vehicles, sizes, nothing, nothing)
        rows.append({"campaign": campaign, "index": index, "scene": pack(scene)})
    with database.writing() as connection:
        connection.execute(insert(scenes), rows)


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
        "form": to_json(world_of(spec.simulator).find_form(spec)),
        "references": to_json(CampaignReferences()),
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
