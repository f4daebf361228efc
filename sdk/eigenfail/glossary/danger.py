"""The words for how near an episode came to a collision, and how bad that was."""

from eigenfail.glossary.term import Term

DANGER = (
    Term(
        key="robustness",
        name="Robustness",
        words="The smallest distance between the footprints of the ego and any other vehicle in "
        "an episode; 0 on a collision. It is what a search makes small.",
        unit="m",
        labels=("Robustness", "Footprints apart"),
    ),
    Term(
        key="ttc",
        name="MinTTC",
        words="The smallest time to collision in an episode: gap ÷ closing speed, while the other "
        "vehicle is in the ego's path. Below 1.5 s it is a near miss.",
        unit="s",
        labels=("MinTTC",),
    ),
    Term(
        key="drac",
        name="DRAC",
        words="The largest deceleration that would have been needed to avoid a crash: closing "
        "speed² ÷ (2 · gap). Above 7 m/s², the truck's peak braking, brakes alone do not help.",
        unit="m/s²",
        labels=("DRAC",),
    ),
    Term(
        key="near-miss",
        name="Near miss",
        words="An episode without a collision whose time to collision fell below 1.5 s.",
        unit="episodes",
        labels=("Near miss", "Near misses"),
    ),
    Term(
        key="unavoidable",
        name="Unavoidable collision",
        words="When the time to collision first fell below 1.5 s, DRAC was above 7 m/s² already, "
        "or nothing announced the contact. It speaks of the brakes from that moment on, and of "
        "nothing before it.",
        unit="episodes",
        labels=("Unavoidable",),
    ),
    Term(
        key="planner-failure",
        name="Planner failure",
        words="Any other collision: it is not shown to be unavoidable.",
        unit="episodes",
        labels=("Planner failures",),
    ),
    Term(
        key="unresolved",
        name="Unresolved at the horizon",
        words="An episode without a collision that ended while DRAC was above 7 m/s²: braking "
        "could not avoid a collision any more, and nobody saw whether there was one.",
        unit="episodes",
        labels=("Unresolved at the horizon", "Unresolved"),
    ),
    Term(
        key="lead-time",
        name="Lead time",
        words="From the first violation of a threshold, MinTTC below 1.5 s or DRAC above 7 m/s², "
        "to the collision. Means are over the collisions that have one.",
        unit="s",
        labels=(
            "Lead time of MinTTC",
            "Lead time of DRAC",
            "TTC lead",
            "DRAC lead",
            "Before the collision",
        ),
    ),
)

SEVERE = (
    Term(
        key="severity",
        name="Severity",
        words="The squared relative speed at the collision, with the vehicle that was struck. A "
        "mean is over failures alone, each counted once however likely it is.",
        unit="m²/s²",
        labels=("Severity", "Mean severity", "Median severity"),
    ),
    Term(
        key="var",
        name="VaR",
        words="Value at risk: the smallest severity that 95 % of the failures found do not exceed.",
        unit="m²/s²",
        labels=("VaR",),
    ),
    Term(
        key="cvar",
        name="CVaR",
        words="Conditional value at risk: the mean severity of the worst 5 % of the failures "
        "found. It rests on those few alone.",
        unit="m²/s²",
        labels=("CVaR",),
    ),
    Term(
        key="severity-against-log-p",
        name="Severity against log p",
        words="Spearman's rank correlation between severity and log p per step of the failures: "
        "below 0, the severe ones are the rarer ones; at 0, the one says nothing of the other.",
        labels=("Severity against log p",),
    ),
    Term(
        key="jerk",
        name="Jerk",
        words="The largest change of the acceleration that was applied, from one step to the next "
        "÷ the time step.",
        unit="m/s³",
        labels=("Largest jerk",),
    ),
    Term(
        key="hard-braking",
        name="Hard braking",
        words="How often an applied deceleration above 3 m/s² began while the truck moved.",
        labels=("Hard brakings",),
    ),
    Term(
        key="clipped",
        name="Controls clipped",
        words="In how many steps the planner asked for more than the truck can do.",
        unit="steps",
        labels=("Controls clipped",),
    ),
)
