#!/usr/bin/env bash
# Install what tests need of the machine, where apt or npm can; else the tests that need it are skipped.
#
# Runlevel 1 keeps Debian's packages from starting services, such as nginx at port 80.
set -u
cd "$(dirname "$0")/.."

apt_install() { { apt-get update -qq && RUNLEVEL=1 apt-get install -y -qq "$@"; } >/dev/null 2>&1; }
has() { command -v "$1" >/dev/null; }

has chromium-headless-shell || apt_install chromium-headless-shell \
	|| has chromium || apt_install chromium \
	|| echo "No chromium: the tests that need it are skipped, and told at the end."

echo '#include <zmq.h>' | g++ -x c++ -fsyntax-only - 2>/dev/null \
	|| apt_install g++ libzmq3-dev \
	|| echo "No g++ with zmq.h: the tests of the C++ bridge are skipped, and told at the end."

{ has npm && npm ci --prefix examples/bridge/javascript --ignore-scripts --silent; } \
	|| echo "No npm: the tests of the JavaScript bridge are skipped, and told at the end."

{ has strace && has ip && has curl && test -x /usr/sbin/nginx; } \
	|| apt_install strace iproute2 curl nginx-light \
	|| echo "No strace, ip, curl or nginx: the tests that need them are skipped, and told at the end."
