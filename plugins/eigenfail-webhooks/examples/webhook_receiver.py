"""A receiver of webhooks: `WEBHOOK_SECRET=whsec_… python examples/webhook_receiver.py 8500`.

It verifies each message, drops repeats by their event id, and prints the rest.
"""

import json
import os
import sys
from http.server import BaseHTTPRequestHandler, HTTPServer

from eigenfail.errors import InvalidValue
from eigenfail_webhooks.signatures import ID_HEADER, verify_message

LARGEST_BYTES = 1_000_000
SECRET = os.environ["WEBHOOK_SECRET"]

# A real receiver keeps the ids in its database, with what it does for an event.
known: set[str] = set()


class Receiver(BaseHTTPRequestHandler):
    """Answers 204 to each genuine message, and 400 to any other."""

    def do_POST(self) -> None:
        """Take a message."""
        length = min(int(self.headers.get("Content-Length", "0")), LARGEST_BYTES)
        body = self.rfile.read(length)
        headers = {name.lower(): value for name, value in self.headers.items()}
        try:
            verify_message(SECRET, headers, body)
        except InvalidValue as error:
            self.send_error(400, str(error))
            return
        if headers[ID_HEADER] not in known:
            known.add(headers[ID_HEADER])
            message = json.loads(body)
            print(message["type"], json.dumps(message["data"]), flush=True)
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Print events alone."""


if __name__ == "__main__":
    HTTPServer(("127.0.0.1", int(sys.argv[1])), Receiver).serve_forever()
