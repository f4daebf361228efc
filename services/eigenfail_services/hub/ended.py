"""What a hub says of a campaign that it has finished with."""

import msgspec


class Ended(msgspec.Struct, frozen=True):
    """A campaign that the hub has finished with; `problem` is empty if it ran to its end.

    `because` says why it came to its end; it is empty if it was halted. `lost` if it is somebody
    else's by now.
    """

    campaign: int
    problem: str
    because: str = ""
    lost: bool = False
