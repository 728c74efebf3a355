"""Scenarios as the Autoferry sensor fusion data set describes them; MATLAB wrote its JSON."""

import json

T0 = 1620114892.25
OWN = [[-16.5, -390.25], [-16.0, -391.0], [-15.5, -391.5], [-15.0, -392.0], [-14.5, -393.0]]
SENSORS = [1, 3, 2, 4, 1]
TARGETS = [[101.5, 36.25, 0], [-137.5, -193.5, 0]]
MEASUREMENTS = [
    [118.0, 426.0],  # one position, at target 1
    -2.2,
    [[118.5, 50.0, -122.5], [426.5, -60.0, 197.5]],  # three positions
    [1.06, 1.25],
    [],
]


def write(folder, name="scenario2", **changes):
    """Write a scenario into a folder and return it."""
    folder.mkdir(parents=True, exist_ok=True)
    detections, truth = [], []
    for number, (sensor, own, measurement) in enumerate(zip(SENSORS, OWN, MEASUREMENTS, strict=True)):
        time = T0 + 0.125 * number
        item = {"sensorID": sensor, "measurements": [], "ownshipPosition": own, "time": time}
        detections.append({**item, "measurement": measurement, **changes.get(str(number), {})})
        truth.append([{"targetID": k, "position": place, "time": time} for k, place in enumerate(TARGETS, 1)])
    truth[-1] = truth[-1][1]  # a single target is not a list
    (folder / f"{name}_detections.json").write_text(json.dumps(detections))
    (folder / f"{name}_groundTruth.json").write_text(json.dumps(truth))
    return folder
