"""Two groups of campaigns, side by side."""

from typing import Annotated

from fastapi import APIRouter, Query

from eigenfail.values import Comparison
from eigenfail.wire.http import PREFIX
from eigenfail_api.bodies import Json
from eigenfail_api.parameters import IDS, Stored
from eigenfail_api.schemas import documented
from eigenfail_services.campaigns.comparison import compare

router = APIRouter(prefix=f"{PREFIX}/comparisons", tags=["campaigns"])

Ids = Annotated[
    str,
    Query(
        pattern=IDS,
        description="Ids of campaigns, one for each seed, with commas in between.",
        examples=["1"],
    ),
]


@router.get("", **documented(Comparison))
def get_comparison(store: Stored, a: Ids, b: Ids) -> Json:
    """Failure rates, cost, likelihood and pairs of two campaigns, or of several seeds of each."""
    return Json(compare(store, numbers(a), numbers(b)))


def numbers(ids: str) -> tuple[int, ...]:
    """The ids in a text that has the pattern."""
    return tuple(map(int, ids.split(",")))
