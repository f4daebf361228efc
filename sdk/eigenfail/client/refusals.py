"""What a service refuses, as the error that it raised."""

import httpx2
import msgspec

from eigenfail.errors import EigenfailError
from eigenfail.wire.problems import UNTYPED, Problem, error_of


def refusal(response: httpx2.Response) -> EigenfailError:
    """The error that a response tells of."""
    try:
        return error_of(msgspec.json.decode(response.content, type=Problem))
    except msgspec.DecodeError:
        status = response.status_code
        detail = f"{response.url} answered with status {status} and no reason."
        remedy = "Make sure that an eigenfail service of this version listens there."
        untold = Problem(type=UNTYPED, title="", status=status, detail=detail, remedy=remedy)
        return error_of(untold)
