"""Suites: which there are, and each as one table."""

from typing import Annotated

from fastapi import APIRouter, Path

from eigenfail.values import Page
from eigenfail.values.suite import SuiteStanding, SuiteTable
from eigenfail.wire.http import PREFIX
from eigenfail_api.bodies import Json
from eigenfail_api.parameters import Before, Limit, Stored
from eigenfail_api.schemas import documented
from eigenfail_services.campaigns.suites import suite_table

router = APIRouter(prefix=f"{PREFIX}/suites", tags=["suites"])

SuiteName = Annotated[
    str, Path(max_length=200, description='What stands before the first ": " of the names.')
]


@router.get("", **documented(Page[SuiteStanding]))
def list_suites(store: Stored, limit: Limit = 50, before: Before = None) -> Json:
    """Suites, that with the newest campaign first; `before` is the id of a campaign."""
    return Json(store.campaigns.suites(limit, before))


@router.get("/{suite:path}", **documented(SuiteTable))
def get_suite(store: Stored, suite: SuiteName) -> Json:
    """A suite as one table: the newest campaign of each member, and what differs between them."""
    return Json(suite_table(store, suite))
