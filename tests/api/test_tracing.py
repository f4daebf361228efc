"""Traces: sent to a real endpoint over OTLP by a real process; without one, nothing is."""

import gzip
import os
import signal
import subprocess
import sys
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import deadlines
import httpx2
import pytest
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest

pytestmark = pytest.mark.service

TRACE, PARENT = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"
COMMIT = """
from eigenfail_services import observability
end = observability.configure("services")
with observability.span("commit", campaign=3, results=2):
    pass
end()
"""
WITHOUT = """
import sys
sys.modules["opentelemetry.exporter"] = None
from eigenfail_services.__main__ import main
main()
"""


@pytest.fixture
def collector():
    """Takes traces; yields its address and what came."""
    came = []

    class Takes(BaseHTTPRequestHandler):
        def do_POST(self):
            body = self.rfile.read(int(self.headers["Content-Length"]))
            if self.headers.get("Content-Encoding") == "gzip":
                body = gzip.decompress(body)
            came.append(ExportTraceServiceRequest.FromString(body))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Takes)
    thread = Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}", came
    server.shutdown()
    thread.join()
    server.server_close()


def environment(tmp_path, **more):
    return {**os.environ, "EIGENFAIL_DATABASE": f"sqlite:///{tmp_path}/e.db", **more}


def spans_of(came):
    for request in came:
        for resource in request.resource_spans:
            facts = {fact.key: fact.value.string_value for fact in resource.resource.attributes}
            for scope in resource.scope_spans:
                yield from ((facts["service.name"], span) for span in scope.spans)


def test_a_request_is_a_span_of_the_callers_trace(collector, tmp_path):
    address, came = collector
    process = subprocess.Popen(
        [sys.executable, "-m", "eigenfail_api", "--port", "0"],
        env=environment(tmp_path, OTEL_EXPORTER_OTLP_ENDPOINT=address),
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        url = process.stdout.readline().split()[-1]
        headers = {"traceparent": f"00-{TRACE}-{PARENT}-01"}
        assert httpx2.get(f"{url}/api/v1/campaigns/9", headers=headers).status_code == 404
        assert httpx2.get(f"{url}/healthz").status_code == 200
        process.send_signal(signal.SIGTERM)
        assert process.wait(deadlines.PROCESS_S) == 0
    finally:
        process.kill()
        process.communicate()
    found = [(name, span) for name, span in spans_of(came) if span.parent_span_id.hex() == PARENT]
    ((service, span),) = found
    assert (service, span.trace_id.hex()) == ("eigenfail-controller", TRACE)
    assert span.name == "GET /api/v1/campaigns/{campaign}"
    status = next(a for a in span.attributes if a.key == "http.response.status_code")
    assert status.value.int_value == 404


def test_what_the_services_do_carries_what_it_is_about(collector, tmp_path):
    address, came = collector
    asked = environment(tmp_path, OTEL_EXPORTER_OTLP_ENDPOINT=address, OTEL_SERVICE_NAME="mine")
    subprocess.run([sys.executable, "-c", COMMIT], env=asked, check=True)
    ((service, span),) = spans_of(came)
    assert (service, span.name) == ("mine", "commit")
    facts = {fact.key: fact.value.int_value for fact in span.attributes}
    assert facts == {"eigenfail.campaign": 3, "eigenfail.results": 2}


def test_an_endpoint_without_what_speaks_to_it_is_refused(tmp_path):
    asked = environment(tmp_path, OTEL_EXPORTER_OTLP_ENDPOINT="http://127.0.0.1:1")
    command = [sys.executable, "-c", WITHOUT, "--launcher", "none"]
    done = subprocess.run(command, env=asked, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "Install eigenfail[otel]" in done.stderr
    assert "Traceback" not in done.stderr
