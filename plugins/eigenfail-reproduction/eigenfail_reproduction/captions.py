"""Captions of the paper's tables: what a reader must know to compare our numbers with them."""

from collections.abc import Mapping
from types import MappingProxyType

import msgspec

from eigenfail.values.analysis import STABLE, AnalysisSettings
from eigenfail_reproduction.paper import SAFETY_COUNTS, SAFETY_EPISODES

DRAWN = (
    "Failure rate: share of the n episodes that collide. Brackets hold Wilson's 95 % interval of "
    "independent draws; where none or all failed, an exact one-sided 95 % bound. Ends and bounds "
    "are rounded outwards."
)
ONE_SEARCHER = "That of an evaluation is about its one trained searcher."
SEARCHED = (
    "Failure rate: share of the n episodes that collide; in a search they depend on those before "
    "them, so that it has no interval and is no rate under p(x)."
)
MEANS = (
    "Log p (natural logarithm of the density of the errors in metres, summed over the steps) and "
    "severity (squared relative speed at the collision) are means over the failures; log p per "
    "step is the sum over all failures ÷ their steps. The paper does not give its number of steps, "
    "which its log p depends on."
)
COST = (
    "Instance-hours are the time that this campaign was active on one instance, in one run; cost "
    "is their price at 1.20 USD per hour ÷ failures, without that of a training before it. "
    "Campaigns of the suite run side by side, four at a time unless the service is told otherwise, "
    "and share its workers and processor cores; that time is counted in full for each of them, so "
    "that hours and cost are not those of the campaign alone. The paper's cost is of a GPU "
    "instance at that price."
)
PAPERS = "of its own planner, simulator and settings, also beside our defaults."
OF_PLANNERS = (
    f"One Monte Carlo campaign of each planner. {DRAWN} Severity is the mean over the failures "
    "(squared relative speed). The paper's numbers are of its own planner and of its IDM; it gives "
    "neither their number of episodes nor the episodes over which severity is averaged."
)
OF_SWEEP = (
    "Each row changes one setting of the base: `ast` with alpha 10,000, c_dist 1,000, tau 0.005, "
    "learning_rate 3e-4, batch_size 64, buffer_size 100,000 and four gradient steps for each "
    "decision."
)
SMALLER_BUFFERS = (
    f"{OF_SWEEP} Buffers are named by the paper's numbers of decisions. They hold a fiftieth of "
    "them, as an action here lasts for 50 steps: as many episodes as the paper's buffers do if "
    "each of its steps has an action."
)
WHOLE_BUFFERS = (
    f"{OF_SWEEP} Its other settings are our defaults. The paper's buffer_size of 1,000,000 would "
    "give the base again: 300 episodes have fewer than 100,000 decisions."
)
OF_PAPERS_SWEEP = (
    "The paper's numbers are of 300 episodes each, of the same values with its own planner and "
    "simulator."
)
OF_TRAINING = (
    f"One training campaign for each row. {SEARCHED} {MEANS} {COST} The paper's numbers are of "
    f"1,000 episodes each, {PAPERS}"
)
OF_EVALUATION = (
    "Draws from p(x) (`monte_carlo`), from p(x) with each draw held for a second (`held`), and "
    f"from what each training left, which learns nothing more. {DRAWN} {ONE_SEARCHER} {MEANS} "
    f"{COST} The paper's numbers are of 2,000 episodes "
    f"of Monte Carlo and 300 each of the others, {PAPERS}"
)
OF_MOVES = (
    f"{DRAWN} {ONE_SEARCHER} Severity (squared relative speed at the "
    "collision) is the mean over the failures. The paper's numbers are of 300 episodes at its "
    f"usual distance and 100 at each other, {PAPERS}"
)
OF_SAFETY = (
    "Share of the n episodes of an evaluation with a collision, a MinTTC (smallest value of gap ÷ "
    "closing speed) below 1.5 s, a DRAC (largest value of closing speed² ÷ (2 · gap)) above "
    "7 m/s². "
    "Brackets hold Wilson's 95 % interval of independent draws from that one trained "
    "searcher; where none or all are counted, an exact one-sided 95 % bound. Ends and bounds are "
    "rounded outwards. Median and worst (smallest MinTTC, largest DRAC) are over the episodes in "
    "which the truck ever closed in; in one that collides, up to the last step before the "
    f"contact. The paper's shares are its counts ({SAFETY_COUNTS}) of {SAFETY_EPISODES} episodes "
    "of DiFS; it does not say over which of them its medians are, and has none of AST."
)
OF_COMPONENTS = (
    "Analyses of the n failures of an evaluation by the noise (in sigma) of one axis, aligned at "
    "the collision, with default settings otherwise. Variance: the share that the first three "
    "principal components explain. Modes are groups of K-means, as many as have the "
    "largest silhouette (Rousseeuw 1987); they are distinct only where it exceeds the largest of "
    "19 draws of data without groups, and where the median adjusted Rand index (Hubert and Arabie "
    f"1985) is {STABLE} or more; where they are not, one mode is counted. That index "
    "is between the modes and those of failures drawn again with replacement, the median over "
    f"{AnalysisSettings().bootstrap} such draws, in brackets the range of their middle 95 %, "
    "rounded outwards. The paper's numbers are of 300 failures of its AST; it does not say of "
    "which axis its three modes are, nor clearly that its 40 % are of the longitudinal noise, nor "
    "how its failures are aligned: the statements below are judged by other choices, too."
)
OF_REPLAYS = (
    "one eigenfailure and one medoid of each group of the failures of an "
    "evaluation by the noise of both axes, aligned at the start, also where the groups are no "
    "distinct modes. The eigenfailure is the noise that belongs to the mean of the group's scores "
    f"on the first {AnalysisSettings().components} principal components, without the others; the "
    "medoid is the noise of the failure whose scores are nearest to that mean. A replay always has "
    "the same result: these are counts, no rates. The paper says *all*, and gives no number."
)
OF_ALL_VEHICLES = (
    "The noise of an axis is here that of all five vehicles; failures are aligned at the collision "
    "in all statements but that on replays."
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
                "What was trained with the cut-in at distance_m 58, evaluated there and where it "
                "begins 5 m further (`plus5`) and nearer (`minus5`)."
            ),
            moves_title="AST where the cut-in moves",
            replays=(
                "Replays that collided, of all, in the named scenario (*the same* has distance_m "
                "58):"
            ),
            components=OF_COMPONENTS,
        ),
        "highway_drive": ScenarioCaptions(
            sweep=WHOLE_BUFFERS,
            moves=(
                "What was trained with follower_gap_m 9, slow_gap_m 78.5 and cut_in_distance_m 57, "
                "evaluated there, with larger gaps (`farther`: 10, 80, 60) and with smaller ones "
                "(`nearer`: 8, 77, 54). The bounds of the parameters leave no room for 5 m."
            ),
            moves_title="AST where the gaps are others",
            replays=(
                "Replays that collided, of all, in the named scenario (*the same* has slow_gap_m "
                "78.5):"
            ),
            components=f"{OF_COMPONENTS} {OF_ALL_VEHICLES}",
        ),
    }
)
