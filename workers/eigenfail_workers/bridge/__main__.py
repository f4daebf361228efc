"""Check the bridge at an address in a separate process: `python -m eigenfail_workers.bridge`.

The address is read from standard input, and the results of the checks are written to standard
output, as `eigenfail.processes` defines.
"""

import msgspec

from eigenfail import processes
from eigenfail_workers.bridge.checks import check_bridge

if __name__ == "__main__":
    processes.answer(lambda address: msgspec.json.encode(check_bridge(address.decode())))
