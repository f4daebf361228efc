"""A process of its own that checks the bridge at an address: `python -m eigenfail_workers.bridge`.

The address comes on its standard input, and the list of what was checked goes to its standard
output, as `eigenfail.side_process` has it.
"""

import msgspec

from eigenfail import side_process
from eigenfail_workers.bridge.check_up import check_up

if __name__ == "__main__":
    side_process.answer(lambda address: msgspec.json.encode(check_up(address.decode())))
