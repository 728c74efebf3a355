#!/usr/bin/env bash
# The whole chain on a simulated sea trial: simulate recordings, calibrate on one without targets, filter another, and
# compare the joint method with its stages and with global thresholds.
#
# Usage: examples/chain.sh [FOLDER]    (seaclutter must be on the PATH; creates FOLDER, 60 MB)
set -euo pipefail
folder=${1:-chain}
mkdir -p "$folder"
cd "$folder"

seaclutter simulate clutter_only -o clutter_only.mcap --force
seaclutter simulate departure -o departure.mcap --force

# Thresholds for this sensor and this sea. The labels exclude the points of own ship.
seaclutter calibrate clutter_only.mcap --labels clutter_only.labels.csv -o my.yaml --force

# A drop-in file for the recording, and a table with a line for each frame.
seaclutter filter departure.mcap -c my.yaml -o departure.filtered.mcap --csv frames.csv --force

# False alarms and missed targets of the five methods in Tables 4 and 5 of Li et al. 2023.
seaclutter evaluate departure.mcap --labels departure.labels.csv -c my.yaml --compare paper \
  -o alarms.csv --summary alarms.json --force
