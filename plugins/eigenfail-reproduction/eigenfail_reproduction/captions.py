"""Captions of the paper's tables: what a reader must know to compare our numbers with them."""

from collections.abc import Mapping
from types import MappingProxyType

import msgspec

from eigenfail.values.analysis import STABLE, AnalysisSettings
from eigenfail_reproduction.paper import SAFETY_COUNTS, SAFETY_EPISODES

DRAWN = (
    "The failure rate is the share of the n episodes that collide. Square brackets are Wilson's "
    "95 % interval of independent draws. If none or all failed, the bound is exact and one-sided "
    "(95 %). Ends and bounds are rounded outwards."
)
ONE_SEARCHER = "The interval of an evaluation is about its one trained searcher."
SEARCHED = (
    "The failure rate is the share of the n episodes that collide. Episodes of a search depend on "
    "earlier ones, so the rate has no interval and is not a rate under p(x)."
)
MEANS = (
    "Log p is the natural logarithm of the density of the errors [m], summed over the steps of an "
    "episode. Severity is the squared relative speed at the collision. Both are means over the "
    "failures. Log p per step is the sum over all failures, divided by their steps. The paper does "
    "not give its number of steps."
)
COST = (
    "Instance-hours are the time for which the campaign was active, in one run. Cost is their "
    "price at 1.20 USD per hour, divided by the failures; an earlier training is not included. "
    "Four campaigns run side by side by default and share the processor cores, and their time "
    "counts in full for each of them. The paper's cost is for a GPU instance at the same price."
)
PAPERS = "with the paper's planner, simulator and settings, also beside our defaults."
OF_PLANNERS = (
    f"One Monte Carlo campaign with each planner. {DRAWN} Severity is the squared relative speed "
    "at the collision, the mean over the failures. The paper's numbers are for its own planner and "
    "its IDM. The paper does not say how many episodes it ran, nor over which episodes its "
    "severity is a mean."
)
OF_SWEEP = (
    "Each row changes one setting of the base: `ast` with alpha 10,000, c_dist 1,000, tau 0.005, "
    "learning_rate 3e-4, batch_size 64, buffer_size 100,000 and four gradient steps for each "
    "decision."
)
SMALLER_BUFFERS = (
    f"{OF_SWEEP} Rows name the paper's buffer sizes. Buffers here hold a fiftieth of these "
    "decisions, because an action lasts 50 steps: as many episodes as the paper's buffers hold "
    "with an action in each step. The paper's buffer_size of 1,000,000 was not run."
)
WHOLE_BUFFERS = (
    f"{OF_SWEEP} Its other settings are those of `ast`. The paper's buffer_size of 1,000,000 would "
    "give the base again: 300 episodes have fewer than 100,000 decisions."
)
OF_PAPERS_SWEEP = (
    "The paper's numbers are for the same values with its own planner and simulator, 300 episodes "
    "each."
)
OF_TRAINING = (
    f"One training campaign for each row. {SEARCHED} {MEANS} {COST} The paper's numbers are for "
    f"1,000 episodes each, {PAPERS}"
)
OF_EVALUATION = (
    "Draws from p(x) (`monte_carlo`), from p(x) with each draw held for a second (`held`), and "
    f"from the searcher that each training left, which learns nothing more. {DRAWN} "
    f"{ONE_SEARCHER} {MEANS} {COST} The paper's numbers are for 2,000 episodes of Monte Carlo and "
    f"300 of each other row, {PAPERS}"
)
OF_MOVES = (
    f"{DRAWN} {ONE_SEARCHER} Severity is the squared relative speed at the collision, the mean "
    "over the failures. The paper's numbers are for 300 episodes at its usual distance and 100 at "
    f"each other distance, {PAPERS}"
)
OF_SAFETY = (
    "The share of the n episodes of an evaluation with a collision, with a MinTTC below 1.5 s, and "
    "with a DRAC above 7 m/s². MinTTC is the smallest value of gap ÷ closing speed; DRAC is the "
    "largest value of closing speed² ÷ (2 · gap). Square brackets are Wilson's 95 % interval of "
    "independent draws from one trained searcher. If none or all are counted, the bound is exact "
    "and one-sided (95 %). Ends and bounds are rounded outwards. Median and worst are over the "
    "episodes in which the truck ever closed in. An episode with a collision counts up to the last "
    f"step before the contact. The paper's shares are counts ({SAFETY_COUNTS}) of "
    f"{SAFETY_EPISODES} episodes of DiFS. The paper has no such counts for AST, and does not say "
    "over which episodes its medians are."
)
OF_COMPONENTS = (
    "Analyses of the n failures of an evaluation by the noise of one axis (in sigma), aligned at "
    "the collision; other settings are defaults. Variance is the share that the first three "
    "principal components explain. Modes are groups of K-means; their number has the largest "
    "silhouette (Rousseeuw 1987). Modes are distinct if the silhouette exceeds the largest of 19 "
    "draws of data without groups, and if the median adjusted Rand index (Hubert and Arabie 1985) "
    f"is {STABLE} or more; otherwise one mode is counted. The index compares the modes with modes "
    f"of failures drawn again with replacement ({AnalysisSettings().bootstrap} draws; square "
    "brackets are the range of the middle 95 %, rounded outwards). The paper's numbers are for 300 "
    "failures of its AST. It does not say which axis has three modes, nor how its failures are "
    "aligned, nor clearly that its 40 % are longitudinal. The statements below are therefore "
    "judged by other choices, too."
)
OF_REPLAYS = (
    "one eigenfailure and one medoid for each group of the failures of an evaluation. Groups are "
    "by the noise of both axes, aligned at the start, and need not be distinct modes. The "
    "eigenfailure is the noise at the mean of the group's scores on the first "
    f"{AnalysisSettings().components} principal components. The medoid is the noise of the failure "
    "whose scores are nearest to this mean. A replay always has the same result, so these are "
    "counts. The paper says *all*, without a number."
)
OF_ALL_VEHICLES = (
    "An axis here has the noise of all five vehicles. Failures are aligned at the collision in "
    "every statement but the one on replays."
)


class ScenarioCaptions(msgspec.Struct, frozen=True):
    """The words of captions on one scenario: its sweep, the moves of its parameters, replays."""

    sweep: str
    moves: str
    moves_title: str
    replays: str
    components: str


CAPTIONS: Mapping[str, ScenarioCaptions] = MappingProxyType(
    {
        "cut_in": ScenarioCaptions(
            sweep=SMALLER_BUFFERS,
            moves=(
                "AST was trained with a cut-in at distance_m 58, and is evaluated there, 5 m "
                "further away (`plus5`) and 5 m nearer (`minus5`)."
            ),
            moves_title="AST where the cut-in moves",
            replays=(
                "Replays that collided, of all replays in the named scenario (*the same* has "
                "distance_m 58):"
            ),
            components=OF_COMPONENTS,
        ),
        "highway_drive": ScenarioCaptions(
            sweep=WHOLE_BUFFERS,
            moves=(
                "AST was trained with follower_gap_m 9, slow_gap_m 78.5 and cut_in_distance_m 57, "
                "and is evaluated there, with larger gaps (`farther`: 10, 80, 60) and with smaller "
                "gaps (`nearer`: 8, 77, 54). The bounds of the parameters leave no room for 5 m."
            ),
            moves_title="AST where the gaps are others",
            replays=(
                "Replays that collided, of all replays in the named scenario (*the same* has "
                "slow_gap_m 78.5):"
            ),
            components=f"{OF_COMPONENTS} {OF_ALL_VEHICLES}",
        ),
    }
)
