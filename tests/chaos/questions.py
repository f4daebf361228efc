"""What the rows of a database must never show: questions in SQL whose answer is empty."""

from typing import NamedTuple

ENDED = frozenset({"cancelled", "done", "dead"})
ENDED_SQL = "('cancelled', 'done', 'dead')"
STATES_SQL = "('queued', 'running', 'pausing', 'paused', 'cancelling', 'cancelled', 'done', 'dead')"
KINDS_SQL = "('infrastructure', 'simulator', 'planner', 'solver', 'input')"
KEPT_CHECKPOINTS = 2
MOST_EVENTS = 200_000
LONGEST_PROSE = 4_000
MOST_DEATHS = 3
MOST_CLAIMS = 6
"""Of one job: the sixth one buries it."""

FACTS = (
    'SELECT campaign, count(*) AS n, count(DISTINCT "index") AS episodes, '
    "sum(CASE WHEN outcome = 'failed' THEN 1 ELSE 0 END) AS failed, "
    "sum(CASE WHEN outcome = 'collision' THEN 1 ELSE 0 END) AS collisions "
    "FROM episodes GROUP BY campaign"
)


class Question(NamedTuple):
    """A promise, what is said of a row that breaks it, and the SELECT that finds such rows."""

    promise: str
    sentence: str
    sql: str


QUESTIONS = (
    Question(
        "P1",
        "campaign {id} counts {told} finished, {failed} failed, {failures} collisions; "
        "its rows are {n}, {row_failed}, {row_collisions}.",
        "SELECT c.id, c.completed + c.failed AS told, c.failed, c.failures, "
        "coalesce(f.n, 0) AS n, coalesce(f.failed, 0) AS row_failed, "
        "coalesce(f.collisions, 0) AS row_collisions "
        f"FROM campaigns c LEFT JOIN ({FACTS}) f ON f.campaign = c.id "
        "WHERE c.completed + c.failed <> coalesce(f.n, 0) OR c.failed <> coalesce(f.failed, 0) "
        "OR c.failures <> coalesce(f.collisions, 0)",
    ),
    Question(
        "P1",
        "campaign {id} has {planned} planned, {completed} completed, {failed} failed and "
        "{cancelled} cancelled, of which no account can be made.",
        "SELECT id, planned, completed, failed, cancelled FROM campaigns "
        "WHERE completed + failed + cancelled > planned OR completed < 0 OR failed < 0 "
        "OR cancelled < 0 OR failures < 0 OR failures > completed OR duplicates < 0",
    ),
    Question(
        "P1",
        "campaign {id} is {state} with {left} episodes open.",
        "SELECT id, state, planned - completed - failed - cancelled AS left FROM campaigns "
        f"WHERE state IN {ENDED_SQL} AND completed + failed + cancelled <> planned",
    ),
    Question(
        "P1",
        "campaign {id} is {state} and counts {cancelled} cancelled.",
        "SELECT id, state, cancelled FROM campaigns "
        f"WHERE state NOT IN {ENDED_SQL} AND cancelled <> 0",
    ),
    Question(
        "P1",
        "campaign {id} is '{state}', and no campaign can be.",
        f"SELECT id, state FROM campaigns WHERE state NOT IN {STATES_SQL}",
    ),
    Question(
        "P1",
        "episode {campaign}/{number} has {n} rows.",
        'SELECT campaign, "index" AS number, count(*) AS n FROM episodes '
        'GROUP BY campaign, "index" HAVING count(*) > 1',
    ),
    Question(
        "P1",
        "episode {campaign}/{number} is none of those that were planned.",
        'SELECT e.campaign, e."index" AS number FROM episodes e '
        "LEFT JOIN campaigns c ON c.id = e.campaign "
        'WHERE c.id IS NULL OR e."index" < 0 OR e."index" >= c.planned',
    ),
    Question(
        "P2",
        "episode {campaign}/{number} has no noise.",
        'SELECT e.campaign, e."index" AS number FROM episodes e LEFT JOIN trajectories t '
        'ON t.campaign = e.campaign AND t."index" = e."index" WHERE t.campaign IS NULL',
    ),
    Question(
        "P2",
        "noise {campaign}/{number} has no episode.",
        'SELECT t.campaign, t."index" AS number FROM trajectories t LEFT JOIN episodes e '
        'ON t.campaign = e.campaign AND t."index" = e."index" WHERE e.campaign IS NULL',
    ),
    Question(
        "P2",
        "episode {campaign}/{number} lost its scene, or has one that it knows nothing of.",
        'SELECT e.campaign, e."index" AS number FROM episodes e LEFT JOIN scenes s '
        'ON s.campaign = e.campaign AND s."index" = e."index" '
        "WHERE (s.campaign IS NOT NULL) <> (CASE WHEN e.has_scene THEN 1 ELSE 0 END = 1)",
    ),
    Question(
        "P2",
        "campaign {id} is {state}, but not since when or why.",
        "SELECT id, state FROM campaigns WHERE "
        f"state IN {ENDED_SQL} AND (ended_ms IS NULL OR stopped_because = '')",
    ),
    Question(
        "P4",
        "alarm: {message}",
        "SELECT message FROM events WHERE kind = 'episode.alarm' ORDER BY id",
    ),
    Question(
        "P6",
        "campaign {id} is {state}, and there is no job to go on with it.",
        "SELECT c.id, c.state FROM campaigns c LEFT JOIN jobs j "
        "ON j.kind = 'campaign' AND j.subject = c.id AND j.buried_because IS NULL "
        "WHERE c.state IN ('queued', 'running', 'pausing', 'cancelling') AND j.id IS NULL",
    ),
    Question(
        "P6",
        "campaign {id} is {state}, and its job is left over.",
        "SELECT c.id, c.state FROM campaigns c JOIN jobs j "
        "ON j.kind = 'campaign' AND j.subject = c.id AND j.buried_because IS NULL "
        f"WHERE c.state = 'paused' OR c.state IN {ENDED_SQL}",
    ),
    Question(
        "P6",
        "job {id} of campaign {subject} is buried, and the campaign is not dead.",
        "SELECT j.id, j.subject FROM jobs j LEFT JOIN campaigns c ON c.id = j.subject "
        "WHERE j.kind = 'campaign' AND j.buried_because IS NOT NULL "
        "AND coalesce(c.state, '') <> 'dead'",
    ),
    Question(
        "P7",
        "episode {campaign}/{number} is {outcome}, with the cause '{kind}'.",
        "SELECT campaign, \"index\" AS number, outcome, coalesce(fault_kind, '') AS kind "
        "FROM episodes WHERE outcome NOT IN ('collision', 'safe', 'failed') "
        f"OR (outcome = 'failed') <> (coalesce(fault_kind, '') IN {KINDS_SQL})",
    ),
    Question(
        "P7",
        "episode {campaign}/{number} has taken {workers} workers with it.",
        f'SELECT campaign, "index" AS number, workers FROM deaths WHERE workers > {MOST_DEATHS}',
    ),
    Question(
        "P8",
        "campaign {campaign} keeps {n} checkpoints.",
        "SELECT campaign, count(*) AS n FROM checkpoints "
        f"GROUP BY campaign HAVING count(*) > {KEPT_CHECKPOINTS}",
    ),
    Question(
        "P8",
        "there are {n} events.",
        f"SELECT count(*) AS n FROM events HAVING count(*) > {MOST_EVENTS}",
    ),
    Question(
        "P8",
        "job {id} was claimed {attempts} times in vain.",
        f"SELECT id, attempts FROM jobs WHERE attempts > {MOST_CLAIMS}",
    ),
    Question(
        "P8",
        "the cause of episode {campaign}/{number} has {n} characters.",
        'SELECT campaign, "index" AS number, length(fault_message) AS n FROM episodes '
        f"WHERE length(fault_message) > {LONGEST_PROSE}",
    ),
)
