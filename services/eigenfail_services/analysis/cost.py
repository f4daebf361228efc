"""What a failure cost to find."""

from eigenfail.values import Cost, Interval
from eigenfail_services.statistics.intervals import rate

SECONDS_PER_HOUR = 3600.0


def cost(
    active_s: float, instances: int, price_usd_per_hour: float, failures: int, completed: int
) -> Cost:
    """Price per instance-hour × instance-hours ÷ failures, with the interval of the failure rate.

    The bounds are total ÷ (completed × bound of the rate), so that a campaign without a failure
    has a lower bound instead of an infinite cost.

    Args:
        active_s: time during which the instances were occupied. [s]
        instances: how many were occupied.
        price_usd_per_hour: of one instance.
        failures: collisions among the completed episodes.
        completed: episodes that ran to their end.

    Raises:
        InvalidValue: more failures than completed episodes.
    """
    hours = active_s * instances / SECONDS_PER_HOUR
    total_usd = price_usd_per_hour * hours
    if completed == 0:
        return Cost(total_usd, hours, None, None, None)
    bounds = rate(failures, completed).interval
    at_least_usd = total_usd / (completed * bounds.high)
    if failures == 0:
        return Cost(total_usd, hours, None, None, at_least_usd)
    at_most_usd = total_usd / (completed * bounds.low)
    interval_usd = Interval(at_least_usd, at_most_usd)
    return Cost(total_usd, hours, total_usd / failures, interval_usd, at_least_usd)
