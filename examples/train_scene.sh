#!/usr/bin/env bash
# Train the scene classifier that comes with the program: simulate random scenes of open and of confined water, train,
# and test on layouts, lidars and seas that the training never saw.
#
# Usage: examples/train_scene.sh [FOLDER]    (FOLDER is made, 1 GB; needs seaclutter[train,plot] on the PATH's python)
set -euo pipefail
folder=${1:-scenes}
here=$(cd "$(dirname "$0")/.." && pwd)

python "$here/benchmarks/scene_data.py" "$folder"

# The first class is what a frame with nothing in view is taken for.
seaclutter scene train --scene open="$folder/train/open" --scene confined="$folder/train/confined" \
  -o "$folder/open_confined.onnx" --plot "$folder/training.png" --force

for part in layouts lidars rough all; do
  echo "held out: $part"
  seaclutter scene evaluate "$folder/test/$part" --model "$folder/open_confined.onnx" -v
done
