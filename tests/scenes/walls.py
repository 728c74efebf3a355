"""Toy scenes that a network learns in seconds: two long walls, or a few separate blobs."""

import numpy as np


def toy_cloud(kind, rng):
    """Return points, shape (3, N): blobs all around for kind 0, walls on two sides for kind 1; rotated at random."""
    if kind:
        x = rng.uniform(-55, 55, 800)
        y = np.where(rng.random(800) < 0.5, rng.uniform(8, 20), -rng.uniform(8, 20)) + rng.normal(0, 0.2, 800)
    else:
        centers = rng.uniform(-50, 50, (2, rng.integers(3, 9)))
        x, y = np.repeat(centers, 80, axis=1) + rng.normal(0, 0.7, (2, 80 * centers.shape[1]))
    angle = rng.uniform(0, 2 * np.pi)
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack((cos * x - sin * y, sin * x + cos * y, rng.uniform(-1, 1, len(x))))


def write_toys(folder, recordings, *, frames=2, seed=1):
    """Write recordings of both kinds, a folder of NPY frames each, under open/ and confined/."""
    rng = np.random.default_rng(seed)
    for kind, name in enumerate(("open", "confined")):
        for number in range(recordings):
            target = folder / name / f"{name}{number}"
            target.mkdir(parents=True)
            for frame in range(frames):
                np.save(target / f"{frame}.npy", toy_cloud(kind, rng).T.astype("f4"))
    return folder
