"""Triage on the page of a failure mode.

The form works without JavaScript: it leads back to the page that it is on.
"""

import re
from collections.abc import Mapping
from typing import Annotated

from fastapi import APIRouter, Depends, Request
from fastapi.responses import RedirectResponse

from eigenfail.errors import Conflict, InvalidValue
from eigenfail.settings import refuse_hidden
from eigenfail.values.triage import (
    Triage,
    TriageChange,
    check_change,
)
from eigenfail.wire.http import read_fields
from eigenfail_api.access.change_details import record_form
from eigenfail_api.parameters import AnalysisId, CallerName, ModeNumber, Stored, read_form

MOST_FIELDS = 100
SEE_OTHER = 303
VERSION = re.compile(r"\d{1,15}", re.ASCII)

router = APIRouter(include_in_schema=False)


async def read_triage_form(request: Request) -> dict[str, str]:
    """Return the fields of the form.

    Raises:
        HTTPException: 400, the body is no form.
        InvalidValue: a text has an invisible character.
    """
    form = await read_form(request, MOST_FIELDS)
    refuse_hidden(form)
    record_form(request.scope, form)
    return form


Form = Annotated[dict[str, str], Depends(read_triage_form)]


def read_change(form: Mapping[str, str]) -> TriageChange:
    """Return the change of a form that shows the whole triage.

    Raises:
        InvalidValue: a value is outside its bounds.
    """
    given = {name: form.get(name) for name in TriageChange.__struct_fields__}
    return check_change(read_fields(given, TriageChange))


def read_version(form: Mapping[str, str]) -> int | None:
    """Return when the triage that a form shows was changed last; None if it never was. [ms]

    Raises:
        InvalidValue: it is no such time.
    """
    text = form.get("changed_ms", "")
    if text and not VERSION.fullmatch(text):
        raise InvalidValue(
            "changed_ms", "it is not a time in milliseconds.", "Open the page again."
        )
    return int(text) if text else None


@router.post("/analyses/{analysis}/modes/{mode}/triage")
def triage_mode(
    store: Stored, analysis: AnalysisId, mode: ModeNumber, form: Form, who: CallerName
) -> RedirectResponse:
    """Change the triage of a failure mode."""
    shown_ms = read_version(form)

    def refuse_newer(found: Triage) -> None:
        if found.changed_ms != shown_ms:
            by = f", by {found.changed_by}" if found.changed_by else ""
            raise Conflict(
                f"The triage of this mode was changed meanwhile{by}.",
                "Open the page again, and change what it shows now.",
            )

    store.triage.change(analysis, mode, read_change(form), who, refuse_newer)
    return RedirectResponse(f"/analyses/{analysis}/modes/{mode}#triage", SEE_OTHER)
