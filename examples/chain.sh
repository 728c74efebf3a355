#!/usr/bin/env bash
# The whole chain on a simulated sea trial: make recordings, calibrate on one without targets, filter another, and
# compare the method with its stages and with global thresholds.
#
# Usage: examples/chain.sh [FOLDER]    (seaclutter must be on the PATH; FOLDER is made, 60 MB)
set -euo pipefail
folder=${1:-chain}
mkdir -p "$folder"
cd "$folder"

seaclutter simulate clutter_only -o clutter_only.mcap --force
seaclutter simulate departure -o departure.mcap --force

# Thresholds for this sensor and this sea. The labels leave own vessel out.
seaclutter calibrate clutter_only.mcap --labels clutter_only.labels.csv -o my.yaml --force

# A drop-in for the recording, and a line for each of its frames.
seaclutter filter departure.mcap -c my.yaml -o departure.filtered.mcap --csv frames.csv --force

# False and omitted alarms, of the five methods of the paper's Tables 4 and 5.
seaclutter evaluate departure.mcap --labels departure.labels.csv -c my.yaml --compare paper \
  -o alarms.csv --summary alarms.json --force
