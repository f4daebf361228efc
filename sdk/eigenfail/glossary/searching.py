"""The words for how much was found, how likely that is, and at what price."""

from eigenfail.glossary.term import Term

FOUND = (
    Term(
        key="episode",
        name="Episode",
        words="One simulation run. It is completed once it ended safely or in a collision; one "
        "that could not be run says nothing about the planner, and no rate counts it.",
        labels=("Episodes",),
    ),
    Term(
        key="failure",
        name="Failure",
        words="An episode that ends in a collision of the ego.",
        unit="episodes",
        labels=("Failures", "Failures analysed", "Collision"),
    ),
    Term(
        key="failure-rate",
        name="Failure rate",
        words="Failures ÷ completed episodes of this search. A method that searches makes failures "
        "happen: only the rate of Monte Carlo tells how often noise of p(x) does.",
        unit="%",
        labels=(
            "Failure rate",
            "Failure rate inside",
            "Failure rate everywhere",
            "Rate",
            "Rate minus the first's",
        ),
    ),
    Term(
        key="interval",
        name="95 % interval",
        words="What so few episodes leave open: were the campaign repeated, 95 % of such intervals "
        "would hold the true value. Of rates it is Wilson's; where nothing was found, the exact "
        "one-sided bound stands in its place, near 3 ÷ n.",
        labels=("95 % interval", "Share, 95 % interval"),
    ),
    Term(
        key="failure-probability",
        name="Failure probability",
        words="How often noise that is drawn from p(x) ends in a collision, as the method "
        "estimates it. It knows nothing of kinds of failure that the method never met.",
        labels=("Failure probability", "P(failure)", "Probability under p(x)"),
    ),
    Term(
        key="cv",
        name="Coefficient of variation (cv)",
        words="Standard error of an estimated probability ÷ the probability: 0.1 is an estimate "
        "that is sure to about a tenth.",
    ),
    Term(
        key="effective-sample-size",
        name="Effective sample size",
        words="How many equally weighted samples would tell as much as the weighted ones: the "
        "squared sum of the weights ÷ the sum of their squares. Under 100, no probability is told.",
        unit="samples",
    ),
)

LIKELY = (
    Term(
        key="disturbance-model",
        name="Disturbance model p(x)",
        words="How likely each noise on the perceived position is: by default normal at every "
        "step, its sigma growing with the distance.",
        unit="m",
    ),
    Term(
        key="log-p",
        name="log p",
        words="The natural logarithm of the density of an episode's noise under p(x), summed over "
        "its steps, or ÷ steps; densities are in 1/m² a step. Higher is likelier, and one less is "
        "e times less so. Its level follows sigma: hold it against typical noise over the same "
        "steps.",
        unit="nats",
        labels=(
            "log p",
            "log p per step",
            "log p per step of the failures",
            "Median log p per step",
        ),
    ),
    Term(
        key="typical-log-p",
        name="log p of typical noise",
        words="What noise drawn from p(x) has on average over the same steps at the same sigma. A "
        "failure far below it took noise that hardly ever comes; one near it could happen any day.",
        unit="nats",
        labels=("log p of p(x)", "Typical log p", "Typical log p per step"),
    ),
)

PRICES = (
    Term(
        key="cost-per-failure",
        name="Cost per failure",
        words="Price per instance-hour × instance-hours ÷ failures; its interval is that of the "
        "failure rate, turned over. While no failure is found, it is the least that one can cost.",
        unit="USD",
        labels=("Cost per failure", "Per failure", "USD per failure"),
    ),
    Term(
        key="cost-per-mode",
        name="Cost per distinct mode",
        words="Price per instance-hour × instance-hours ÷ the distinct modes that the newest "
        "analysis found among the failures.",
        unit="USD",
        labels=("Per distinct mode", "USD per distinct mode"),
    ),
    Term(
        key="cost",
        name="Cost",
        words="Price per instance-hour × instances × the time during which the campaign ran, "
        "without pauses.",
        unit="USD",
        labels=("Spent", "Cost so far", "Cost in all"),
    ),
    Term(
        key="episodes-per-second",
        name="Episodes per second",
        words="Completed episodes ÷ the time during which the campaign ran.",
        unit="1/s",
        labels=("Episodes/s",),
    ),
)
