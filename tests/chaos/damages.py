"""Each kind of damage that the reader must tell, on the database that `test_reader` fills."""

from typing import NamedTuple

WITHOUT_KEYS = """
CREATE TABLE copy AS SELECT * FROM episodes;
DROP TABLE episodes;
ALTER TABLE copy RENAME TO episodes;
"""


class Damage(NamedTuple):
    """What is done to a sound database, and what the reader is to say of it."""

    script: str
    said: str


DAMAGES: dict[str, Damage] = {
    "a row is gone, with its noise": Damage(
        'DELETE FROM trajectories WHERE campaign = 1 AND "index" = 3;'
        'DELETE FROM episodes WHERE campaign = 1 AND "index" = 3',
        "P1: campaign 1 counts 10 finished",
    ),
    "the noise is gone": Damage(
        'DELETE FROM trajectories WHERE campaign = 1 AND "index" = 3',
        "P2: episode 1/3 has no noise",
    ),
    "noise without an episode": Damage(
        'DELETE FROM episodes WHERE campaign = 2 AND "index" = 1',
        "P2: noise 2/1 has no episode",
    ),
    "the scene is gone": Damage("DELETE FROM scenes", "P2: episode 1/9 lost its scene"),
    "the scene is a pickle": Damage(
        "UPDATE scenes SET scene = x'80049503000000000000004e2e'",
        "P9: episode 1/9 has a scene that is no plain data",
    ),
    "a row comes twice": Damage(
        f"{WITHOUT_KEYS}INSERT INTO episodes SELECT * FROM episodes WHERE campaign = 1 LIMIT 1",
        "P1: episode 1/0 has 2 rows",
    ),
    "one is counted too many": Damage(
        "UPDATE campaigns SET completed = completed + 1 WHERE id = 2",
        "P1: campaign 2 counts 3 finished",
    ),
    "collisions are miscounted": Damage(
        "UPDATE campaigns SET failures = 0 WHERE id = 1",
        "P1: campaign 1 counts 10 finished, 1 failed, 0 collisions; its rows are 10, 1, 1.",
    ),
    "more than planned": Damage(
        "PRAGMA ignore_check_constraints = ON; UPDATE campaigns SET cancelled = 99 WHERE id = 3",
        "P1: campaign 3 has 10 planned",
    ),
    "it ended with episodes open": Damage(
        "UPDATE campaigns SET cancelled = 0 WHERE id = 3",
        "P1: campaign 3 is dead with 8 episodes open.",
    ),
    "it goes on with episodes cancelled": Damage(
        "UPDATE campaigns SET cancelled = 2 WHERE id = 2",
        "P1: campaign 2 is running and counts 2 cancelled.",
    ),
    "an unheard state": Damage(
        "UPDATE campaigns SET state = 'lost' WHERE id = 2",
        "P1: campaign 2 is 'lost'",
    ),
    "an episode beyond the plan": Damage(
        'PRAGMA foreign_keys = OFF; UPDATE episodes SET "index" = 10 '
        'WHERE campaign = 1 AND "index" = 9',
        "P1: episode 1/10 is none of those that were planned.",
    ),
    "another plan than was asked for": Damage(
        "UPDATE campaigns SET planned = 11 WHERE id = 2",
        "P1: campaign 2 asks for 10 and plans 11.",
    ),
    "an end without a time": Damage(
        "UPDATE campaigns SET ended_ms = NULL WHERE id = 3",
        "P2: campaign 3 is dead, but not since when or why.",
    ),
    "an alarm": Damage(
        "INSERT INTO events (id, at_ms, kind, state, message, campaign) "
        "VALUES (99, 0, 'episode.alarm', '', 'Episode 1/0 differs.', 1)",
        "P4: alarm: Episode 1/0 differs.",
    ),
    "a measure is changed": Damage(
        'UPDATE episodes SET robustness_m = 0.25 WHERE campaign = 1 AND "index" = 3',
        "P4: episode 1/3 is not what was delivered",
    ),
    "the noise is changed": Damage(
        "UPDATE trajectories SET z = sigma WHERE campaign = 4",
        "P4: episode 4/0 is not what was delivered",
    ),
    "the noise is cut short": Damage(
        "UPDATE trajectories SET z = substr(z, 1, 7) WHERE campaign = 4",
        "P4: episode 4/0 has noise that is cut short.",
    ),
    "a number that is none": Damage(
        "UPDATE episodes SET log_probability = 9e999 WHERE campaign = 2",
        "P4: episode 2/0 has a number that is none.",
    ),
    "another digest of an episode": Damage(
        "UPDATE episodes SET digest = 'abc' WHERE campaign = 1",
        "P4: campaign 1 has another digest than its rows.",
    ),
    "a campaign is done, without a digest": Damage(
        "UPDATE campaigns SET digest = NULL",
        "P4: campaign 1 is done, and its digest is None.",
    ),
    "a checkpoint is cut short": Damage(
        "UPDATE checkpoints SET state = substr(state, 1, 40)",
        "P5: checkpoint 1 of campaign 2 cannot be read.",
    ),
    "a checkpoint of another campaign": Damage(
        "UPDATE checkpoints SET campaign = 4",
        "P5: checkpoint 1 of campaign 4 is of another one.",
    ),
    "a checkpoint is bent": Damage(
        "UPDATE checkpoints SET sha256 = 'abc'",
        "P5: checkpoint 1 of campaign 2 is not what was saved.",
    ),
    "checkpoints without an end": Damage(
        "INSERT INTO checkpoints (campaign, number, saved_ms, state, sha256) "
        "SELECT campaign, number + k, saved_ms, state, sha256 "
        "FROM checkpoints, (SELECT 1 AS k UNION SELECT 2)",
        "P8: campaign 2 keeps 3 checkpoints.",
    ),
    "nobody goes on": Damage("DELETE FROM jobs", "P6: campaign 2 is running, and there is no job"),
    "a job is left over": Damage(
        "UPDATE jobs SET subject = 1 WHERE subject = 5",
        "P6: campaign 1 is done, and its job is left over.",
    ),
    "a job is buried, its campaign lives": Damage(
        "UPDATE jobs SET buried_because = 'Lost.' WHERE subject = 2",
        "P6: job 2 of campaign 2 is buried, and the campaign is not dead.",
    ),
    "a cause is missing": Damage(
        "UPDATE episodes SET fault_kind = NULL WHERE outcome = 'failed'",
        "P7: episode 1/8 is failed, with the cause ''.",
    ),
    "a cause where nothing failed": Damage(
        "UPDATE episodes SET fault_kind = 'planner' WHERE campaign = 2",
        "P7: episode 2/0 is safe, with the cause 'planner'.",
    ),
    "deaths without an end": Damage(
        "INSERT INTO deaths VALUES (2, 5, 4)",
        "P7: episode 2/5 has taken 4 workers with it.",
    ),
    "claims without an end": Damage(
        "UPDATE jobs SET attempts = 7 WHERE subject = 2",
        "P8: job 2 was claimed 7 times in vain.",
    ),
    "a cause without an end": Damage(
        "UPDATE episodes SET fault_message = hex(zeroblob(2001)) WHERE outcome = 'failed'",
        "P8: the cause of episode 1/8 has 4002 characters.",
    ),
    "events without an end": Damage(
        "WITH RECURSIVE n(i) AS (SELECT 1000 UNION ALL SELECT i + 1 FROM n WHERE i < 202000) "
        "INSERT INTO events (id, at_ms, kind, state, message) SELECT i, 0, 'x', '', '' FROM n",
        "P8: there are 201",
    ),
}
