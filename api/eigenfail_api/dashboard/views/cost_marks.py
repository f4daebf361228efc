"""A cost per failure as a mark of a chart, and as cells of the table behind it."""

from eigenfail.values import Cost
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import rounded

COLUMNS = ("USD per failure", "95 % interval")


def mark(price: Cost, **whose: object) -> dict[str, object]:
    """Where it is drawn [USD], with whose it is."""
    bounds = price.interval_usd
    value, low, high, at_least = rounded(
        (
            price.per_failure_usd,
            bounds.low if bounds else None,
            bounds.high if bounds else None,
            price.at_least_usd,
        )
    )
    return {**whose, "value": value, "low": low, "high": high, "at_least": at_least}


def cells(price: Cost) -> tuple[str, str]:
    """The same as text, in the order of `COLUMNS`."""
    bounds = formats.interval(price.interval_usd) if price.interval_usd else "lower bound (95 %)"
    return formats.cost_per_failure(price).removesuffix(" USD"), bounds
