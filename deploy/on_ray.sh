#!/bin/sh
# on_ray.sh HEAD:PORT PROGRAM…: a program of ours on a node of Ray's, which offers no processor.
# Ray serves a program through a node beside it, in the same container. A node whose head has died
# ends; then there is another one, for as long as the program lives.
set -eu
head=$1
shift
while :; do
    ray start --address="$head" --block --num-cpus=0 --num-gpus=0 --object-store-memory=80000000 \
        --include-log-monitor=false --disable-usage-stats || true
    sleep 2
done &
exec python -m "$@"
