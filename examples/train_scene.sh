#!/usr/bin/env bash
# Train the scene classifier that comes with the program: simulate random scenes of open and of confined water, train,
# and evaluate it on layouts, lidars and seas that are not in the training data.
#
# Usage: examples/train_scene.sh [FOLDER]    (creates FOLDER, 1 GB; the python on the PATH needs seaclutter[train,plot])
set -euo pipefail
folder=${1:-scenes}
here=$(cd "$(dirname "$0")/.." && pwd)

python "$here/benchmarks/scene_data.py" "$folder"

# A frame with nothing in view gets the first class.
seaclutter scene train --scene open="$folder/train/open" --scene confined="$folder/train/confined" \
  -o "$folder/open_confined.onnx" --plot "$folder/training.png" --force

for part in layouts lidars rough all; do
  echo "held out: $part"
  seaclutter scene evaluate "$folder/test/$part" --model "$folder/open_confined.onnx" -v
done
