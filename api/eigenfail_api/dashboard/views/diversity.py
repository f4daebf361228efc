"""How the failures of a campaign spread over modes."""

from eigenfail.values import Diversity
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.summaries import Figure


def diversity_tiles(found: Diversity) -> tuple[tuple[str, Figure], ...]:
    """The figures, each with what it rests on."""
    of_all = (f"of {formats.counted(found.failures, 'failure')}",)
    modes = f"of {found.modes}, clusters beyond noise"
    seen = ", ".join(map(str, found.coverage))
    return (
        ("Effective modes", Figure(formats.number(found.effective_modes), (modes,))),
        ("Largest mode", Figure(formats.percent(found.largest_share), of_all)),
        ("Spread [sigma]", Figure(formats.number(found.spread), ("between failures; p(x) has 1",))),
        ("All modes seen after", Figure(seen_after(found), (f"modes by tenths: {seen}",))),
    )


def seen_after(found: Diversity) -> str:
    """The part of the campaign after which no new mode came."""
    tenths = 1 + sum(seen < found.modes for seen in found.coverage)
    return f"{10 * tenths} %"
